"""Predictions, observers and what they are made of, against other ways to the same numbers."""

import math
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import iwanjax as ij
from iwanjax.discrepancy import CATALOGUE
from iwanjax.dynamics.parabolic_hold import hold
from iwanjax.effects.sensor_delay import DELAY, DELAY_NODES
from iwanjax.identification import columns as trials
from iwanjax.identification import hypotheses
from iwanjax.identification.columns import columns_at_rest
from iwanjax.identification.conditioning import (
    conditioned,
    upsampled,
    upsampled_between_ends,
)
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.linearise import innovations, linearise, residuals_at
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, multistart
from iwanjax.identification.observer import (
    observer_gain,
    process_noise,
    state_at_beginning,
    stepped,
)
from iwanjax.identification.places import followed, places_of
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.identification.recordings import StudyRecording, cleaned, common_noise
from iwanjax.signals.comparison_band import in_band

RATE, N = 1024.0, 600
ROWS = {"m1": np.array([1.0, 0.0]), "J1": np.array([-1.0, 1.0])}
K = np.array([[1.5e5, -6e4], [-6e4, 6e4]])
# One set of kernels serves all tests of one quantity and number of steps.
KINDS = (
    "cubic_stiffness",
    "mass_error",
    "gap_contact",
    "coulomb_friction",
    "viscoelastic",
    "viscous_damping",
)
RNG = np.random.default_rng(3)


def structure(stiffer=1.0, damper=0.0):
    """The masses, with a damper between them."""
    damping = 2e-5 * K + 0.1 * np.eye(2) + damper * np.outer(ROWS["J1"], ROWS["J1"])
    linear = ij.LinearStructure(np.diag([1.0, 1.5]), damping, stiffer * K)
    joint = ij.Iwan4(F_S=6.0, K_T=stiffer * 3e4, chi=-0.5, beta=1.5)
    return ij.JointedStructure(linear, {"J1": (ROWS["J1"], joint)})


def pulse():
    t = np.arange(N) / RATE
    width = 0.012
    force = np.zeros((N, 1))
    force[:, 0] = 60.0 * np.sin(np.pi * (t - 0.04) / width) ** 2 * ((t > 0.04) & (t < 0.04 + width))
    return force


def problem(response, substeps, quantity="acceleration", force=None, stiffer=1.0):
    kinds = tuple(CATALOGUE[name][0] for name in KINDS)
    model = structure(stiffer)
    made, modal = predictor(
        model, jnp.array([[1.0, 0.0]]), jnp.eye(2), RATE, quantity, kinds, substeps
    )
    recording = StudyRecording("rec", response, pulse() if force is None else force)
    seen = conditioned([recording], made, modal, np.array([0.01, 0.01]), N, 1, 6)
    joints = tuple(Joint(joint, jnp.ones(4)) for joint in model.elements)
    return HistoryProblem(made, joints, seen.data, np.array([0.01, 0.01]), (0,)), np.asarray(
        modal.Phi
    )


def test_the_state_of_a_free_decay_is_estimated_from_what_follows():
    """Of a linear structure by the matrix exponential; joints that are softer are little worse."""
    at = jnp.asarray(np.eye(2))
    for stiffer, tolerance in ((1.0, 0.01), (0.95, 0.2)):
        model = structure(stiffer)
        made, modal = predictor(model, at, at, RATE, "acceleration", (), 2)
        right = predictor(structure(), at, at, RATE, "acceleration", (), 2)[0]
        A, H = right.linear(np.asarray(right.stiffness), right.blank(), np.zeros(1))
        state = np.array([2e-3, -4e-4, 0.05, 0.2])
        step, seen = scipy.linalg.expm(A / RATE), []
        for _ in range(N):
            seen.append(H @ state)
            state = step @ state
        response = np.array(seen) + 1e-3 * RNG.standard_normal((N, 2))
        still = np.zeros((len(response), made.substeps, 3 * made.kept))
        z, off = state_at_beginning(made, response, np.full(2, 1e-3), still)
        shapes = np.asarray(right.sensors), np.asarray(made.sensors)
        size = np.sqrt(np.asarray(right.omega2))
        wanted = shapes[0] @ np.array([2e-3, -4e-4]), shapes[0] @ np.array([0.05, 0.2])
        q, v = shapes[1] @ z[:2], shapes[1] @ z[2:]
        assert np.max(np.abs(q - wanted[0])) < tolerance * np.max(np.abs(wanted[0]))
        assert np.max(np.abs(v - wanted[1])) < tolerance * np.max(size) * 2e-3
        assert np.all(np.diag(off) > 0)
        decay = conditioned(
            [StudyRecording("rec", response, None)], made, modal, np.full(2, 1e-3), N, 1, 6
        )
        assert np.asarray(decay.data.kick)[0].argmax() == 0
        np.testing.assert_array_equal(np.asarray(decay.data.push)[0, 0, -1, :4], z)


