"""Elements in motion: what must hold along every history, and for each by itself."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.interpolate
from hypothesis import given
from hypothesis import strategies as st
from oracles import drive_sliders

import iwanjax as ij
from iwanjax.joints import JOINTS, SliderBank, UnnamedLaw
from iwanjax.joints.unnamed_terms import TERMS

SLIDERS = 30
STEPS = 12
# Deflections in thousandths of a unit of which no threshold is a simple multiple: on a threshold
# itself round-off decides whether a slider with theta < 1 lets go.
UNIT = 0.9876543210987654
HISTORY = st.lists(st.integers(-2000, 2000), min_size=STEPS, max_size=STEPS).map(
    lambda d: UNIT * np.array(d) / 1000.0
)
CHI = st.one_of(st.floats(-1 + 1e-3, 1.0), st.sampled_from([-1 + 1e-6, 0.0]))
BETA = st.one_of(st.just(0.0), st.floats(1e-3, 1e3))


def scaled(kind, **parameters):
    """An Iwan element of phi_max = 1 and K_T = 1."""
    trial = kind(F_S=1.0, K_T=1.0, **parameters)
    return kind(F_S=1.0 / float(trial.phi_max), K_T=1.0, **parameters)


IWAN4 = st.builds(lambda chi, beta: scaled(ij.Iwan4, chi=chi, beta=beta), CHI, BETA)
IWAN5 = st.builds(
    lambda chi, beta, theta: scaled(ij.Iwan5, chi=chi, beta=beta, theta=theta),
    CHI,
    BETA,
    st.floats(0.01, 1.0),
)
JENKINS = st.builds(lambda F_S: ij.Jenkins(F_S=F_S, K_T=1.0), st.floats(0.01, 2.0))
MASING = st.one_of(IWAN4, JENKINS)
SLIDING = st.one_of(IWAN4, IWAN5, JENKINS)
POSITIVE = st.floats(-2.0, 2.0).map(lambda x: 10.0**x)
ODD = st.one_of(
    SLIDING,
    st.builds(ij.LinearSpring, k=POSITIVE),
    st.builds(ij.CubicSpring, k3=POSITIVE),
    st.builds(ij.Gap, k=POSITIVE, gap=POSITIVE),
    st.builds(ij.Dashpot, c=POSITIVE),
    st.builds(ij.QuadraticDrag, c=POSITIVE),
    st.builds(ij.Maxwell, k=POSITIVE, c=POSITIVE),
)
ANY = st.one_of(
    ODD,
    st.builds(ij.QuadraticSpring, k2=POSITIVE),
    st.builds(ij.BilinearSpring, dk=POSITIVE),
    st.builds(ij.Gap, k=POSITIVE, gap=POSITIVE, sides=st.sampled_from(["positive", "negative"])),
    st.just(ij.Tabulated(d=[-1.0, 0.0, 0.4], force=[-2.0, 0.0, 0.3])),
)


@eqx.filter_jit
def _driven(element, d, v, dt):
    def advance(state, ends):
        reaction = element.step(*ends, dt, state)
        return reaction.state, (reaction, element.energy(ends[0], reaction.state))

    return jax.lax.scan(advance, element.init(), (d, v))[1]


def element_of(joint):
    """The element in motion; a five-parameter one as a bank (see test_fronts for its own)."""
    is_five = isinstance(joint, ij.Iwan5)
    return joint.slider_bank(SLIDERS) if is_five else joint.discrete(SLIDERS)


def kinetic_share(bank):
    """Kinetic over static friction of a bank."""
    return 1.0 if bank.theta is None else float(bank.theta[0])


def driven(joint, d, dt=0.1):
    """Reactions and stored energies along a history, with mean rates."""
    d = np.asarray(d, float)
    element = joint if isinstance(joint, SliderBank) else element_of(joint)
    return _driven(element, d, np.diff(d, prepend=0.0) / dt, jnp.asarray(dt))


@given(MASING, HISTORY, st.floats(0.0, 1.0))
def test_a_closed_loop_inside_a_bigger_one_is_forgotten(joint, history, share):
    """Masing's second rule: from b to c between a and b, and back to b; then on to a."""
    *before, a, b = history
    c = b + share * (a - b)
    with_loop, _ = driven(joint, [*before[:-3], a, b, c, b, a])
    without, _ = driven(joint, [*before[:-3], a, b, b, b, a])
    for i in (-2, -1):
        np.testing.assert_allclose(with_loop.force[i], without.force[i], atol=1e-13)
        np.testing.assert_allclose(with_loop.state.stretch[i], without.state.stretch[i], atol=1e-14)


