"""The general law: each of its parts by another route, and that it never feeds energy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

import iwanjax as ij
from iwanjax.joints import AttachedOscillator, BoucWen, UnnamedLaw
from iwanjax.joints.unnamed_terms import (
    ELASTIC,
    KNOTS,
    PARTS,
    RATES,
    RESONATES,
    SHARES,
    SLIPS,
    TERMS,
    TIMES,
    YIELDS,
)
from iwanjax.studies import load_study

D, V, T = 2e-3, 0.4, 0.05


def drawn(seed: int, *parts: str) -> UnnamedLaw:
    """Random strengths of some parts, of any sign in the spring."""
    random = np.random.default_rng(seed)
    strengths = 10.0 * random.exponential(size=len(TERMS)) * (random.random(len(TERMS)) < 0.5)
    strengths[:ELASTIC] *= random.choice([-1.0, 1.0], ELASTIC)
    kept = np.zeros(len(TERMS))
    for part in parts or PARTS:
        kept[PARTS[part]] = 1.0
    return UnnamedLaw(strengths * kept, D, V, T)


def test_the_spring_is_the_natural_cubic_spline_through_its_knots():
    """Without the powers beside it; straight beyond what it was fitted to."""
    strengths = np.array(drawn(1, "spring").strengths)
    strengths[ELASTIC - 2 : ELASTIC] = 0.0
    law = UnnamedLaw(strengths, D, V, T)
    knots = D * KNOTS[1:-1]
    other = CubicSpline(knots, np.asarray(law.backbone(knots)), bc_type="natural")
    d = np.linspace(-D, D, 501)
    np.testing.assert_allclose(law.backbone(d), other(d), atol=1e-11)
    np.testing.assert_allclose(law.tangent(d), other(d, 1), rtol=1e-9, atol=1e-8)
    beyond = np.array([1.5, 40.0]) * D
    for side in (-1.0, 1.0):
        end, slope = other(side * D), other(side * D, 1)
        expected = end + slope * (side * beyond - side * D)
        np.testing.assert_allclose(law.backbone(side * beyond), expected, rtol=1e-10)


def test_powers_of_the_motion_go_on_to_twice_the_largest_and_straight_from_there():
    def named(**strengths):
        found = np.zeros(len(TERMS))
        for name, strength in strengths.items():
            found[TERMS.index(name.replace("_", " "))] = strength
        return UnnamedLaw(found, D, V, T)

    x = np.array([-3.0, -1.7, -0.4, 0.02, 1.0, 1.9, 2.5])
    inside, beyond = np.clip(x, -2.0, 2.0), x - np.clip(x, -2.0, 2.0)
    law = named(quadratic_spring=3.0, cubic_spring=-1.5)
    slope = 6.0 * inside - 4.5 * inside**2
    expected = 3.0 * inside**2 - 1.5 * inside**3 + slope * beyond
    np.testing.assert_allclose(law.backbone(D * x), expected, atol=1e-12)
    np.testing.assert_allclose(law.tangent(D * x), slope / D, rtol=1e-12)
    by = law.discrete()
    stored = [float(by.energy(jnp.asarray(D * each), by.init())) for each in x]
    work = [D * quad(lambda y: float(law.backbone(D * y)), 0.0, end, limit=200)[0] for end in x]
    np.testing.assert_allclose(stored, work, rtol=1e-8, atol=1e-14)
    size, still = np.minimum(np.abs(x), 2.0), 0.0 * x
    for name, power in (("quadratic_damper", 2), ("cubic_damper", 3)):
        drag = size**power + power * size ** (power - 1) * (np.abs(x) - size)
        found = named(**{name: 5.0}).dampers.force(still, V * x)
        np.testing.assert_allclose(found, 5.0 * np.sign(x) * drag, rtol=1e-12)
    found = named(damper_of_large_deflections=5.0).dampers.force(D * x, V * np.ones(x.size))
    np.testing.assert_allclose(found, 5.0 * inside**2, rtol=1e-12)


def test_a_slider_between_two_nodes_is_made_up_of_both():
    """By least squares along a history; nodes an octave apart left 0.114 of the force."""
    random = np.random.default_rng(7)
    turns = D * random.uniform(-1.0, 1.0, 24) * np.geomspace(1.0, 0.1, 24)
    d = np.interp(np.linspace(0.0, 23.0, 600), np.arange(24), turns)
    blank = UnnamedLaw.blank(D, V, T)
    own = jnp.arange(PARTS["sliders"].start, PARTS["sliders"].stop)
    units = jax.vmap(lambda s: ij.hysteresis(blank.with_strengths(s), d, dt=1e-3))
    columns = np.asarray(units(jnp.eye(len(TERMS))[own])).T
    slip = D / 19.0
    stretch = np.zeros(d.size)
    for i, moved in enumerate(np.diff(d)):
        stretch[i + 1] = np.clip(stretch[i] + moved, -slip, slip)
    left = nnls(columns, stretch / slip)[1] / np.linalg.norm(stretch / slip)
    assert left < 0.09


def test_sliders_are_those_of_numpy():
    law = drawn(2, "sliders")
    d = D * np.array([0.3, 1.4, -0.2, -0.1, -1.8, 0.9, 0.85, 0.95, 0.0])
    phi, k = D * SLIPS, SHARES @ np.array(law.strengths)[PARTS["sliders"]] / (D * SLIPS)
    stretch, last, expected = np.zeros_like(phi), 0.0, []
    for each in d:
        stretch = np.clip(stretch + each - last, -phi, phi)
        last = each
        expected.append(k @ stretch)
    np.testing.assert_allclose(ij.hysteresis(law, d, dt=1e3 * T), expected, rtol=1e-12)


def test_yielding_springs_are_those_of_bouc_and_wen():
    law = drawn(4, "yielding")
    d = D * np.array([0.3, 1.4, -0.2, -0.1, -1.8, 0.9, 0.85, 0.95, 0.0])
    force = np.array(law.strengths)[PARTS["yielding"]]
    each = [
        np.asarray(ij.hysteresis(BoucWen(f, f / (D * phi), 2.0), d))
        for f, phi in zip(force, YIELDS, strict=True)
        if f > 0.0
    ]
    np.testing.assert_allclose(ij.hysteresis(law, d, dt=1e3 * T), sum(each), rtol=1e-8)
    for quantity in ("dissipation", "tip_stiffness"):
        other = [
            float(getattr(BoucWen(f, f / (D * phi), 2.0), quantity)(0.7 * D))
            for f, phi in zip(force, YIELDS, strict=True)
            if f > 0.0
        ]
        assert float(getattr(law, quantity)(0.7 * D)) == pytest.approx(sum(other), rel=1e-8)


def test_relaxing_springs_follow_their_equation():
    law = drawn(3, "relaxation")
    tau, strength = T / (2 * np.pi) * TIMES, np.array(law.strengths)[PARTS["relaxation"]]
    t = np.linspace(0.0, 1.5 * T, 1500)
    d = D * np.sin(2 * np.pi * t / T) ** 2

    def rate(t, q):
        return 2 * np.pi / T * D * np.sin(4 * np.pi * t / T) - q / tau

    q = solve_ivp(rate, (0.0, t[-1]), np.zeros(len(tau)), t_eval=t, rtol=1e-10, atol=1e-16).y
    found = ij.hysteresis(law, d, dt=t[1])
    np.testing.assert_allclose(found, strength @ q / D, atol=3e-3 * np.max(strength))


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("pace", [1.0, 5.0])
def test_masses_follow_their_equations(which, pace):
    """Newton's, and Lagrange's of the kinetic energy m x^2 v^2 / 2, along a motion from rest."""
    strengths = np.zeros(len(TERMS))
    strengths[PARTS["inertia"].start + which] = 2 * np.pi / T * V
    law, w = UnnamedLaw(strengths, D, V, T), 2 * np.pi * pace / T
    t = np.linspace(0.0, 3.0 * T / pace, 1801)
    # From rest, and without acceleration there.
    c, s = 1.0 - np.cos(w * t), np.sin(w * t)
    d, v, a = D / 4 * c**2, D / 2 * w * c * s, D / 2 * w**2 * (s**2 + c * (1.0 - c))
    dt = jnp.asarray(t[1])
    force, loss, _ = moved_along(law.discrete(), jnp.asarray(d), jnp.asarray(v), dt)
    expected = (a, (d / D) ** 2 * a + d * v**2 / D**2)[which]
    size = np.max(np.abs(expected))
    np.testing.assert_allclose(force, expected, atol=2e-3 * size)
    known = law.masses.force(d, v, a)
    np.testing.assert_allclose(known, expected, atol=1e-12 * size)
    assert float(jnp.sum(loss)) < 2e-3 * size * D
    assert float(law.dissipation(0.7 * D)) == 0.0
    assert float(law.backbone(0.7 * D)) == 0.0


def test_the_mass_that_resonates_is_an_attached_oscillator():
    """Along a motion from rest, and over a steady cycle."""
    m, w, ratio = 0.3, 1.7 * 2 * np.pi / T, 0.02
    law = UnnamedLaw.blank(D, V, T).with_resonance(np.log([1.7, ratio]))
    strengths = np.zeros(len(TERMS))
    strengths[RESONATES] = m * V * 2 * np.pi / T
    law = law.with_strengths(strengths)
    other = AttachedOscillator(m, m * w**2, 2 * ratio * m * w)
    t = np.linspace(0.0, 4 * T, 801)
    d = jnp.asarray(D * np.sin(2 * np.pi * t / T) * (1.0 - np.exp(-((3 * t / T) ** 2))))
    dt = jnp.asarray(t[1])
    v = jnp.gradient(d, dt)
    expected = moved_along(other.discrete(), d, v, dt)
    for found, known in zip(moved_along(law.discrete(), d, v, dt), expected, strict=True):
        np.testing.assert_allclose(found, known, atol=1e-12 * np.max(np.abs(known)))
    for omega in (0.3 * w, w, 2.0 * w):
        lost = float(law.dissipation(0.7 * D, omega=omega))
        assert lost == pytest.approx(float(other.dissipation(0.7 * D, omega=omega)), rel=1e-12)
    with pytest.raises(ij.InputError, match="resonance has 1 numbers; expected 2"):
        law.with_resonance([0.0])


@pytest.fixture(scope="module")
def dampers():
    """Rates over two decades and the force of each damper there, (rates,), (rates, dampers)."""
    u = np.geomspace(0.01, 1.0, 60)
    blank = UnnamedLaw.blank(D, V, T)
    damper = range(PARTS["damper"].start, PARTS["damper"].stop)
    unit = jax.vmap(
        lambda s: blank.with_strengths(s).dampers.force(jnp.zeros(u.size), jnp.asarray(V * u))
    )(jnp.eye(len(TERMS))[jnp.array(damper)])
    return u, np.asarray(unit).T


@pytest.mark.parametrize("power", [0.0, 0.5, 0.8, 1.0, 1.5, 2.0, 2.5, 3.0])
def test_dampers_make_up_any_power_of_the_rate(dampers, power):
    """A sum that is at least zero everywhere, by least squares."""
    u, columns = dampers
    # Below its least rate a damper that saturates is no dry friction any more.
    u, columns = (
        (u[u > 3 * RATES[-1]], columns[u > 3 * RATES[-1]]) if power == 0.0 else (u, columns)
    )
    left = nnls(columns / u[:, None] ** power, np.ones(u.size))[1]
    most = {0.0: 0.15, 2.5: 0.2}.get(power, 0.02)
    assert left / np.sqrt(u.size) < most
    # Of the force itself, which small rates hardly make, where powers rise.
    if power > 0.5:
        assert nnls(columns, u**power)[1] < 0.015 * np.linalg.norm(u**power)


@eqx.filter_jit
def moved_along(element, d, v, dt):
    """Forces and losses along a history, and what is stored after each step."""

    def advance(state, ends):
        found = element.step(*ends, dt, state)
        return found.state, (found.force, found.loss, element.energy(ends[0], found.state))

    return jax.lax.scan(advance, element.init(), (d, v))[1]


@pytest.mark.parametrize(
    "parts",
    [
        ("spring",),
        ("spring", "relaxation", "inertia"),
        ("damper", "sliders", "duhem"),
        ("yielding", "bristles", "resonance"),
    ],
)
def test_parts_without_strength_are_left_out_and_are_none_where_they_are_not(parts):
    """Under a transformation nobody knows which are zero, and all of them move."""
    strengths = np.ones(len(TERMS))
    law = UnnamedLaw(strengths, D, V, T).alone(*parts)
    assert len(law.discrete().elements) == len({"spring", *parts})
    t = np.linspace(0.0, 3.0 * T, 301)
    d = D * np.sin(2 * np.pi * t / T) * (1.0 - np.exp(-((3 * t / T) ** 2)))
    motion = jnp.asarray(d), jnp.gradient(jnp.asarray(d), t[1]), jnp.asarray(t[1])

    @jax.jit
    def whole(strengths):
        element = law.with_strengths(strengths).discrete()
        assert len(element.elements) == 8
        return moved_along(element, *motion)

    all_of = whole(jnp.stack(law.strengths))
    for found, known in zip(moved_along(law.discrete(), *motion), all_of, strict=True):
        np.testing.assert_allclose(found, known, atol=1e-12 * np.max(np.abs(known)))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.1, 3.0), st.floats(0.2, 4.0))
def test_no_history_feeds_energy(seed, reach, pace):
    """Work done is energy stored and lost, and nothing is lost that was not put in."""
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, 4001)
    turns = random.normal(size=(2, 4))
    # From rest to rest: a mass that is to move at once would take a shock.
    pace_of = 2 * np.pi * np.arange(1, 5)
    phase = np.outer(t**2 * (3.0 - 2.0 * t), pace_of)
    d = reach * D * (np.sin(phase) @ turns[0] + (1.0 - np.cos(phase)) @ turns[1]) / 4.0
    element, dt = drawn(seed).discrete(), jnp.asarray(t[1] * T * pace)
    # Rates that are no differences: masses feel how these change from step to step.
    turning = (pace_of * np.cos(phase)) @ turns[0] + (pace_of * np.sin(phase)) @ turns[1]
    v = reach * D * turning / 4.0 * 6.0 * t * (1.0 - t) / (T * pace)

    force, loss, stored = moved_along(element, jnp.asarray(d), jnp.asarray(v), dt)
    size = float(np.sum(np.abs(force[1:] * np.diff(d))))
    assert np.min(loss) >= -1e-9 * size
    work = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(d)))
    # The history closes where it began, so that no spring stores anything.
    assert work >= -1e-6 * size
    assert work == pytest.approx(float(np.sum(loss[1:]) + stored[-1]), abs=2e-3 * size)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"strengths": np.zeros(3)}, f"expected {len(TERMS)}, one for each term"),
        ({"strengths": -np.ones(len(TERMS))}, "less would feed energy"),
        ({"deflection": 0.0}, "deflection = 0.0; expected a positive number"),
    ],
)
def test_what_is_no_law_is_refused(change, message):
    good = {"strengths": np.zeros(len(TERMS)), "deflection": D, "rate": V, "period": T}
    with pytest.raises(ij.InputError, match=message):
        UnnamedLaw(**(good | change))


STUDY = """
name: saved
model:
  builder: three_mass
  options: {mass: 10, stiffness: 9, zeta: 1e-4}
  joints:
    - {name: J1, type: unnamed_law, file: law.npz}