def predicted(made, hypothesis=None, theta=None, time_constant=math.inf):
    """What a free run leaves of zeros: the prediction itself, with its sign."""
    hypothesis = made.nothing() if hypothesis is None else hypothesis
    theta = np.zeros(6) if theta is None else theta
    found = linearise(made, [(hypothesis, made.still(theta))], time_constant)[0]
    weight = np.asarray(made.data.weight)
    return np.where(weight > 0, found.residual / np.where(weight > 0, weight, 1.0), 0.0)[0]


@pytest.mark.parametrize("coupled", [False, True], ids=["by mode", "coupled"])
def test_a_step_under_a_parabola_is_that_of_an_ode_solver(coupled):
    omega2, dt = np.array([900.0, 4e5]), 2e-3
    C = np.array([[2.0, 0.7], [0.7, 30.0]]) if coupled else np.array([2.0, 30.0])
    p = RNG.standard_normal((3, 2))
    q_0, v_0 = RNG.standard_normal(2), 30.0 * RNG.standard_normal(2)
    matrix = C if coupled else np.diag(C)

    def rate(t, z):
        s = t / dt
        return np.concatenate(
            [z[2:], p[0] + p[1] * s + p[2] * s**2 - matrix @ z[2:] - omega2 * z[:2]]
        )

    true = scipy.integrate.solve_ivp(rate, (0, dt), [*q_0, *v_0], rtol=1e-11, atol=1e-13).y[:, -1]
    by = hold(omega2, C, dt)
    q, v = by.free(jnp.asarray(q_0), jnp.asarray(v_0))
    more_q, more_v = by.pushed(tuple(jnp.asarray(x) for x in p))
    np.testing.assert_allclose(np.concatenate([q + more_q, v + more_v]), true, rtol=1e-8)


def test_the_gain_is_the_riccati_equations():
    A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-900, 100, -2, 0], [100, -4e3, 0, -3]], float)
    H = np.array([[-900.0, 100.0, -2.0, 0.0]]) / 0.3
    step = stepped(A, 1e-3)
    Q = 0.7 * np.diag([0, 0, 1e-3, 1e-3])
    P = scipy.linalg.solve_discrete_are(step.T, H.T, Q, np.eye(1))
    true = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(1))
    np.testing.assert_allclose(observer_gain(step, H, 1e-3, 0.7), true, rtol=1e-6)
    both = observer_gain(np.stack([step, step]), np.stack([H, 2 * H]), 1e-3, 0.7)
    np.testing.assert_allclose(both[0], true, rtol=1e-6)
    assert not np.any(observer_gain(step, H, 1e-3, 0.0))


def test_a_system_without_a_gain_leaves_the_others_theirs():
    made, _ = problem(np.ones((N, 2)), 1)
    A, H = made.rest()
    dt = float(made.predictor.dt)
    step = stepped(A, dt)
    alone = observer_gain(step, H / 0.01, dt, 1.0)
    steps = np.stack([step, 1e200 * step, step, np.nan * step])
    together = observer_gain(steps, np.stack([H / 0.01] * 4), dt, 1.0)
    np.testing.assert_allclose(together[::2], np.stack([alone] * 2), rtol=1e-9)
    assert np.all(np.isnan(together[1::2]))


@pytest.mark.parametrize("time_constant", [2.0, 30.0])
def test_the_observers_median_pole_dies_within_the_memory(time_constant):
    A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-900, 100, -0.1, 0], [100, -4e3, 0, -0.2]], float)
    H = np.eye(2, 4)
    step = stepped(A, 1e-3)
    gain = observer_gain(step, H, 1e-3, process_noise(step, H, 1e-3, time_constant))
    poles = np.linalg.eigvals((np.eye(4) - gain @ H) @ step)
    decay = -np.log(np.abs(poles)) / np.abs(np.angle(poles)) * 2 * np.pi
    assert np.median(decay) == pytest.approx(1.0 / time_constant, rel=1e-3)
    assert process_noise(step, H, 1e-3, math.inf) == 0.0


