"""Elements one by one: closed forms, bounds, batches, precision, and one's own."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.joints import JOINTS, PowerLawDamping, UnnamedLaw, joint_type, masing_dissipation
from iwanjax.joints.power import logarithm, power
from iwanjax.joints.unnamed_terms import TERMS

D = np.array([-3.0, -1.0, -0.2, 0.0, 0.2, 1.0, 3.0])


def names(kind):
    return [info.name for info in kind.parameters]


def test_springs_and_gap():
    np.testing.assert_allclose(ij.LinearSpring(k=2.0).backbone(D), 2 * D)
    np.testing.assert_allclose(ij.CubicSpring(k3=2.0).backbone(D), 2 * D**3)
    gap = ij.Gap(k=2.0, gap=0.5)
    np.testing.assert_allclose(gap.backbone(D), 2 * np.sign(D) * np.maximum(np.abs(D) - 0.5, 0))
    for spring in (ij.LinearSpring(k=2.0), ij.CubicSpring(k3=2.0), gap):
        np.testing.assert_allclose(spring.secant(D) * D, spring.backbone(D), atol=1e-15)


def test_springs_that_are_not_odd():
    np.testing.assert_allclose(ij.QuadraticSpring(k2=2.0).backbone(D), 2 * D**2)
    np.testing.assert_allclose(ij.BilinearSpring(dk=2.0).backbone(D), 2 * np.maximum(D, 0))
    beyond = 2 * np.maximum(D - 0.5, 0)
    stop = ij.Gap(k=2.0, gap=0.5, sides="positive")
    np.testing.assert_allclose(stop.backbone(D), beyond)
    other = ij.Gap(k=2.0, gap=0.5, sides="negative")
    np.testing.assert_allclose(other.backbone(-D), -beyond)
    # A cycle sees the mean of both sides.
    both = ij.Gap(k=2.0, gap=0.5)
    for one in (stop, other):
        np.testing.assert_allclose(one.secant(D), 0.5 * both.secant(D))
        assert float(one.limit_stiffness) == 1.0
    assert repr(both) == "Gap(k=2, gap=0.5)"
    assert repr(stop) == "Gap(k=2, gap=0.5, sides='positive')"
    with pytest.raises(ij.InputError, match="sides = 'left'; expected 'both', 'positive', 'neg"):
        ij.Gap(k=2.0, gap=0.5, sides="left")


def test_a_tabulated_curve():
    curve = ij.Tabulated(d=[-1.0, 0.0, 2.0], force=[-2.0, 0.0, 1.0])
    at = np.array([-3.0, -1.0, -0.5, 0.0, 1.0, 2.0, 4.0])
    np.testing.assert_allclose(curve.backbone(at), [-6.0, -2.0, -1.0, 0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(curve.tangent(at), [2.0, 2.0, 2.0, 0.5, 0.5, 0.5, 0.5])
    assert repr(curve) == "Tabulated(3 points)"
    # A table of a smooth curve comes close with the square of its spacing.
    d = np.linspace(-1.0, 1.0, 201)
    sine = ij.Tabulated(d=d, force=np.sin(d))
    between = np.linspace(-0.99, 0.99, 37)
    np.testing.assert_allclose(sine.backbone(between), np.sin(between), atol=0.01**2 / 8)
    slope = jax.jacobian(lambda f: ij.Tabulated(d=[0.0, 1.0], force=f).backbone(0.25))
    np.testing.assert_allclose(slope(jnp.array([0.0, 1.0])), [0.75, 0.25])


BAD_TABLES = {
    "one point": ([0.0], [0.0], "d has 1 points and force 1; expected as many, at least 2"),
    "number": (0.0, 1.0, r"d has shape \(\); expected a row"),
    "lengths": ([0.0, 1.0], [0.0], "d has 2 points and force 1;"),
    "not increasing": ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], r"d\[2\] = 1 follows d\[1\] = 1"),
    "NaN": ([0.0, 1.0], [0.0, np.nan], "force holds 1 NaN"),
}


@pytest.mark.parametrize("case", BAD_TABLES)
def test_bad_tables_get_one_clear_line(case):
    d, force, message = BAD_TABLES[case]
    with pytest.raises(ij.InputError, match=message) as caught:
        ij.Tabulated(d=d, force=force)
    assert "\n" not in str(caught.value)


ELEMENTS = {
    **{
        # An exponent from 1 on is none of 0.5.
        name: kind(**{each: 1.5 if each == "n" else 0.5 for each in names(kind)})
        for name, kind in JOINTS.items()
        if kind is not UnnamedLaw
    },
    "unnamed_law": UnnamedLaw(np.linspace(0.0, 0.3, len(TERMS)), 90.0, 1.3, 0.7),
    "one-sided gap": ij.Gap(k=0.5, gap=0.5, sides="positive"),
    "tabulated": ij.Tabulated(d=[-1.0, 0.0, 0.4, 2.0], force=[-2.0, 0.0, 0.3, 3.0]),
}


@pytest.mark.parametrize("name", ELEMENTS)
def test_every_element_keeps_what_the_base_class_promises(name):
    joint = ELEMENTS[name]
    np.testing.assert_array_equal(joint.backbone(0.0), 0.0)
    slope = jax.vmap(jax.grad(joint.backbone))(jnp.asarray(D))
    away = D != 0.0
    np.testing.assert_allclose(joint.tangent(D)[away], slope[away], rtol=1e-12, atol=1e-15)
    # The secant joins the tips of the steady cycle, at rest too.
    up, down = joint.loading(D, np.abs(D)), joint.loading(-D, np.abs(D))
    np.testing.assert_allclose(joint.secant(D) * 2 * D, up - down, rtol=1e-12, atol=1e-15)
    rest = float(joint.initial_stiffness)
    assert float(joint.secant(0.0)) == pytest.approx(rest, rel=1e-14)
    # Of Iwan's power law with chi = 0.5 that is 1e-9 away.
    assert float(joint.secant(1e-6)) == pytest.approx(rest, rel=1e-8, abs=1e-11)
    assert float(joint.harmonic_stiffness(1e-6)) == pytest.approx(rest, rel=1e-8, abs=1e-11)
    limit = float(joint.limit_stiffness)
    if np.isfinite(limit):
        assert float(joint.secant(1e10)) == pytest.approx(limit, rel=1e-8, abs=1e-8)
    lost = joint.dissipation(D, omega=0.5)
    assert lost.shape == D.shape
    assert np.all(lost >= 0)
    d, force = joint.loop(1.0, points=2001)
    if not joint.discrete().rate_dependent:
        # The loop's ends join, and what it encloses is lost: steps are 1.6e-3 at most, and the
        # trapezoidal rule errs by an eighth of their square at a kink.
        assert float(force[0]) == pytest.approx(float(force[-1]), abs=1e-15)
        area = np.trapezoid(force, d)
        assert area == pytest.approx(float(joint.dissipation(1.0)), abs=1e-6)


@pytest.mark.parametrize("kind", [ij.Dashpot, ij.QuadraticDrag, ij.Maxwell])
def test_loss_of_rate_dependent_elements_over_a_harmonic_cycle(kind):
    joint = kind(**dict.fromkeys(names(kind), 0.7))
    d, omega = 2.0, 3.0
    t = 2 * np.pi / omega * np.arange(2000) / 2000
    v = omega * d * np.cos(omega * t)
    if kind is ij.Maxwell:
        K = 0.7 * 1j * omega / (1 + 1j * omega)
        force = np.imag(K * d * np.exp(1j * omega * t))
        assert float(joint.secant(d, omega=omega)) == pytest.approx(K.real, rel=1e-14)
        assert float(joint.secant(d)) == 0.0
    else:
        force = np.asarray(joint.rate_law(jnp.asarray(v))[0])
    # A sum over a period is spectrally accurate, of |v|^3 with the fourth power of the step.
    lost = 2 * np.pi / omega * np.mean(force * v)
    assert float(joint.dissipation(d, omega=omega)) == pytest.approx(lost, rel=1e-10)
    with pytest.raises(ij.InputError, match=rf"{kind.__name__}\.dissipation needs omega="):
        joint.dissipation(d)


def test_first_harmonics_that_are_known():
    d = np.array([0.0, 0.3, 2.0])
    np.testing.assert_allclose(ij.LinearSpring(k=2.0).harmonic_stiffness(d), 2.0, rtol=1e-13)
    np.testing.assert_allclose(ij.CubicSpring(k3=2.0).harmonic_stiffness(d), 1.5 * d**2, atol=1e-14)
    # An elastic, perfectly plastic cycle (Caughey 1960).
    slider = ij.Jenkins(F_S=1.0, K_T=1.0)
    psi = np.arccos(1 - 2 / 4.0)
    expected = (psi - 0.5 * np.sin(2 * psi)) / np.pi
    assert float(slider.harmonic_stiffness(4.0)) == pytest.approx(expected, rel=1e-3)
    # A power law in microslip: K_T - R u^(chi+1)/((chi+1)(chi+2)) x gamma functions.
    from scipy.special import gamma

    joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
    n, u = 1.5, 0.3 * float(joint.phi_max)
    factor = 4 / np.sqrt(np.pi) * gamma(n + 0.5) / gamma(n + 1) * n / (n + 1)
    lost = (1.0 - float(joint.secant(u))) * factor
    assert float(joint.harmonic_stiffness(u)) == pytest.approx(1.0 - lost, rel=1e-7)


def test_dashpot_and_background():
    dashpot = ij.Dashpot(c=0.5)
    assert float(dashpot.dissipation(2.0, omega=3.0)) == pytest.approx(np.pi * 0.5 * 3 * 4)
    np.testing.assert_allclose(dashpot.backbone(D), 0.0)
    law = PowerLawDamping(c_1=0.0621, chi=-0.082, zeta_0=5.37e-4)
    np.testing.assert_allclose(law([0.0, 0.01]), [5.37e-4, 0.0621 * 0.01**0.918 + 5.37e-4])


@pytest.mark.parametrize("chi", [-0.9, -0.5, 0.3])
def test_masing_dissipation_of_any_virgin_curve(chi):
    joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=chi, beta=1.0)
    d = np.geomspace(1e-3, 0.99, 7) * float(joint.phi_max)
    np.testing.assert_allclose(
        masing_dissipation(joint.law(), jnp.asarray(d)), joint.dissipation(d), rtol=1e-9
    )
    beyond = np.array([1.5, 4.0]) * float(joint.phi_max)
    np.testing.assert_allclose(
        masing_dissipation(joint.law(), jnp.asarray(beyond)), joint.dissipation(beyond), rtol=2e-3
    )


def test_parameters_may_be_batches():
    chi = np.array([-0.7, -0.5, -0.2])
    joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=chi, beta=5.0)
    each = [float(ij.Iwan4(F_S=10.0, K_T=1.0, chi=c, beta=5.0).backbone(3.0)) for c in chi]
    np.testing.assert_allclose(joint.backbone(3.0), each, rtol=1e-15)
    assert joint.backbone(np.ones((4, 1))).shape == (4, 3)
    assert repr(joint) == "Iwan4(F_S=10, K_T=1, chi=(3,), beta=5)"


BAD_PARAMETERS = {
    "chi at -1": ({"chi": -1.0}, r"chi = -1 .* outside \(-1, inf\)"),
    "negative force": ({"F_S": -1.0}, r"F_S = -1 \(force at macroslip\)"),
    "no stiffness": ({"K_T": 0.0}, "K_T = 0"),
    "negative beta": ({"beta": -0.1}, r"beta = .* outside \[0, inf\)"),
    "NaN": ({"chi": np.nan}, "chi holds 1 NaN"),
    "infinite": ({"beta": np.inf}, "beta holds 1 NaN or infinite"),
    "complex": ({"F_S": 1j}, "F_S is of type complex"),
    "text": ({"F_S": "ten"}, "F_S is of type"),
    "ragged": ({"F_S": [[1.0], [1.0, 2.0]]}, "F_S: .*rectangular"),
    "one of a batch": ({"chi": [-0.5, -1.5]}, "chi = -1.5"),
    "shapes": ({"chi": [-0.5, -0.4], "beta": [1.0, 2.0, 3.0]}, r"broadcast together.*chi \(2,\)"),
}


@pytest.mark.parametrize("case", BAD_PARAMETERS)
def test_bad_parameters_get_one_clear_line(case):
    change, message = BAD_PARAMETERS[case]
    with pytest.raises(ij.InputError, match=message) as caught:
        ij.Iwan4(**({"F_S": 10.0, "K_T": 1.0, "chi": -0.5, "beta": 5.0} | change))
    assert "\n" not in str(caught.value)
    assert "Iwan4" in str(caught.value) or "expected" in str(caught.value)


@pytest.mark.parametrize("theta", [0.0, 1.0001, -0.5])
def test_theta_is_bounded(theta):
    with pytest.raises(ij.InputError, match=r"theta.*outside \(0, 1\]"):
        ij.Iwan5(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0, theta=theta)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"R": 0.0}, "R = 0 .strength of the power law"),
        ({"S": -1.0}, "S = -1"),
        ({"phi_max": 0.0}, "phi_max = 0"),
        ({"chi": -1.0}, "chi = -1"),
    ],
)
@pytest.mark.parametrize("kind", [ij.Iwan4, ij.Iwan5])
def test_bad_distributions_get_one_clear_line(kind, change, message):
    values = {"R": 7e5, "S": 9e3, "chi": -0.6, "phi_max": 6e-4} | change
    extra = {"theta": 0.5} if kind is ij.Iwan5 else {}
    with pytest.raises(ij.InputError, match=f"{kind.__name__}: {message}"):
        kind.from_distribution(**values, **extra)


def test_bad_background_damping():
    with pytest.raises(ij.InputError, match="PowerLawDamping: zeta_0 = -1"):
        PowerLawDamping(c_1=1.0, chi=0.0, zeta_0=-1.0)


def test_catalogue():
    assert joint_type("iwan4") is ij.Iwan4
    with pytest.raises(ij.InputError, match="'iwan_4' is unknown; did you mean 'iwan4'"):
        joint_type("iwan_4")
    with pytest.raises(ij.InputError, match="already names Iwan4"):
        ij.register_joint("iwan4", ij.Jenkins)
    with pytest.raises(ij.InputError, match="expected a subclass"):
        ij.register_joint("mine", int)  # pyright: ignore[reportArgumentType]
    ij.register_joint("mine", ij.Jenkins)
    assert JOINTS.pop("mine") is ij.Jenkins


def test_logarithm_to_the_last_digit():
    """Under jit, where a compiler may undo careful arithmetic."""
    rng = np.random.default_rng(0)
    x = np.concatenate([10.0 ** rng.uniform(-139, 139, 100_000), rng.uniform(0.5, 2.0, 100_000)])
    exact = np.log(x.astype(np.longdouble))
    found = np.asarray(jax.jit(logarithm)(x))
    error = np.abs(found - exact) / np.abs(exact)
    assert float(np.max(error)) < 2.3e-16
    np.testing.assert_allclose(jax.vmap(jax.grad(logarithm))(jnp.asarray(x[:100])), 1 / x[:100])
    np.testing.assert_allclose(power(jnp.asarray(x[-1000:]), 0.37), x[-1000:] ** 0.37, rtol=1e-15)


SINGLE = """
import warnings
import numpy as np
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    import iwanjax as ij
    joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
    ij.Iwan5(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0, theta=0.5)
    system = ij.three_mass()
assert len(caught) == 1 and "single precision" in str(caught[0].message), caught
s = np.array([1e-4, 0.3, 0.999, 1.5])
m = np.minimum(s, 1)
phi = 10 * 6 / (5 + 1 / 3)
force = phi * (m - m**1.5 / 9)
loss = 4 * phi**2 * (0.5 * m**2.5 / 6 / 3.75 + (1 - 1 / 9) * np.maximum(s - 1, 0))
assert joint.backbone(s * phi).dtype == np.float32
np.testing.assert_allclose(joint.backbone(s * phi), force, rtol=2e-6)
np.testing.assert_allclose(joint.dissipation(s * phi), loss, rtol=2e-5)
try:
    ij.qsma(system, 0, [1.0])
except ij.PrecisionError as error:
    assert "jax_enable_x64" in str(error) and "\\n" not in str(error)
else:
    raise SystemExit("qsma ran in single precision")
"""


def test_single_precision_is_right_to_seven_digits_or_refused():
    done = subprocess.run(
        [sys.executable, "-c", SINGLE], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
