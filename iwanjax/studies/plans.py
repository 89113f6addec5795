"""What a study's recordings would show of effects that nobody has measured yet."""

from collections.abc import Callable
from dataclasses import replace

from iwanjax.config import StudySetup
from iwanjax.discrepancy.histories.prepared import prepared
from iwanjax.errors import InputError
from iwanjax.planning import Detectability, detectability
from iwanjax.studies.diagnoses import histories_of


def detectability_of(study: StudySetup, progress: Callable[[str], None]) -> Detectability:
    """By the time histories of a study's structure.

    Raises
    ------
    InputError
        For a study without them, and as :func:`iwanjax.diagnose`.
    """
    if study.structure is None:
        raise InputError(
            f"{study.label}: detectability needs a structure and its time histories, model.file, "
            "matrices, builder or test; this study has modal"
        )
    known = histories_of(study, "detectability")
    ready = prepared(known.structure, known.recordings, known.sampling_rate, **known.about)
    found = detectability(ready, study.name, seed=study.seed, progress=progress)
    return replace(found, warnings=(*found.warnings, *ready.warnings, *known.resampled))
