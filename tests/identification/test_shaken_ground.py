"""Structures on a shaken ground, against masses integrated in absolute coordinates by SciPy."""

import math

import jax.numpy as jnp
import numpy as np
import scipy.integrate
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.discrepancy import CATALOGUE
from iwanjax.identification import hypotheses
from iwanjax.identification.columns import columns, force_faults
from iwanjax.identification.conditioning import conditioned, directions_of
from iwanjax.identification.linearise import innovations, residuals_at
from iwanjax.identification.multistart import multistart
from iwanjax.identification.places import followed
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.identification.recordings import StudyRecording, cleaned

RATE, N = 512.0, 400
T = np.arange(N) / RATE
M = np.array([1.0, 1.5, 0.2])
# m1 on the ground, m2 on m1, and m3 so stiff on m2 that its mode is left out.
K = np.array([[1.5e5, -6e4, 0.0], [-6e4, 6e4 + 1.1e6, -1.1e6], [0.0, -1.1e6, 1.1e6]])
C = 2e-5 * K
SENSORS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 1.0]])
AT, WIDTH, PEAK = 0.1, 5e-3, 20.0
MASS_KIND = CATALOGUE["mass_error"][0]


def ground(t):
    """Acceleration and displacement of the ground: a bump and its second derivative."""
    s = (t - AT) / WIDTH
    bump = np.exp(-0.5 * s**2)
    return -PEAK * (1.0 - s**2) * bump, PEAK * WIDTH**2 * bump


def felt(added=0.0):
    """Absolute accelerations of the sensors, and displacements relative to the ground."""
    masses, ones = M + added * np.array([0.0, 1.0, 0.0]), np.ones(3)

    def acceleration(t, z):
        _, x = ground(t)
        h = 1e-6
        v = (ground(t + h)[1] - ground(t - h)[1]) / (2.0 * h)
        return (-K @ (z[:3] - ones * x) - C @ (z[3:] - ones * v)) / masses

    found = scipy.integrate.solve_ivp(
        lambda t, z: np.concatenate([z[3:], acceleration(t, z)]),
        (0.0, T[-1]),
        np.zeros(6),
        method="LSODA",
        t_eval=T,
        rtol=1e-9,
        atol=1e-13,
        max_step=1e-3,
    ).y
    absolute = np.stack([acceleration(t, z) for t, z in zip(T, found.T, strict=True)])
    relative = found[:3].T - ground(T)[1][:, None]
    return absolute @ SENSORS.T, relative @ SENSORS.T


def problem(response, quantity="acceleration", first=0, **options):
    structure = ij.JointedStructure(ij.LinearStructure(np.diag(M), C, K), {})
    inputs = np.array([[1.0, 0.0, 0.0], -M])
    made, modal = predictor(
        structure,
        jnp.asarray(inputs),
        jnp.asarray(SENSORS),
        RATE,
        quantity,
        (MASS_KIND,),
        2,
        base=1,
    )
    assert made.left.number == 1
    force = np.stack([np.zeros(N), ground(T)[0]], axis=1)[first:]
    recording = StudyRecording("rec", response[first:], force, **options)
    noise = np.full(3, 1e-3 * np.std(response))
    states = directions_of([recording], made)
    seen = conditioned([recording], made, modal, noise, N - first, 1, states)
    return HistoryProblem(made, (), seen.data, noise, (0,), forces=seen.forces), modal


def off(found, start=None):
    """What the free run leaves of the recording, as share of it."""
    hypothesis, theta = (found.nothing(), found.map.given()) if start is None else start
    left = innovations(found, hypothesis, found.still(theta), math.inf)[0]
    response = np.asarray(found.data.response)[0]
    return np.sqrt(np.mean(left**2, axis=0) / np.mean(response**2, axis=0))


def test_accelerometers_follow_the_absolute_motion():
    found, _ = problem(felt()[0])
    assert np.all(off(found) < 1e-3)


def test_displacements_are_relative_to_the_ground():
    found, _ = problem(felt()[1], "displacement")
    assert np.all(off(found) < 1e-3)


def test_the_ground_moves_a_mass_that_was_left_out():
    """Its inertia is that of the absolute acceleration, which the place's own does not know."""
    added = 0.15
    found, modal = problem(felt(added)[0])
    row = np.array([0.0, 1.0, 0.0]) @ np.asarray(modal.Phi)
    start = hypotheses.force(found, MASS_KIND, "m2", row, np.zeros(0), added, 1.0)
    assert np.all(off(found, start) < 2e-3)
    assert np.all(off(found) > 0.05)


def test_an_observer_knows_the_ground_at_once():
    response, relative = felt()
    found, modal = problem(response)
    q = np.asarray(followed(found).q)[0]
    seen = q @ np.asarray(modal.Y)[:, :2].T
    assert_allclose(seen, relative, atol=0.01 * np.abs(relative).max())


def test_the_state_amid_a_shock_is_estimated_from_absolute_accelerations():
    found, _ = problem(felt()[0], first=int(RATE * AT) + 1, initial="unknown")
    assert np.all(off(found) < 0.02)


def test_nothing_is_cut_off_an_earthquake_that_dies_away():
    """Its last quarter is weak, but no noise; after a shock there is noise alone."""
    random = np.random.default_rng(5)
    waves = random.standard_normal(4000) * np.exp(-np.arange(4000) / 900.0)
    found = cleaned(waves[:, None])
    assert found.endless
    assert_allclose(found.clean[:, 0], waves)
    shock = 30.0 * np.exp(-0.5 * ((np.arange(4000) - 300) / 8.0) ** 2)
    assert not cleaned((shock + 0.01 * random.standard_normal(4000))[:, None]).endless


def test_a_fault_of_the_ground_s_own_sensor_is_seen_by_what_the_ground_carries():
    """Accelerometers follow the ground at once, so that most of its fault is in that."""
    found, _ = problem(felt()[0])
    base = multistart(found, [Start(found.nothing(), found.map.given())], math.inf, 0)[0]
    kinds = tuple(CATALOGUE[name][0] for name in ("force_gain", "force_delay"))
    effects = force_faults(found, kinds, ("m1", "base"), np.zeros(0))
    assert [(each.kind.name, each.where) for each in effects] == [
        (kind.name, "base") for kind in kinds
    ]
    (before,) = residuals_at(found, [(base.hypothesis, base.theta)], math.inf)
    for unit, column in zip(effects, columns(found, base, effects), strict=True):
        start = unit.sized(1e-3)
        little = start.hypothesis, found.still(start.theta)
        change = (residuals_at(found, [little], math.inf)[0] - before) / 1e-3
        assert np.linalg.norm(change - column) < 0.05 * np.linalg.norm(change)
