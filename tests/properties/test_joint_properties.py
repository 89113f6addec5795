"""What must hold for every joint over the whole range of its parameters."""

from functools import partial

import equinox as eqx
import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import iwanjax as ij

# chi to within 1e-6 of -1 and 0, and beyond Segalman's range.
CHI = st.one_of(
    st.floats(-1 + 1e-6, 0.0), st.floats(0.0, 1.5), st.sampled_from([-1 + 1e-6, -1e-6, 1e-6])
)
STRENGTH = st.floats(-6.0, 6.0).map(lambda x: 10.0**x)
BETA = st.one_of(st.just(0.0), st.floats(-3.0, 3.0).map(lambda x: 10.0**x))
IWAN4 = st.builds(ij.Iwan4, F_S=STRENGTH, K_T=STRENGTH, chi=CHI, beta=BETA)
IWAN5 = st.builds(
    ij.Iwan5, F_S=STRENGTH, K_T=STRENGTH, chi=CHI, beta=BETA, theta=st.floats(0.01, 1.0)
)
JENKINS = st.builds(ij.Jenkins, F_S=STRENGTH, K_T=STRENGTH)
MASING = st.one_of(IWAN4, JENKINS)
# Amplitudes in units of the macroslip deflection.
S = np.array([0.0, 1e-8, 1e-3, 0.1, 0.5, 0.9, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 2.0, 1e3])


def scale(joint) -> float:
    return float(joint.phi_max if hasattr(joint, "phi_max") else joint.F_S / joint.K_T)


@eqx.filter_jit
def curves(joint, d):
    """Force, and what is even: secant, dissipation and tangent."""
    return joint.backbone(d), (joint.secant(d), joint.dissipation(d), joint.tangent(d))


@given(st.one_of(IWAN4, IWAN5, JENKINS))
def test_odd_and_finite(joint):
    d = S * scale(joint)
    force, even = curves(joint, d)
    back, same = curves(joint, -d)
    np.testing.assert_allclose(back, -np.asarray(force), rtol=1e-15)
    for one, other in zip(same, even, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-15)
        assert np.all(np.isfinite(other))
    assert d[0] == force[0] == 0.0
    assert float(even[0][0]) == pytest.approx(float(joint.K_T), rel=1e-15)


@given(MASING)
def test_backbone_rises_and_secant_lies_between_zero_and_initial_stiffness(joint):
    d = np.concatenate([[0.0], np.geomspace(1e-6, 10.0, 200)]) * scale(joint)
    force, K_T = np.asarray(joint.backbone(d)), float(joint.K_T)
    assert np.all(np.diff(force) >= -1e-13 * force[-1])
    secant = np.asarray(joint.secant(d))
    assert np.all(secant > 0)
    assert np.all(secant <= K_T * (1 + 1e-14))
    assert np.all(np.diff(secant) <= 1e-13 * K_T)
    tangent = np.asarray(joint.tangent(d))
    assert np.all((tangent >= -1e-14 * K_T) & (tangent <= K_T * (1 + 1e-14)))
    np.testing.assert_allclose(secant[1:] * d[1:], force[1:], rtol=1e-12)


@given(st.one_of(IWAN4, IWAN5, JENKINS), st.floats(1e-6, 5.0), st.floats(1.0, 10.0))
def test_no_energy_is_gained(joint, s, ratio):
    d = s * scale(joint)
    unit = float(joint.K_T) * d * d
    assert float(joint.dissipation(d)) >= -1e-13 * unit
    if isinstance(joint, ij.Iwan5):
        assert float(joint.dissipation(d, ratio * d)) >= -1e-13 * unit


@given(MASING, st.floats(1e-4, 10.0))
def test_dissipation_is_masings(joint, s):
    """D = 8 int F du - 4 u F, by Gauss-Legendre on both sides of the kink."""
    phi = scale(joint)
    u = s * phi
    nodes, weights = np.polynomial.legendre.leggauss(60)
    total = 0.0
    for a, b in ((0.0, min(u, phi)), (min(u, phi), u)):
        # x = a + (b - a) t^4 makes the power law smooth at zero.
        t = 0.5 * (nodes + 1)
        x = a + (b - a) * t**4
        total += np.sum(0.5 * weights * 4 * t**3 * (b - a) * np.asarray(joint.backbone(x)))
    expected = 8 * total - 4 * u * float(joint.backbone(u))
    work = float(joint.K_T) * u * min(u, phi)
    assert float(joint.dissipation(u)) == pytest.approx(expected, rel=1e-9, abs=1e-11 * work)


@given(st.one_of(IWAN4, IWAN5, JENKINS), st.floats(1e-3, 5.0))
def test_loop_closes_on_the_backbone_and_encloses_the_dissipation(joint, s):
    d_0 = s * scale(joint)
    tips = joint.loading(np.array([-d_0, d_0]), d_0)
    tip = float(joint.backbone(d_0))
    size = float(joint.K_T) * d_0
    np.testing.assert_allclose(tips, [-tip, tip], rtol=1e-12, atol=1e-13 * size)
    d, force = joint.loop(d_0, points=4001)
    # Up the loading branch and back: the area is twice the integral of the one.
    area = 2 * np.trapezoid(np.asarray(force)[:4001], np.asarray(d)[:4001])
    assert float(joint.dissipation(d_0)) == pytest.approx(area, rel=2e-3, abs=1e-6 * size * d_0)