"""


def test_a_saved_law_is_a_joint_of_a_study(tmp_path):
    law = UnnamedLaw(np.linspace(0.0, 1.0, len(TERMS)), 0.3, 0.3, 6.0)
    law.save(tmp_path / "law.npz")
    (tmp_path / "study.yaml").write_text(STUDY)
    structure = load_study(tmp_path / "study.yaml").structure
    assert structure is not None
    (joint,) = structure.elements
    assert isinstance(joint, UnnamedLaw)
    np.testing.assert_array_equal(joint.strengths, law.strengths)
    push = np.zeros((300, 3))
    push[:20, 1] = 4.0
    found = ij.simulate(structure, push, 0.05, keep=["displacement"], accuracy=None)
    assert bool(found.balanced)
    for bad, message in (
        (STUDY.replace(", file: law.npz", ""), "file is missing"),
        (STUDY.replace("law.npz", "study.yaml"), "study.yaml"),
        (STUDY.replace("file: law.npz", "file: law.npz, parameters: {k: 1}"), "only file:"),
        (STUDY.replace("unnamed_law", "iwan4"), "expected parameters instead"),
    ):
        (tmp_path / "study.yaml").write_text(bad)
        with pytest.raises(ij.InputError, match=message) as caught:
            load_study(tmp_path / "study.yaml").structure  # noqa: B018
        assert "\n" not in str(caught.value)