@pytest.mark.parametrize(
    "quantity",
    [
        "acceleration",
        *(pytest.param(other, marks=pytest.mark.long) for other in ("velocity", "displacement")),
    ],
)
def test_a_free_run_is_what_the_implicit_integrator_gives(quantity):
    made, _ = problem(np.ones((N, 2)), 4, quantity)
    shown = 1.0 - predicted(made)
    fine = 16
    t = np.arange(N * fine) / (RATE * fine)
    width = 0.012
    smooth = 60.0 * np.sin(np.pi * (t - 0.04) / width) ** 2 * ((t > 0.04) & (t < 0.04 + width))
    true = ij.simulate(
        structure(), smooth[:, None], 1.0 / (RATE * fine), inputs=[[1.0, 0.0]], sliders=None
    )
    expected = np.asarray(in_band(getattr(true, quantity)[::fine]))
    used = np.asarray(made.data.weight)[0] > 0
    off = np.where(used, shown - expected, 0.0)
    assert np.sqrt(np.mean(off**2)) < 2e-3 * np.sqrt(np.mean(expected**2))


@pytest.mark.parametrize("damper", [20.0, 5e3])
def test_a_damper_however_strong_is_that_of_the_structure(damper):
    """Over 2400 it stops a mass within a step: what it does to itself has to be solved for."""
    made, Phi = problem(np.ones((N, 2)), 4)
    kind = CATALOGUE["viscous_damping"][0]
    start = hypotheses.force(made, kind, "J1", ROWS["J1"] @ Phi, np.zeros(4), damper, 1.0)
    shown = 1.0 - predicted(made, start.hypothesis, start.theta)
    fine = 16
    t = np.arange(N * fine) / (RATE * fine)
    width = 0.012
    smooth = 60.0 * np.sin(np.pi * (t - 0.04) / width) ** 2 * ((t > 0.04) & (t < 0.04 + width))
    true = ij.simulate(
        structure(damper=damper), smooth[:, None], t[1], inputs=[[1.0, 0.0]], sliders=None
    )
    expected = np.asarray(in_band(true.acceleration[::fine]))
    used = np.asarray(made.data.weight)[0] > 0
    off = np.where(used, shown - expected, 0.0)
    assert np.sqrt(np.mean(off**2)) < 2e-3 * np.sqrt(np.mean(expected**2))


def test_derivatives_are_those_of_finite_differences():
    made, Phi = problem(RNG.standard_normal((N, 2)), 2)
    made = replace(made, noise=np.array([0.5, 0.5]))
    kind = made.predictor.kinds[0]
    start = hypotheses.force(made, kind, "m1", ROWS["m1"] @ Phi, np.zeros(4), 3e9, 1.0)
    theta = start.theta + np.array([0.1, -0.2, 0.1, 0.3, 0.0, 0.0])
    for time_constant in (2.0, math.inf):
        found = linearise(made, [(start.hypothesis, made.still(theta))], time_constant)[0]
        for value in (0, 1, 2, 3, 4, 7):
            costs = []
            for sign in (1.0, -1.0):
                moved = made.still(theta)
                moved[:, value] += sign * 1e-4
                costs.append(
                    linearise(made, [(start.hypothesis, moved)], time_constant)[0].misfit.sum()
                )
            slope = (costs[0] - costs[1]) / 2e-4
            scale = math.sqrt(found.misfit.sum() * found.normal[0, value, value])
            assert slope == pytest.approx(2.0 * found.moment[0, value], abs=2e-4 * scale)