@eqx.filter_jit
def by_both(joint, same, d, d_max):
    """What four and five parameters give, side by side; the secant with a history last."""
    secant = joint.secant(d)
    return {
        "force": (same.backbone(d), joint.backbone(d)),
        "secant": (same.secant(d), secant),
        "secant after more": (same.secant(d, d_max), secant),
        "dissipation": (same.dissipation(d, d_max), joint.dissipation(d)),
        "loading": (same.loading(d, d[-1]), joint.loading(d, d[-1])),
    }


@given(IWAN4, st.floats(1e-3, 5.0))
def test_four_parameters_are_five_with_equal_friction(joint, s):
    same = ij.Iwan5(F_S=joint.F_S, K_T=joint.K_T, chi=joint.chi, beta=joint.beta, theta=1.0)
    d = s * scale(joint) * np.linspace(-1, 1, 7)
    # An array: a number would be compiled in.
    d_max = np.asarray(2.0 * s * scale(joint))
    # Where chi -> -1 and beta = 0 the force is the small rest of K_T d.
    K_T = float(joint.K_T)
    force, energy = 1e-13 * K_T * d[-1], 1e-13 * K_T * d[-1] ** 2
    tolerances = {
        "force": (1e-12, force),
        "secant": (1e-12, 1e-13 * K_T),
        "secant after more": (1e-12, 1e-13 * K_T),
        "dissipation": (1e-11, energy),
        "loading": (1e-10, force),
    }
    for name, (five, four) in by_both(joint, same, d, d_max).items():
        rtol, atol = tolerances[name]
        np.testing.assert_allclose(five, four, rtol=rtol, atol=atol, err_msg=name)


@given(st.one_of(IWAN4, IWAN5))
def test_parameters_round_trip(joint):
    extra = {"theta": joint.theta} if isinstance(joint, ij.Iwan5) else {}
    back = type(joint).from_distribution(
        R=joint.R, S=joint.S, chi=joint.chi, phi_max=joint.phi_max, **extra
    )
    for name in ("F_S", "K_T", "chi", "beta", "R", "S", "phi_max"):
        np.testing.assert_allclose(getattr(back, name), getattr(joint, name), rtol=1e-12)


METHODS = ("backbone", "secant", "dissipation")


@partial(jax.jit, static_argnums=(0, 1))
def value(kind, method, x):
    """One method at (parameters..., d): traced, so that one compilation serves all points."""
    return getattr(kind(**dict(zip(NAMES[kind], x, strict=False))), method)(x[-1])


NAMES = {kind: [info.name for info in kind.parameters] for kind in (ij.Iwan4, ij.Iwan5)}
gradient = jax.jit(jax.grad(value, argnums=2), static_argnums=(0, 1))
hessian = jax.jit(jax.hessian(value, argnums=2), static_argnums=(0, 1))


@given(
    st.sampled_from([ij.Iwan4, ij.Iwan5]),
    st.sampled_from(METHODS),
    st.tuples(
        st.floats(0.1, 10.0),
        st.floats(0.1, 10.0),
        st.floats(-0.98, 0.8),
        st.floats(0.05, 20.0),
        st.floats(0.1, 0.99),
    ),
    st.one_of(st.floats(0.02, 0.97), st.floats(1.03, 5.0)),
)
def test_gradients_match_finite_differences(kind, method, parameters, s):
    values = parameters[: len(NAMES[kind])]
    phi_max = float(kind(*values).phi_max)
    point = np.array([*values, s * phi_max])
    found = np.asarray(gradient(kind, method, point))
    for i, x in enumerate(point):
        h = 1e-6 * max(abs(x), 0.1)
        step = h * np.eye(len(point))[i]
        ahead, behind = (float(value(kind, method, point + z)) for z in (step, -step))
        # Round-off of the difference, with a hundredfold margin.
        assert found[i] == pytest.approx(
            (ahead - behind) / (2 * h), rel=1e-5, abs=1e-14 * abs(ahead) / h
        )


@pytest.mark.parametrize("chi", [-1 + 1e-6, -0.5, -1e-6, 0.0, 1e-6, 0.5])
@pytest.mark.parametrize("s", [0.0, 1e-300, 1e-12, 1.0, 1.0 + 1e-15, 50.0])
@pytest.mark.parametrize("kind", [ij.Iwan4, ij.Iwan5])
def test_first_and_second_derivatives_are_finite_everywhere(kind, chi, s):
    values = [1.0, 1.0, chi, 2.0, 0.4][: len(NAMES[kind])]
    point = np.array([*values, s * float(kind(*values).phi_max)])
    for method in METHODS:
        assert np.all(np.isfinite(gradient(kind, method, point)))
        assert np.all(np.isfinite(hessian(kind, method, point)))
