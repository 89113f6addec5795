"""A study as effects are concealed in it: its matrices, joints, forces and noise, as arrays."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import eigh

from iwanjax.cluster import LOCAL
from iwanjax.config import StudySetup
from iwanjax.discrepancy.histories.prepared import PreparedStudy, prepared
from iwanjax.effects.catalogue import catalogue
from iwanjax.errors import InputError
from iwanjax.identification.recordings import cleaned
from iwanjax.joints import Iwan4
from iwanjax.structures import JointedStructure
from iwanjax.structures.model_file import BASE
from iwanjax.studies.diagnoses import histories_of
from iwanjax.trial import Take, TrialBase, TrialPlan, TrialResult, TrialStructure, run_trials

# Coordinates beyond which all modes of a model are no longer worth carrying.
_MOST_COORDINATES = 500


def trials_of(
    study: StudySetup,
    folder: Path,
    progress: Callable[[str], None],
    *,
    scheduler: str = LOCAL,
    workers: int | None = None,
    **plan: Any,
) -> TrialResult:
    """Effects concealed in a study's recordings, and what a diagnosis says of them.

    Parameters
    ----------
    study : StudySetup
    folder, progress, scheduler, workers
        As for :func:`iwanjax.trial.run_trials`.
    **plan
        ``count``, ``seed`` and the shares ``empty`` and ``left_out`` of
        :class:`iwanjax.trial.TrialPlan`.

    Raises
    ------
    InputError
        For a study without time histories of a structure that forces move, of joints that the
        trials' own integration does not know, or of very many coordinates; and as
        :func:`iwanjax.trial.run_trials`.
    """
    asked = TrialPlan(**plan)
    if study.structure is None:
        raise InputError(
            f"{study.label}: trial needs a structure and its time histories, model.file, matrices, "
            "builder or test; this study has modal"
        )
    known = histories_of(study, "trial")
    ready = prepared(known.structure, known.recordings, known.sampling_rate, **known.about)
    base = TrialBase(
        structure=_structure(study, ready),
        takes=tuple(_takes(study, ready)),
        noise=_noise(ready),
        kinds=study.hypotheses or tuple(catalogue()),
        quantity=ready.quantity,
        trust=_trust(ready),
    )
    return run_trials(base, asked, folder, scheduler=scheduler, workers=workers, progress=progress)


def _structure(study: StudySetup, ready: PreparedStudy) -> TrialStructure:
    structure = ready.structure
    linear = structure.structure
    if linear.size > _MOST_COORDINATES:
        raise InputError(
            f"{study.label}: trial integrates all modes of a model, and this one has {linear.size} "
            f"coordinates; expected {_MOST_COORDINATES} at most: reduce it (Craig-Bampton)"
        )
    if BASE in ready.inputs:
        raise InputError(f"{study.label}: trial knows forces, and no motion of the ground ({BASE})")
    joints = _joints(study, structure)
    rows = {**dict(ready.rows), **{name: row for name, (row, _) in joints.items()}}
    return TrialStructure(
        name=study.name,
        M=np.asarray(linear.M),
        C=np.asarray(linear.C),
        K=np.asarray(linear.K),
        rows=rows,
        sensors=dict(ready.sensors),
        inputs=dict(ready.inputs),
        joints={name: values for name, (_, values) in joints.items()},
        rate=float(ready.sampling_rate),
        samples=max(len(each.response) for each in ready.recordings),
    )


def _joints(
    study: StudySetup, structure: JointedStructure
) -> dict[str, tuple[np.ndarray, tuple[float, float, float, float]]]:
    """Row and values of each joint, which bears the name of its row from now on."""
    found = {}
    for name, row, joint in zip(
        structure.labels, np.asarray(structure.rows), structure.elements, strict=True
    ):
        if type(joint) is not Iwan4:
            raise InputError(
                f"{study.label}: joint {name} is a {type(joint).__name__}; trial knows iwan4 "
                "joints, whose sliders it integrates itself"
            )
        values = (float(joint.F_S), float(joint.K_T), float(joint.chi), float(joint.beta))
        found[name] = (row, values)
    return found


def _takes(study: StudySetup, ready: PreparedStudy) -> list[Take]:
    takes = []
    for order, each in enumerate(ready.recordings):
        if each.force is None:
            raise InputError(
                f"{study.label}: {each.name} has no force; trial needs forces, of which it makes "
                "the recordings anew"
            )
        # Noise beside the pulses of hammers moved nothing.
        force = cleaned(np.asarray(each.force, float)).clean
        takes.append(Take(each.name, each.use, order, force, np.asarray(each.response, float)))
    return takes


def _noise(ready: PreparedStudy) -> np.ndarray:
    """Of each sensor the median over the recordings that have it."""
    deviations = []
    for each in ready.recordings:
        assert each.noise is not None  # preparing estimates it
        deviations.append(np.where(each.measured, each.noise.deviation, np.nan))
    return np.nanmedian(deviations, axis=0)


def _trust(ready: PreparedStudy) -> np.ndarray | None:
    if ready.trust is None:
        return None
    stuck = ready.structure.linearised("low")
    squared = np.asarray(eigh(np.asarray(stuck.K), np.asarray(stuck.M), eigvals_only=True))
    return ready.trust.deviations(np.maximum(squared, 0.0))
