"""The recovered force at a place against the one that was put there, whatever law is suspected."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from linear_pair import (
    RATE,
    C,
    M,
    N,
    hit,
    measured_force,
    problem,
    state_matrix,
    stiffness_with_joint,
)

import iwanjax as ij
from iwanjax.discrepancy.findings import RestoringForce
from iwanjax.discrepancy.histories.restoring import restoring_force
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification import hypotheses
from iwanjax.identification.conditioning import conditioned, directions_of
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, multistart
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.recordings import StudyRecording

PEAK, K3, NOISE = 60.0, 1e10, 1e-4
NAMES = ("cubic_stiffness", "stiffness_error")
QUANTITIES = (
    pytest.param("displacement", marks=pytest.mark.long),
    pytest.param("velocity", marks=pytest.mark.long),
    "acceleration",
)


def measured(quantity: str) -> np.ndarray:
    """Of two masses with a cubic spring to the ground at the second, by DOP853."""
    A = state_matrix(M, C, stiffness_with_joint())

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        force = np.array([hit(np.asarray(t), PEAK), -K3 * z[1] ** 3])
        return A @ z + np.concatenate([np.zeros(2), np.linalg.solve(M, force)])

    return integrated(rate, np.zeros(4), quantity)


def integrated(rate, start: np.ndarray, quantity: str) -> np.ndarray:
    """Samples of a motion, (N, masses)."""
    t, masses = np.arange(N) / RATE, len(start) // 2
    end = scipy.integrate.solve_ivp(
        rate, (0.0, t[-1]), start, "DOP853", t, rtol=1e-9, atol=1e-13, max_step=1e-3
    )
    return {
        "displacement": end.y[:masses].T,
        "velocity": end.y[masses:].T,
        "acceleration": np.array([rate(s, z)[masses:] for s, z in zip(t, end.y.T, strict=True)]),
    }[quantity]


def recovered(quantity: str, size: float, name: str = "cubic_stiffness") -> RestoringForce:
    """With a law of so large a size at the second mass, not fitted."""
    y = measured(quantity)
    noise = NOISE * np.std(y, axis=0)
    y = y + noise * np.random.default_rng(0).standard_normal(y.shape)
    made, places = problem([y], [measured_force(PEAK)], noise, names=NAMES, quantity=quantity)
    (place,) = (each for each in places if each.label == "m2")
    return beside(made, name, place.row, size)


def beside(made: HistoryProblem, name: str, row: np.ndarray, size: float) -> RestoringForce:
    """Recovered with a law of one size at a place, not fitted."""
    (kind,) = (each for each in made.predictor.kinds if each.name == name)
    z = made.map.given()[: made.parameters]
    start = hypotheses.force(made, kind, "m2", row, z, size, 1.0)
    (fit,) = multistart(made, [start], SHORT_TIME_CONSTANT, 0)
    found = restoring_force(made, fit, 0, [])
    assert found is not None
    return found


def within(found: RestoringForce) -> float:
    """Share of the bins whose true force is in the band of 95 %."""
    return float(np.mean(np.abs(found.middle - K3 * found.centre**3) < 2.0 * found.deviation))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_with_the_right_law_the_force_is_that_of_the_spring(quantity):
    """Within a twentieth of its peak, of which the noise is a hundredth."""
    found = recovered(quantity, K3)
    assert (found.kind, found.where, found.over) == ("cubic_stiffness", "m2", "deflection")
    true = K3 * found.centre**3
    np.testing.assert_allclose(found.middle, true, atol=0.05 * np.max(np.abs(true)))
    # The deflection that it is shown over, of which the sensors see nothing.
    assert np.max(np.abs(found.x)) == pytest.approx(
        np.max(np.abs(measured("displacement")[:, 1])), rel=0.1
    )


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_with_half_of_the_law_the_force_is_the_whole_one(quantity):
    """All of what lacks, within a tenth; smoothed, it may be a little more as well as less."""
    found = recovered(quantity, 0.5 * K3)
    left, lacking = found.force - 0.5 * K3 * found.x**3, 0.5 * K3 * found.x**3
    assert np.corrcoef(left, lacking)[0, 1] > 0.95
    assert 0.9 < left @ lacking / (lacking @ lacking) < 1.1
    assert within(found) >= 0.85


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_curve_of_a_law_that_nobody_assumed(quantity):
    """Beside a linear spring a millionth as stiff as the model."""
    found = recovered(quantity, 0.1, "stiffness_error")
    true = K3 * found.centre**3
    assert within(found) >= 0.85
    # A band that is wide enough for everything would say nothing.
    assert np.max(found.deviation) < 0.1 * np.max(np.abs(true))
    np.testing.assert_allclose(found.middle, true, atol=0.1 * np.max(np.abs(true)))


def test_of_several_suspects_at_one_place_the_whole_force_is_told():
    """Twice the cubic spring, and another that pulls too much of it back."""
    y = measured("acceleration")
    noise = NOISE * np.std(y, axis=0)
    made, places = problem([y], [measured_force(PEAK)], noise, names=NAMES)
    (row,) = (each.row for each in places if each.label == "m2")
    z = made.map.given()[: made.parameters]
    sizes = {"cubic_stiffness": 2.0 * K3, "stiffness_error": -3e3}
    starts = [
        hypotheses.force(made, kind, "m2", row, z, sizes[kind.name], 1.0)
        for kind in made.predictor.kinds
    ]
    (fit,) = multistart(made, [hypotheses.joined(made, starts)], SHORT_TIME_CONSTANT, 0)
    found = restoring_force(made, fit, 0, [])
    assert found is not None
    assert found.kind == " + ".join(sizes) == next(iter(found.laws))
    assert within(found) >= 0.85
    law = found.laws[found.kind]
    np.testing.assert_allclose(law, 2.0 * K3 * found.centre**3 - 3e3 * found.centre, atol=0.3)


MASSES = 5
CHAIN_M = np.diag([1.0, 1.3, 0.8, 1.1, 0.9])
_LINKS = np.eye(MASSES) - np.eye(MASSES, k=-1)
CHAIN_K = _LINKS.T @ np.diag([6e4, 5e4, 4e4, 5e4, 3e4]) @ _LINKS
CHAIN_C = 1e-5 * CHAIN_K + 0.5 * CHAIN_M
SENSORS, STRUCK, SUSPECT = (1, 4), 2, 3
FREQUENCIES = np.arange(8.0, 120.0, 3.7)


def random_force(t: np.ndarray) -> np.ndarray:
    """A multisine that begins within some samples and never ends, N."""
    phases = 2.0 * np.pi * np.random.default_rng(5).random(len(FREQUENCIES))
    waves = np.sin(2.0 * np.pi * np.multiply.outer(t, FREQUENCIES) + phases)
    return 4.0 * np.tanh(40.0 * t) * np.sum(waves, axis=-1)


def chain(excitation: str) -> RestoringForce:
    """Five masses, two accelerometers; a cubic spring to the ground where neither is."""
    inverse = np.linalg.inv(CHAIN_M)
    push = {
        "hit": lambda t: hit(t, 150.0),
        "random": random_force,
        "decay": lambda t: 0.0 * t,
    }[excitation]

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        u, v = np.split(z, 2)
        force = -CHAIN_K @ u - CHAIN_C @ v
        force[STRUCK] += push(np.asarray(t))
        force[SUSPECT] -= K3 * u[SUSPECT] ** 3
        return np.concatenate([v, inverse @ force])

    start = np.zeros(2 * MASSES)
    if excitation == "decay":
        start[:MASSES] = 8e-4 * np.array([0.3, 0.5, 0.8, 1.0, 1.1])
    y = integrated(rate, start, "acceleration")[:, SENSORS]
    noise = 1e-3 * np.std(y, axis=0)
    y = y + noise * np.random.default_rng(1).standard_normal(y.shape)
    force = push(np.arange(N) / RATE)[:, None] if excitation != "decay" else None

    (kind,) = (each for each in CATALOGUE["stiffness_error"] if isinstance(each, ForceKind))
    structure = ij.JointedStructure(ij.LinearStructure(CHAIN_M, CHAIN_C, CHAIN_K), {})
    eye = jnp.eye(MASSES)
    by, modal = predictor(
        structure, eye[STRUCK][None], eye[jnp.array(SENSORS)], RATE, "acceleration", (kind,), 2
    )
    assert by.kept == MASSES > len(SENSORS)
    recordings = [StudyRecording("rec", y, force)]
    data = conditioned(recordings, by, modal, noise, N, 1, directions_of(recordings, by)).data
    made = HistoryProblem(by, (), data, noise, (0,))
    return beside(made, "stiffness_error", np.asarray(modal.Phi)[SUSPECT], 0.1)


@pytest.mark.parametrize("excitation", ["hit", "random", "decay"])
def test_in_a_chain_with_fewer_sensors_than_modes(excitation):
    """The curve of a law that nobody assumed, where no sensor is."""
    found = chain(excitation)
    true = K3 * found.centre**3
    assert within(found) >= 0.85
    assert np.corrcoef(found.force, K3 * found.x**3)[0, 1] > 0.9
    assert np.sqrt(np.mean((found.middle - true) ** 2)) < 0.15 * np.max(np.abs(true))