@pytest.mark.parametrize(
    ("time_constant", "forces", "sensor_faults", "acting"),
    [
        # Kinds that the observer's gain does not depend on: it is redesigned for the others.
        pytest.param(
            SHORT_TIME_CONSTANT,
            ("cubic_stiffness", "gap_contact", "coulomb_friction"),
            ("sensor_delay",),
            True,
            marks=pytest.mark.long,
        ),
        (math.inf, ("viscoelastic", "mass_error", "viscous_damping"), ("sensor_gain",), False),
    ],
    ids=["short memory, beside another", "free run, alone"],
)
def test_a_little_of_a_suspect_changes_what_the_linearised_model_says(
    time_constant, forces, sensor_faults, acting
):
    free, _ = problem(np.ones((N, 2)), 2)
    shown = np.where(np.asarray(free.data.weight)[0] > 0, 1.0 - predicted(free), 0.0)
    made, Phi = problem(1.1 * shown + 1e-3 * np.random.default_rng(5).standard_normal((N, 2)), 2)
    start = Start(made.nothing(), np.array([0.2, -0.3, 0.1, 0.4, 0.0, 0.0]))
    if acting:
        other = CATALOGUE[forces[0]][0]
        start = hypotheses.force(made, other, "m1", ROWS["m1"] @ Phi, start.theta[:4], 50.0, 1e-4)
    base = multistart(made, [start], time_constant, 0)[0]
    before = linearise(made, [(start.hypothesis, base.theta)], time_constant)[0].residual
    places = places_of(made, followed(made), {name: row @ Phi for name, row in ROWS.items()})
    kinds = tuple(CATALOGUE[name][0] for name in (*forces, *sensor_faults))
    z = base.theta.mean(axis=0)[:4]
    found = [
        *trials.unit_effects(made, base, kinds, places),
        *trials.sensor_faults(made, kinds, ("a1", "a2"), z),
    ]
    assert {(each.kind.name, each.where) for each in found} == {
        *((kind, place) for kind in forces for place in ROWS),
        *((kind, sensor) for kind in sensor_faults for sensor in ("a1", "a2")),
    }
    for each, column in zip(found, trials.columns(made, base, found), strict=True):
        size = 1e-4 * np.linalg.norm(before) / np.linalg.norm(column)
        little = each.sized(size)
        little = hypotheses.joined(made, [start, little]) if acting else little
        after = linearise(made, [(little.hypothesis, made.still(little.theta))], time_constant)[0]
        change = (after.residual - before) / size
        assert np.linalg.norm(change - column) < 2e-3 * np.linalg.norm(column)


def test_without_kinds_or_places_nothing_is_tried():
    made, Phi = problem(0.5 * np.ones((N, 2)), 2)
    base = multistart(made, [Start(made.nothing(), np.zeros(6))], math.inf, 0)[0]
    places = places_of(made, followed(made), {"m1": ROWS["m1"] @ Phi})
    assert trials.unit_effects(made, base, (CATALOGUE["stiction"][0],), places) == []
    assert trials.unit_effects(made, base, made.predictor.kinds, ()) == []
    assert trials.sensor_faults(made, made.predictor.kinds, ("a1", "a2"), np.zeros(4)) == []
    assert trials.columns(made, base, []).shape == (0, 1, N, 2)


@pytest.mark.parametrize(
    ("quantity", "substeps"),
    [("acceleration", 2), pytest.param("velocity", 4, marks=pytest.mark.long)],
)
def test_where_no_joint_slips_responses_are_convolutions(quantity, substeps):
    made, Phi = problem(np.ones((N, 2)), substeps, quantity=quantity)
    # As stiff as ever, and so strong that it never slips.
    strong = ij.Iwan4(F_S=6e9, K_T=3e4, chi=-0.5, beta=1.5)
    made = replace(made, joints=(Joint(strong, jnp.ones(4)),))
    base = multistart(made, [Start(made.nothing(), np.zeros(6))], SHORT_TIME_CONSTANT, 0)[0]
    places = places_of(made, followed(made), {name: row @ Phi for name, row in ROWS.items()})
    forces = trials.unit_effects(made, base, made.predictor.kinds[:1], places)
    exact = trials.columns(made, base, forces).reshape(len(forces), -1)
    told = 0
    for which, found in columns_at_rest(made, base, forces):
        told += len(which)
        off = np.linalg.norm(found - exact[which], axis=1)
        assert np.all(off < 0.01 * np.linalg.norm(exact[which], axis=1))
    assert told == len(forces) > 0


def test_a_pair_is_taken_apart_into_what_it_was_joined_of():
    made, Phi = problem(np.ones((N, 2)), 2)
    cubic = made.predictor.kinds[0]
    one = hypotheses.force(made, cubic, "m1", ROWS["m1"] @ Phi, np.full(4, 0.3), -2e9, 1.0)
    two = hypotheses.sensor(made, CATALOGUE["sensor_gain"][0], 1, "a2", np.full(4, 0.3), 0.2)
    pair = hypotheses.joined(made, [one, two])
    for slot, start in enumerate((one, two)):
        again = hypotheses.alone(made, pair, slot)
        assert again.hypothesis.label == start.hypothesis.label
        np.testing.assert_array_equal(again.theta, start.theta)
        (a, b) = linearise(
            made, [(x.hypothesis, made.still(x.theta)) for x in (again, start)], math.inf
        )
        np.testing.assert_array_equal(a.residual, b.residual)


