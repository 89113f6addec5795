"""A bolted chain under hammer hits, and a fit of it whose estimate and covariance are given.

The hits come from the package's integrator with finer steps; nothing is searched for, so that a
prediction can be held against what it should be.
"""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from bolted_chain import ROWS, TRUTH, K, M, damping

import iwanjax as ij
from iwanjax.config import Measurement
from iwanjax.dynamics import half_sine
from iwanjax.studies import MeasuredMode, Study, StudyResults
from iwanjax.studies.fits import StudyFit
from iwanjax.updating.structural import structural_problem

RATE, N, FINER = 2048.0, 1536, 6
SENSORS = {f"a{i + 1}": row for i, row in enumerate(np.eye(3))}
INPUTS = {
    "m1": np.array([1.0, 0.0, 0.0]),
    "m3": np.array([0.0, 0.0, 1.0]),
    "base": -M.sum(axis=1),
}
MODES = (0, 1)


def chain(**values: float) -> ij.JointedStructure:
    """The chain with some of its joint's parameters changed."""
    joint = ij.Iwan4(**(TRUTH | values))
    return ij.JointedStructure(ij.LinearStructure(M, damping(), K), {"J1": (ROWS["J1"], joint)})


def hit(
    structure: ij.JointedStructure, peak: float, noise: float, seed: int, place: str = "m1"
) -> ij.Recording:
    """A hit of so many newtons (of the ground m/s^2), and accelerations with noise of so much."""
    t = np.arange(N) / RATE
    force = np.where(t >= 0.02, half_sine(t - 0.02, peak, 2.0 * np.pi * 60.0), 0.0)
    fine = np.interp(np.arange(N * FINER) / (RATE * FINER), t, force)
    found = ij.simulate(
        structure,
        fine[:, None],
        1.0 / (RATE * FINER),
        inputs=INPUTS[place],
        keep=("acceleration",),
        every=FINER,
    )
    random = np.random.default_rng(seed)
    absolute = np.asarray(found.acceleration) + (place == "base") * force[:, None]
    return ij.as_recording(
        absolute + noise * random.standard_normal((N, 3)),
        sampling_rate=RATE,
        quantity="acceleration",
        unit="m/s^2",
        sensors=list(SENSORS),
        force=np.stack([force * (place == name) for name in INPUTS], axis=1),
        inputs=list(INPUTS),
        name=f"hit{seed}",
    )


def study(recordings: Sequence[ij.Recording | Measurement], **sections: object) -> Study:
    """A study of the chain; its joint starts where it is."""
    return ij.Study(
        chain(), recordings, sensors=SENSORS, inputs=INPUTS, modes=list(MODES), **sections
    )


def known_fit(
    deviations: Mapping[str, float], modes: Sequence[MeasuredMode] = ()
) -> StudyResults[StudyFit]:
    """The fit that found the truth, with relative deviations of some parameters."""
    levels = np.geomspace(1e-5, 1e-4, 4)
    curves = [
        ij.ModalCurves(
            levels,
            0 * levels + f,
            0 * levels + 1e-3,
            frequency_std=0 * levels + 1e-2,
            damping_std=0 * levels + 1e-5,
            quantity="modal displacement",
        )
        for f in np.asarray(chain().modes().frequency)[list(MODES)]
    ]
    known = ij.structural_parameters(chain(), None, curves, MODES)
    parameters = tuple(known.values())
    problem = structural_problem(chain(), curves, parameters, MODES, None, None, "absolute")
    values = np.array([p.value for p in parameters])
    covariance = np.diag([(p.value * deviations.get(p.name, 0.0)) ** 2 for p in parameters])
    solution = ij.FitSolution(
        parameters=parameters,
        covariance=covariance,
        derived={},
        undetermined=(),
        determined=dict.fromkeys(deviations, True),
        rivals={},
        active_bounds={},
        reaches={},
        misfit=1.0,
        misfit_frequency=1.0,
        misfit_damping=1.0,
        frequency_rms=0.0,
        damping_rms=0.0,
        converged=True,
        agreeing=1,
        runs=1,
        model_error=None,
        model=problem.model(jnp.asarray(values)),
        measured=tuple(curves),
        predicted=tuple(curves),
        problem=problem,
    )
    return StudyResults({"study": StudyFit("study", tuple(modes), solution, None, (), 0.0)})