@given(ANY, HISTORY, st.floats(1e-3, 1e3))
def test_no_step_gives_energy(joint, history, dt):
    reactions, stored = driven(joint, history, dt)
    assert np.all(reactions.loss >= 0.0)
    assert np.all(np.isfinite(stored))
    if not isinstance(joint, ij.QuadraticSpring):
        assert np.all(stored >= 0.0)


@given(ODD, HISTORY)
def test_turned_round_an_odd_element_does_the_same(joint, history):
    there, stored = driven(joint, history)
    back, stored_back = driven(joint, -history)
    np.testing.assert_array_equal(back.force, -there.force)
    for name in ("stiffness", "damping", "loss"):
        np.testing.assert_array_equal(getattr(back, name), getattr(there, name))
    np.testing.assert_array_equal(stored_back, stored)


@given(MASING, HISTORY)
def test_force_rises_with_deflection_while_friction_is_one(joint, history):
    """From whatever state the first half of the history leaves."""
    half = STEPS // 2
    up = np.concatenate([history[:half], history[half - 1] + np.sort(np.abs(history[half:]))])
    force = np.asarray(driven(joint, up)[0].force)
    assert np.all(np.diff(force[half - 1 :]) >= -1e-14)
    assert np.all(np.abs(force) <= float(joint.F_S) * (1 + 1e-13))


FINE = 200


@given(SLIDING, HISTORY.map(lambda d: d[:4]))
def test_work_is_stored_or_lost(joint, history):
    """Per step: the force along a path of many substeps against the step's own account."""
    reactions, stored = driven(joint, history)
    ends = itertools.pairwise([0.0, *history])
    path = np.concatenate([np.linspace(a, b, FINE + 1)[1:] for a, b in ends])
    fine, _ = driven(joint, path)
    force = np.concatenate([[0.0], fine.force])
    moved = np.diff(np.concatenate([[0.0], path]))
    work = np.sum((0.5 * (force[1:] + force[:-1]) * moved).reshape(-1, FINE), axis=1)
    account = np.diff(np.concatenate([[0.0], stored])) + np.asarray(reactions.loss)
    # A slider lets go once a step: the trapezoidal rule misses half a jump k (1 - theta) phi over
    # one substep at most, and a kink of k by an eighth of its square.
    h = np.max(np.abs(moved))
    bank = element_of(joint)
    jumps = float(jnp.sum(bank.k * (1.0 - kinetic_share(bank)) * bank.phi))
    bound = 0.5 * h * jumps + 0.125 * h**2 * float(joint.K_T) + 1e-13
    assert np.all(np.abs(work - account) <= bound)


@given(SLIDING, HISTORY, st.floats(0.1, 0.9))
def test_a_step_is_the_same_in_two_parts(joint, history, share):
    whole, _ = driven(joint, history)
    between = np.diff(history, prepend=0.0) * share + np.append(0.0, history[:-1])
    parts, _ = driven(joint, np.stack([between, history], axis=1).ravel())
    np.testing.assert_allclose(parts.force[1::2], whole.force, atol=1e-13)
    np.testing.assert_allclose(parts.state.stretch[1::2], whole.state.stretch, atol=1e-14)
    # A slider that comes to rest upon its threshold may or may not be said to slip; the force
    # does not tell while friction is one.
    if isinstance(joint, ij.Iwan5) and float(joint.theta) < 0.99:
        np.testing.assert_array_equal(parts.state.direction[1::2], whole.state.direction)
    loss = np.asarray(parts.loss).reshape(-1, 2).sum(axis=1)
    np.testing.assert_allclose(loss, whole.loss, atol=1e-13)


@given(SLIDING, HISTORY)
def test_against_an_independent_bank_of_sliders(joint, history):
    bank = element_of(joint)
    expected = drive_sliders(np.asarray(bank.phi), np.asarray(bank.k), kinetic_share(bank), history)
    np.testing.assert_allclose(driven(joint, history)[0].force, expected, atol=1e-14)


@given(st.one_of(IWAN4, IWAN5))
def test_stiffness_and_strength_are_the_elements_own(joint):
    bank = element_of(joint)
    assert float(jnp.sum(bank.k)) == pytest.approx(float(joint.K_T), rel=1e-14)
    assert float(jnp.sum(bank.k * bank.phi)) == pytest.approx(float(joint.F_S), rel=1e-12)
    assert np.all(np.diff(bank.phi) > 0)
    # And so is what the bank does: its tangent at rest and its force in macroslip.
    reactions, _ = driven(joint, [1e-9, *np.full(STEPS - 1, 1.5)])
    tangent = float(joint.K_T - bank.k[0] * (bank.phi[0] <= 1e-9))
    assert float(reactions.stiffness[0]) == pytest.approx(tangent, rel=1e-14)
    macro = kinetic_share(bank) * float(joint.F_S)
    assert float(reactions.force[-1]) == pytest.approx(macro, rel=1e-12)