# Hz of 400 a second, and what the last samples may be off by: what is compared ends at 140.
@pytest.mark.parametrize(("f", "off"), [(12.0, 0.02), (60.0, 0.03), (110.0, 0.1)])
def test_a_small_delay_shows_what_was_a_little_earlier(f, off):
    t = np.arange(400) / 400.0
    shown = np.sin(2.0 * np.pi * f * t)[None, :, None] * np.ones((2, 1, 3))
    slope = DELAY.slope(shown)
    assert slope is not None
    expected = -2.0 * np.pi * f / 400.0 * np.cos(2.0 * np.pi * f * t)
    late = slope[1, DELAY_NODES:, 2] - expected[DELAY_NODES:]
    assert np.max(np.abs(late)) < off * np.max(np.abs(expected))


@pytest.mark.parametrize("late", [0.0, 0.3, 1.25, 2.0, 3.9])
@pytest.mark.parametrize(("share", "off"), [(0.05, 2e-4), (0.15, 3e-3), (0.25, 1e-2), (0.3, 0.03)])
def test_a_delayed_sensor_shows_all_that_is_compared_later(late, share, off):
    weight = DELAY.set_up(jnp.array([0.0, late]))
    phases = np.exp(-2j * np.pi * share * np.arange(DELAY_NODES))
    assert abs(np.asarray(weight)[:, 0] @ phases - 1.0) < 1e-12
    assert abs(np.asarray(weight)[:, 1] @ phases - np.exp(-2j * np.pi * share * late)) < off


def test_mass_at_a_place_is_mass_in_the_model():
    made, Phi = problem(np.ones((N, 2)), 4)
    kind = made.predictor.kinds[1]
    start = hypotheses.force(made, kind, "m1", ROWS["m1"] @ Phi, np.zeros(4), 0.3, 1.0)
    shown = 1.0 - predicted(made, start.hypothesis, start.theta)
    heavier = structure()
    linear = heavier.structure
    linear = ij.LinearStructure(np.asarray(linear.M) + np.diag([0.3, 0.0]), linear.C, linear.K)
    true = ij.simulate(
        ij.JointedStructure(linear, {"J1": (ROWS["J1"], heavier.elements[0])}),
        np.repeat(pulse(), 1, axis=0),
        1.0 / RATE,
        inputs=[[1.0, 0.0]],
        sliders=None,
        substeps=16,
    )
    expected = np.asarray(true.acceleration)
    used = np.asarray(made.data.weight)[0] > 0
    off = np.where(used, shown - expected, 0.0)
    # The reference follows the force on straight lines, which loses some of its pulse.
    assert np.sqrt(np.mean(off**2)) < 0.02 * np.sqrt(np.mean(expected**2))


