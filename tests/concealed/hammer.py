"""Hammer blows on a structure, and what is recorded of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from iwanjax.trial.acquisition import decimate, transduced
from iwanjax.trial.effects import Effect
from iwanjax.trial.physics import FILTER_SPAN, FineHistories, march
from iwanjax.trial.structure import Array, Iwan, TrialStructure


@dataclass(frozen=True)
class Hit:
    """One hammer blow: a half sine of `width` sampling intervals from `start` on."""

    place: str
    peak: float
    start: float
    width: float
    use: str
    order: int
    """Position in the study, on which a drifting joint depends."""

    def force(self, time: Array) -> Array:
        """Return the force at times given in sampling intervals."""
        phase = (time - self.start) / self.width
        return np.where((phase > 0) & (phase < 1), self.peak * np.sin(np.pi * phase), 0.0)


def integrate(
    structure: TrialStructure,
    joints: Mapping[str, Iwan],
    effects: Sequence[Effect],
    hits: Sequence[Hit],
    oversampling: int | None = None,
    watch_rows: bool = False,
    thrown: Array | None = None,
) -> FineHistories:
    """Accelerations of the sensors under hammer blows, before the measurement chain.

    Each recording's force is that of the one input that is struck.
    """
    oversampling = oversampling or structure.steps
    steps = (structure.samples + FILTER_SPAN) * oversampling + 1
    time = np.arange(steps) / oversampling
    inputs = np.zeros((steps, len(hits), len(structure.inputs)))
    struck = [list(structure.inputs).index(hit.place) for hit in hits]
    for i, (hit, at) in enumerate(zip(hits, struck, strict=True)):
        inputs[:, i, at] = hit.force(time)
    found = march(
        structure,
        joints,
        effects,
        inputs,
        1.0 / (structure.rate * oversampling),
        np.array([hit.order for hit in hits]),
        list(structure.rows.values()) if watch_rows else (),
        thrown,
    )
    return replace(found, force=inputs[:, np.arange(len(hits)), struck])


def measure(
    structure: TrialStructure,
    joints: Mapping[str, Iwan],
    effects: Sequence[Effect],
    hits: Sequence[Hit],
    oversampling: int | None = None,
    thrown: Array | None = None,
) -> tuple[Array, Array]:
    """Responses (sample, recording, sensor) and forces (sample, recording) to hammer blows.

    Free of noise, and before the converter (see `saturate`).
    """
    oversampling = oversampling or structure.steps
    fine = integrate(structure, joints, effects, hits, oversampling, thrown=thrown)
    seen = transduced(
        "sensor", list(structure.sensors), effects, fine.response, structure, oversampling
    )
    return (
        decimate(seen, structure.samples, oversampling),
        decimate(fine.force, structure.samples, oversampling),
    )