# --- derivatives ---------------------------------------------------------------------------

TURNS = UNIT * np.array([0.3, -0.2, 0.6, 0.1, 0.15, -0.7, 0.4, 1.3, -0.05, 0.5, -1.2, 0.2])


@eqx.filter_jit
def force_of(kind, values, d):
    return ij.hysteresis(kind(*values), d, sliders=SLIDERS, dt=0.1)


@eqx.filter_jit
def slopes_of(kind, values, d):
    return jax.jacfwd(lambda x, y: force_of(kind, x, y), argnums=(0, 1))(values, d)


CASES = {
    "iwan4": (ij.Iwan4, [0.8, 1.1, -0.4, 0.7]),
    "iwan5": (ij.Iwan5, [0.8, 1.1, -0.4, 0.7, 0.6]),
    "jenkins": (ij.Jenkins, [0.31, 1.1]),
    "cubic_spring": (ij.CubicSpring, [0.6]),
    "gap": (ij.Gap, [1.3, 0.27]),
    "quadratic_drag": (ij.QuadraticDrag, [0.4]),
    "maxwell": (ij.Maxwell, [1.3, 0.2]),
}


@pytest.mark.parametrize("name", CASES)
def test_gradients_of_a_history_are_those_of_central_differences(name):
    """No slider is within a step of its threshold here: forces are smooth around this point."""
    kind, values = CASES[name]
    values = jnp.asarray(values)
    by_parameter, by_history = slopes_of(kind, values, TURNS)
    h = 1e-6
    for i in range(len(values)):
        step = h * jnp.eye(len(values))[i]
        ahead, behind = (force_of(kind, values + s, TURNS) for s in (step, -step))
        np.testing.assert_allclose(by_parameter[:, i], (ahead - behind) / (2 * h), atol=1e-7)
    for i in (0, 5, 10):
        step = h * np.eye(STEPS)[i]
        ahead, behind = (force_of(kind, values, TURNS + s) for s in (step, -step))
        np.testing.assert_allclose(by_history[:, i], (ahead - behind) / (2 * h), atol=1e-7)


def test_reverse_gradients_are_the_forward_ones():
    kind, values = CASES["iwan5"]
    back = eqx.filter_jit(jax.jacrev(lambda x: force_of(kind, x, TURNS)))(jnp.asarray(values))
    np.testing.assert_allclose(back, slopes_of(kind, jnp.asarray(values), TURNS)[0], atol=1e-14)


ELEMENTS = {
    **{
        name: kind(**{i.name: 1.5 if i.name == "n" else 0.3 for i in kind.parameters})
        for name, kind in JOINTS.items()
        if kind is not UnnamedLaw
    },
    "unnamed_law": UnnamedLaw(np.linspace(0.0, 1.0, len(TERMS)), 0.9, 1.3, 0.7),
    "iwan5": scaled(ij.Iwan5, chi=-0.4, beta=0.7, theta=0.6),
    "one-sided gap": ij.Gap(k=0.5, gap=0.3, sides="positive"),
    "tabulated": ij.Tabulated(d=[-1.0, 0.0, 0.4, 2.0], force=[-2.0, 0.0, 0.3, 3.0]),
}


@eqx.filter_jit
def step_ends(element, d, v, d_1, v_1):
    """Reactions at several ends (d_1, v_1) of one step from the end of a history."""

    def advance(state, ends):
        return element.step(*ends, jnp.asarray(0.1), state).state, None

    state = jax.lax.scan(advance, element.init(), (d, v))[0]
    return jax.vmap(lambda x, y: element.step(x, y, jnp.asarray(0.1), state))(d_1, v_1)


@pytest.mark.parametrize("name", ELEMENTS)
def test_tangents_are_those_of_differences(name):
    element = ELEMENTS[name].discrete(SLIDERS)
    rates, h = np.diff(TURNS, prepend=0.0) / 0.1, 1e-6
    seen = []
    for d, v in ((0.45, 2.0), (-0.33, -1.5), (0.21, 0.3), (1.1, 9.0)):
        ends = np.array([d, d + h, d - h, d, d]), np.array([v, v, v, v + h, v - h])
        found = step_ends(element, TURNS, rates, *ends)
        F = np.asarray(found.force)
        seen.append((float(found.stiffness[0]), float(found.damping[0])))
        np.testing.assert_allclose(
            seen[-1], [(F[1] - F[2]) / (2 * h), (F[3] - F[4]) / (2 * h)], atol=1e-9
        )
    assert np.any(np.array(seen) != 0.0)