def test_sensors_faults_act_on_what_is_shown():
    made, _ = problem(np.ones((N, 2)), 2)
    plain = 1.0 - predicted(made)

    def shown(name, size):
        start = hypotheses.sensor(made, CATALOGUE[name][0], 1, "a2", np.zeros(4), size)
        return 1.0 - predicted(made, start.hypothesis, start.theta)

    used = slice(20, -20)
    louder = shown("sensor_gain", 0.2)
    np.testing.assert_allclose(louder[used, 1], 1.2 * plain[used, 1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(louder[:, 0], plain[:, 0], rtol=1e-9, atol=1e-12)
    turned = shown("sensor_polarity", 0.0)
    np.testing.assert_allclose(turned[used, 1], -plain[used, 1], rtol=1e-9, atol=1e-12)
    late = shown("sensor_delay", 2.0)
    # The samples' weights count a little themselves.
    largest = np.max(np.abs(plain))
    np.testing.assert_allclose(late[used, 1], plain[18:-22, 1], rtol=0.0, atol=1e-6 * largest)
    cut = shown("sensor_saturation", 5.0)
    # Cut first, then compared in its band.
    nothing = innovations(made, made.nothing(), made.still(np.zeros(6)), math.inf)[0]
    limited = np.asarray(in_band(jnp.clip(1.0 - nothing[:, 1:], -5, 5)))[:, 0]
    np.testing.assert_allclose(cut[used, 1], limited[used], atol=1e-9)


def test_a_pulse_is_told_from_noise_and_the_ends():
    random = np.random.default_rng(3)
    force = 1e-2 * random.standard_normal((N, 1)) + pulse()
    force[-3:] = 1.0
    force[300] = 0.2
    found = cleaned(force)
    acting = np.flatnonzero(found.clean[:, 0])
    assert acting[0] >= 36
    assert acting[-1] <= 60
    # Three deviations of a median absolute deviation over the last quarter.
    assert found.noise[0] == pytest.approx(1e-2, rel=3.0 * 1.17 / math.sqrt(N / 4))
    assert np.array_equal(found.clean[40:50], force[40:50])
    shaken = random.standard_normal((N, 1))
    assert np.array_equal(cleaned(shaken).clean, shaken)


def test_odd_pulses_are_warned_of():
    made, modal = predictor(
        structure(),
        jnp.array([[1.0, 0.0]]),
        jnp.eye(2),
        RATE,
        "acceleration",
        (CATALOGUE["cubic_stiffness"][0],),
        2,
    )
    clipped, short = np.minimum(pulse(), 40.0), np.zeros((N, 1))
    short[50:53] = [[20.0], [40.0], [20.0]]
    for force, word in ((clipped, "clipped"), (short, "3 samples"), (pulse(), "")):
        recording = StudyRecording("rec", RNG.standard_normal((N, 2)), force)
        warnings = conditioned([recording], made, modal, np.full(2, np.nan), N, 1, 6).warnings
        assert (word in warnings[0]) if word else not warnings


def test_where_macroslip_begins_nothing_jumps():
    # A short blow and coarse steps: a step ends far off its forecast, at times beyond macroslip.
    force = np.zeros((N, 1))
    force[39:42, 0] = 15.0, 30.0, 15.0
    made, _ = problem(np.ones((N, 2)), 1, force=force, stiffer=20.0)
    strengths = np.linspace(-0.3, 0.3, 301)
    lanes = [(made.nothing(), made.still(np.array([F_S, 0, 0, 2.0, 0, 0]))) for F_S in strengths]
    found = np.stack(residuals_at(made, lanes, math.inf))
    steps = np.sqrt(np.sum(np.diff(found, axis=0) ** 2, axis=(1, 2, 3)))
    assert np.max(steps) < 2.0 * np.median(steps)


def quiet(deviation, before, sensors=2):
    """A recording of noise before a blow."""
    response = deviation * RNG.standard_normal((N, sensors))
    force = np.zeros((N, 1))
    force[before : before + 10] = 1.0
    response[before:] += 50.0 * np.exp(-np.arange(N - before) / 50.0)[:, None]
    return StudyRecording("rec", response, force)


def test_noise_is_that_of_all_recordings():
    short = [quiet(0.3, 50) for _ in range(40)]
    found = common_noise(short)
    np.testing.assert_allclose(found.deviation, 0.3, rtol=0.05)
    # One record of noise in a hundred shows a line by chance, which is three values.
    assert np.all(np.abs(found.freedom - (40 * (50 - 16 - 1) - 6)) <= 6)
    # Nothing before the blow tells nothing, and takes nothing from the others.
    more = common_noise([*short, quiet(5.0, 10)])
    np.testing.assert_allclose(more.deviation, found.deviation)
    assert np.all(np.isnan(common_noise([quiet(0.3, 10)]).deviation))


def test_noise_of_another_range_is_its_own():
    assert np.all(np.isnan(common_noise([quiet(0.3, 200), quiet(3.0, 200)]).deviation))


def test_a_force_that_goes_on_is_not_kicked_where_its_recording_is_cut():
    """A multisine, known between samples; as a cycle it would jump by its own size."""
    f = np.arange(20.0, 300.0, 7.3)
    phase = 2 * np.pi * np.random.default_rng(11).random(f.size)

    def force(t):
        return np.cos(2 * np.pi * np.outer(t, f) + phase) @ np.ones(f.size)

    t, times = np.arange(N) / RATE, 8
    fine = np.arange((N - 1) * times + 1) / (RATE * times)
    off = {
        name: (function(force(t)[:, None], times)[: len(fine), 0] - force(fine))[160:-160]
        for name, function in (("cycle", upsampled), ("cut", upsampled_between_ends))
    }
    size = np.std(force(t))
    assert np.max(np.abs(off["cut"])) < 1e-3 * size
    assert np.max(np.abs(off["cycle"])) > 10.0 * np.max(np.abs(off["cut"]))
