"""How far the other modes move when a mode's curve is measured."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from iwanjax.config import StudySetup
from iwanjax.config.reading import recordings_of
from iwanjax.errors import InputError
from iwanjax.signals import RingDown
from iwanjax.studies.measured import Hit, MeasuredMode, bands_of, hit_of


def hit_beside(mode: MeasuredMode) -> Hit:
    """The hit of a mode that is fitted where other modes are taken into account.

    Curves that several hits were merged to have no time at which others moved: of those it is the
    hit with most levels.

    Raises
    ------
    InputError
        For a mode that has curves without a time history.
    """
    hits = [hit for hit in mode.hits if hit.ringdown is not None]
    if not hits:
        raise InputError(
            f"fit: coupled: {mode.name} has curves without a time history, so that nothing is "
            "known of the other modes at the time; give the recordings, or leave coupled out"
        )
    return max(hits, key=lambda hit: hit.curves.amplitude.size)


def amplitudes_beside(
    study: StudySetup, modes: Sequence[MeasuredMode]
) -> list[dict[int, Float[np.ndarray, " levels"]]]:
    """For each mode's hit the modal displacements of the study's other modes at its levels.

    Modes that the hit shows nothing of are left out.
    """
    bands = bands_of(study)
    found = []
    for mode in modes:
        hit = hit_beside(mode)
        assert hit.ringdown is not None
        row = {}
        for entry in study.recordings:
            for name, recording in recordings_of(entry) if _holds(entry.name, hit.name) else ():
                if name != hit.name:
                    continue
                for key, band in bands.items():
                    if key == mode.key or not isinstance(key, int):
                        continue
                    other = hit_of(study, entry, name, recording, key, band)
                    if isinstance(other, Hit) and other.ringdown is not None:
                        row[key] = _at(hit.ringdown.time, other.ringdown)
        found.append(row)
    return found


def _holds(entry: str, hit: str) -> bool:
    """Whether a hit may be of an entry: its recordings are numbered where there are several."""
    return hit == entry or hit.startswith(f"{entry}[")


def _at(time: np.ndarray, decay: RingDown) -> np.ndarray:
    """Modal displacement of a decay at some times."""
    seen = decay.curves.as_quantity("modal displacement")
    per_signal = np.asarray(seen.amplitude) / np.asarray(decay.curves.amplitude)
    envelope = np.interp(time, decay.signal_time, decay.envelope)
    return envelope * np.interp(time, decay.time, per_signal)