# --- elements of their own -----------------------------------------------------------------


@pytest.mark.parametrize("differentiate", [jax.jacfwd, jax.jacrev])
@pytest.mark.parametrize("theta", [None, 0.6])
def test_a_bank_is_linear_in_its_stiffnesses(theta, differentiate):
    """All that it sums is homogeneous in them: the derivatives' product with them is the value."""
    phi, k = jnp.linspace(0.1, 2.0, 7), jnp.linspace(1.0, 3.0, 7)
    theta = None if theta is None else jnp.array([theta])

    def reaction(k):
        bank = SliderBank(phi, k, theta)
        before = bank.step(jnp.array(1.3), None, None, bank.init()).state
        after = jax.vmap(lambda d: bank.step(d, None, None, before))(jnp.array([1.7, 0.4, -2.5]))
        return jnp.stack([after.force, after.stiffness, after.loss])

    np.testing.assert_allclose(differentiate(reaction)(k) @ k, reaction(k), rtol=1e-13)
    assert np.all(np.asarray(reaction(k))[2, ::2] > 0.0)


@pytest.mark.parametrize("name", ["iwan4", "iwan5"])
def test_a_rest_changes_nothing(name):
    """A slider that slipped before it goes on at its kinetic friction after it."""
    joint, d = ELEMENTS[name], np.array([0.4, 0.7, -0.3, 0.5])
    rests, _ = driven(joint, np.repeat(d, 3))
    straight, _ = driven(joint, np.concatenate([d, np.full(8, d[-1])]))
    for i in range(4):
        for at in range(3 * i, 3 * i + 3):
            assert float(rests.force[at]) == float(straight.force[i])
            np.testing.assert_array_equal(rests.state.direction[at], straight.state.direction[i])
    first = np.arange(12) % 3 == 0
    np.testing.assert_array_equal(rests.loss[first], straight.loss[:4])
    np.testing.assert_array_equal(rests.loss[~first], 0.0)
    # Nothing slips meanwhile.
    np.testing.assert_allclose(rests.stiffness[~first], joint.K_T, rtol=1e-14)


@pytest.mark.parametrize("ratio", [1e-9, 0.02, 0.49, 0.51, 30.0])
def test_maxwell_against_an_adaptive_solver(ratio):
    """Force and loss over steps of constant rate, which last ``ratio`` relaxation times."""
    k, dt = 2.0, 0.1
    reactions, stored = driven(ij.Maxwell(k=k, c=k * dt / ratio), TURNS, dt)
    force, loss, ends = 0.0, [], []
    for moved in np.diff(TURNS, prepend=0.0):
        solved = scipy.integrate.solve_ivp(
            lambda t, y, m=moved: [k * m - ratio * y[0], y[0] ** 2 / k],
            (0.0, 1.0),
            [force, 0.0],
            method="DOP853",
            rtol=1e-12,
            atol=1e-15,
        )
        force = solved.y[0, -1]
        ends.append(force)
        loss.append(ratio * solved.y[1, -1])
    np.testing.assert_allclose(reactions.force, ends, rtol=1e-10)
    # What is lost is the work less what the spring stores, to round-off of both.
    np.testing.assert_allclose(reactions.loss, loss, rtol=1e-10, atol=1e-14 * np.max(stored))
    np.testing.assert_allclose(stored, np.square(ends) / (2 * k), rtol=1e-10)


def test_a_stiff_maxwell_element_is_its_dashpot():
    """After 1e9 relaxation times a step: nothing is left of the force before."""
    dashpot, _ = driven(ij.Dashpot(c=0.3), TURNS)
    found, _ = driven(ij.Maxwell(k=0.3e10, c=0.3), TURNS)
    np.testing.assert_allclose(found.force, dashpot.force, rtol=1e-8)
    power = 0.3 * (np.diff(TURNS, prepend=0.0) / 0.1) ** 2
    # Besides there is only what the spring takes up and gives back.
    spring = 6.0 * np.max(np.abs(dashpot.force)) ** 2 / 0.3e10
    np.testing.assert_allclose(found.loss, 0.1 * power, atol=spring)


