"""Two masses on springs, hit: an exact simulation in plain NumPy, and the problem that fits it.

The simulation knows nothing of modes, steps or predictors: the state of the masses themselves goes
from one fine step to the next by the matrix exponential, under a force that is known at all times.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
import scipy.linalg

import iwanjax as ij
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.conditioning import conditioned
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.places import Place, followed, places_of
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.recordings import StudyRecording

RATE, N, FINE, AT = 1024.0, 400, 32, 0.04
M, K = np.diag([1.0, 1.5]), np.array([[1.5e5, -6e4], [-6e4, 6e4]])
JOINT = 3e4
"""Stiffness of the joint between the masses, N/m, beside K."""
ROWS = {"m1": np.array([1.0, 0.0]), "m2": np.array([0.0, 1.0]), "J1": np.array([-1.0, 1.0])}
C = 2e-5 * K + 0.4 * np.eye(2)
# Enough for tests of many kinds to share one set of kernels.
NAMES = ("stiffness_error", "viscous_damping", "mass_error", "cubic_stiffness", "gap_contact")
QUANTITIES = {"displacement": 0, "velocity": 1, "acceleration": 2}


def hit(t: np.ndarray, peak: float, at: float = AT, width: float = 2.5 / RATE) -> np.ndarray:
    """A bell: 1e-13 of it lies above half the sampling rate, so that its samples say it all."""
    return peak * np.exp(-0.5 * ((t - at) / width) ** 2)


def state_matrix(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Of displacements and velocities."""
    lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    return np.vstack([np.eye(*lower.shape, k=len(mass)), lower])


def stiffness_with_joint(k: float = JOINT) -> np.ndarray:
    return K + k * np.outer(ROWS["J1"], ROWS["J1"])


def simulated(
    peak: float,
    quantity: str = "acceleration",
    mass: np.ndarray = M,
    damping: np.ndarray = C,
    stiffness: np.ndarray | None = None,
    struck: int = 0,
    at: float = AT,
    count: int = N,
) -> np.ndarray:
    """What sensors on both masses show after a hit, (count, 2).

    Over a fine step the force is a straight line (Van Loan 1978): the step squared, 1e-5 of a
    period, is all that is off. Larger matrices have masses without sensors behind the others.
    """
    stiffness = stiffness_with_joint() if stiffness is None else stiffness
    A, dt = state_matrix(mass, damping, stiffness), 1.0 / (RATE * FINE)
    n, m = len(mass), 2 * len(mass)
    b = np.concatenate([np.zeros(n), np.linalg.solve(mass, np.eye(n)[struck])])
    whole = np.zeros((m + 2, m + 2))
    whole[:m, :m], whole[:m, m], whole[m, m + 1] = A, b, 1.0
    E = scipy.linalg.expm(whole * dt)
    step, held, ramp = E[:m, :m], E[:m, m], E[:m, m + 1] / dt
    force = hit(np.arange(count * FINE) * dt, peak, at)
    z, states = np.zeros(m), np.zeros((count, m))
    for i in range(count * FINE):
        if i % FINE == 0:
            states[i // FINE] = z
        if i + 1 < len(force):
            z = step @ z + held * force[i] + ramp * (force[i + 1] - force[i])
    rates = states @ A.T + np.outer(force[::FINE], b)
    whole = (states[:, :n], states[:, n:], rates[:, n:])[QUANTITIES[quantity]]
    return whole[:, : len(M)]


def measured_force(peak: float, struck: int = 0, at: float = AT, count: int = N) -> np.ndarray:
    """The hit as sampled, (count, 2)."""
    force = np.zeros((count, 2))
    force[:, struck] = hit(np.arange(count) / RATE, peak, at)
    return force


def model(joint: bool = True) -> ij.JointedStructure:
    """With a linear spring for its joint, or without one."""
    linear = ij.LinearStructure(M, C, K if joint else stiffness_with_joint())
    return ij.JointedStructure(
        linear, {"J1": (ROWS["J1"], ij.LinearSpring(k=JOINT))} if joint else {}
    )


def problem(
    responses: Sequence[np.ndarray],
    forces: Sequence[np.ndarray],
    noise: np.ndarray,
    *,
    names: tuple[str, ...] = ("cubic_stiffness",),
    quantity: str = "acceleration",
    joint: bool = True,
    loose: float = 1.0,
) -> tuple[HistoryProblem, tuple[Place, ...]]:
    """What fits the recordings, the noise of whose sensors is known; and the places in it."""
    kinds = tuple(kind for name in names for kind in CATALOGUE[name] if isinstance(kind, ForceKind))
    structure = model(joint)
    by, modal = predictor(structure, jnp.eye(2), jnp.eye(2), RATE, quantity, kinds, 2)
    recordings = [
        StudyRecording(f"rec{i}", response, force)
        for i, (response, force) in enumerate(zip(responses, forces, strict=True))
    ]
    length = max(map(len, responses))
    seen = conditioned(recordings, by, modal, noise, length, len(recordings), 6)
    joints = tuple(Joint(each, jnp.array([loose])) for each in structure.elements)
    order = tuple(range(len(recordings)))
    made = HistoryProblem(by, joints, seen.data, noise, order, forces=seen.forces)
    rows = {name: row @ np.asarray(modal.Phi) for name, row in ROWS.items()}
    return made, places_of(made, followed(made), rows)
