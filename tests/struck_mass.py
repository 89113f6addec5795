"""A mass on a spring and a joint that is struck: what is measured, and searches that explain it."""

import math
from collections.abc import Callable
from functools import partial

import jax.numpy as jnp
import numpy as np

import iwanjax as ij
from iwanjax.discrepancy.histories.ranking import Scope
from iwanjax.discrepancy.histories.time_steps import StepRefinement
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.kinds import ForceKind, Kind
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.places import followed, places_of
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.recordings import StudyRecording

RATE, N = 1024.0, 500
# Of recordings with a lower rate: one set of kernels serves all of them.
FEW = 84


def struck(more: Callable[[float], float], c: float = 2.5) -> np.ndarray:
    """A mass on a spring with a joint, and more that holds it: small steps, their own code.

    The model's damping is 2.5 N s/m.
    """
    fine = 64
    dt = 1.0 / (RATE * fine)
    d = v = 0.0
    found = np.zeros(N)
    for i in range(N * fine):
        t = i * dt
        if i % fine == 0:
            found[i // fine] = pulse(t) - 6e4 * d - c * v - more(d)
        v += dt * (pulse(t) - 6e4 * d - c * v - more(d))
        d += dt * v
    return found[:, None]


def pulse(t):
    return 80.0 * math.sin(math.pi * (t - 0.06) / 0.012) ** 2 if 0.06 < t < 0.072 else 0.0


NAMES = ("cubic_stiffness", "gap_contact", "stiffness_error", "viscous_damping", "viscoelastic")
# One set of kernels serves all searches, whichever of these kinds are looked for in one.
COMPILED = (*NAMES, "bilinear_stiffness", "coulomb_friction", "mass_error")


JOINT = ij.Iwan4(F_S=1e3, K_T=3e4, chi=-0.5, beta=1.5)


def resolution(
    response: np.ndarray, joint: ij.AbstractJoint = JOINT, every: int = 1
) -> StepRefinement:
    """A mass on a joint, and every so many-th sample measured."""
    one = np.ones((1, 1))
    model = ij.JointedStructure(
        ij.LinearStructure(one, 2.5 * one, 3e4 * one), {"J1": (np.ones(1), joint)}
    )
    forces = tuple(kind for kind in kinds(COMPILED) if isinstance(kind, ForceKind))
    at = jnp.asarray(one)
    made = partial(predictor, model, at, at, RATE / every, "acceleration", forces)
    count = N if every == 1 else FEW
    force = np.array([[pulse(i / RATE)] for i in range(0, count * every, every)])
    response = response[: count * every : every]
    tight = Joint(joint, jnp.full(len(joint.parameters), 1e-3))
    noise = np.array([1e-3 * np.std(response)])
    return StepRefinement(made, (tight,), [StudyRecording("rec", response, force)], noise)


def kinds(names: tuple[str, ...] = NAMES) -> tuple[Kind, ...]:
    """That may be missing."""
    return tuple(kind for name in names for kind in CATALOGUE[name])


def searching(
    response: np.ndarray, joint: ij.AbstractJoint = JOINT, names: tuple[str, ...] = NAMES
) -> tuple[HistoryProblem, Scope]:
    """Of some kinds at the only place there is."""
    now = resolution(response, joint).of_model()
    row = {"J1": np.ones(1) @ np.asarray(now.modal.Phi)}
    places = places_of(now.problem, followed(now.problem), row)
    scope = Scope(kinds(names), places, ("a1",), ("J1",), lambda: True, lambda line: None)
    return now.problem, scope