def test_maxwell_in_a_harmonic_cycle_has_its_complex_stiffness():
    """Steps of constant rate are chords of the sine: their error goes with the step squared."""
    joint, omega, d_0, steps = ij.Maxwell(k=2.0, c=0.3), 5.0, 0.7, 400
    t = np.arange(1, 10 * steps + 1) / steps
    d = d_0 * np.sin(2 * np.pi * t)
    reactions, _ = driven(joint, d, 2 * np.pi / omega / steps)
    force, loss = np.asarray(reactions.force)[-steps:], np.asarray(reactions.loss)[-steps:]
    in_phase = 2 * np.mean(force * np.sin(2 * np.pi * t[-steps:])) / d_0
    bound = (2 * np.pi / steps) ** 2
    assert in_phase == pytest.approx(float(joint.secant(d_0, omega=omega)), rel=bound)
    assert np.sum(loss) == pytest.approx(float(joint.dissipation(d_0, omega=omega)), rel=bound)


@pytest.mark.parametrize("kind", [ij.Dashpot, ij.QuadraticDrag])
def test_loss_of_a_rate_against_quadrature_along_the_cubic(kind):
    """Simpson's rule: halving a smooth step takes its error to a sixteenth."""
    joint = kind(c=0.7)
    element = joint.discrete()
    d_0, v_0, d_1, v_1, dt = 0.2, 1.5, 0.34, 0.9, 0.1
    cubic = scipy.interpolate.CubicHermiteSpline([0.0, dt], [d_0, d_1], [v_0, v_1])

    def power(t):
        v = cubic(t, 1)
        return float(joint.rate_law(jnp.asarray(v))[0]) * v

    exact = scipy.integrate.quad(power, 0.0, dt, epsabs=1e-14)[0]
    errors = []
    for parts in (4, 8, 16):
        t = dt * np.arange(parts + 1) / parts
        state, lost = (jnp.asarray(d_0), jnp.asarray(v_0)), 0.0
        for x in t[1:]:
            reaction = element.step(
                jnp.asarray(cubic(x)), jnp.asarray(cubic(x, 1)), jnp.asarray(dt / parts), state
            )
            state, lost = reaction.state, lost + float(reaction.loss)
        errors.append(abs(lost - exact))
    ratios = np.array(errors[:-1]) / errors[1:]
    np.testing.assert_allclose(ratios, 16.0, rtol=0.05)


# --- what arrives --------------------------------------------------------------------------

BAD_CALLS = {
    "dashpot": (ij.Dashpot(c=1.0), TURNS, {}, "Dashpot depends on rate; give dt="),
    "drag": (ij.QuadraticDrag(c=1.0), TURNS, {}, "QuadraticDrag depends on rate; give dt="),
    "maxwell": (ij.Maxwell(k=1.0, c=1.0), TURNS, {}, "Maxwell depends on rate; give dt="),
    "batch": (
        ij.Iwan4(F_S=[1.0, 2.0], K_T=1.0, chi=-0.5, beta=1.0),
        TURNS,
        {},
        r"one parameter set; Iwan4\(F_S=\(2,\), .* carries a batch",
    ),
    "NaN": (ij.Jenkins(F_S=1.0, K_T=1.0), [0.0, np.nan], {}, "d_history holds 1 NaN"),
    "infinite": (ij.Jenkins(F_S=1.0, K_T=1.0), [0.0, -np.inf], {}, "d_history holds 1 NaN or inf"),
    "number": (ij.Jenkins(F_S=1.0, K_T=1.0), 1.0, {}, "d_history is a number"),
    "text": (ij.Jenkins(F_S=1.0, K_T=1.0), ["a"], {}, "d_history is of type"),
    "sliders": (ELEMENTS["iwan5"], TURNS, {"sliders": 2}, "sliders = 2; expected at least 3"),
    "NaN step": (ij.Dashpot(c=1.0), TURNS, {"dt": np.nan}, "dt holds 1 NaN"),
}


@pytest.mark.parametrize("case", BAD_CALLS)
def test_bad_histories_get_one_clear_line(case):
    joint, history, options, message = BAD_CALLS[case]
    with pytest.raises(ij.InputError, match=message) as caught:
        ij.hysteresis(joint, history, **options)
    assert "\n" not in str(caught.value)


def test_histories_side_by_side():
    joint = ELEMENTS["iwan5"]
    several = np.stack([TURNS, -TURNS, 0.5 * TURNS]).reshape(3, 1, STEPS)
    found = ij.hysteresis(element_of(joint), several)
    assert found.shape == (3, 1, STEPS)
    for row, history in zip(found, several, strict=True):
        np.testing.assert_allclose(row[0], driven(joint, history[0])[0].force, atol=1e-15)


def test_a_dashpot_along_a_history_takes_mean_rates():
    found = ij.hysteresis(ij.Dashpot(c=0.5), [0.1, 0.3, 0.0], dt=0.1)
    np.testing.assert_allclose(found, [0.5, 1.0, -1.5])
