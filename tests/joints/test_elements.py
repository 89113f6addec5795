"""Elements one by one: closed forms, bounds, batches, precision, and one's own."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.joints import JOINTS, joint_type, masing_dissipation
from iwanjax.joints.power import logarithm, power

D = np.array([-3.0, -1.0, -0.2, 0.0, 0.2, 1.0, 3.0])


def test_springs_and_gap():
    np.testing.assert_allclose(ij.LinearSpring(k=2.0).backbone(D), 2 * D)
    np.testing.assert_allclose(ij.CubicSpring(k3=2.0).backbone(D), 2 * D**3)
    gap = ij.Gap(k=2.0, gap=0.5)
    np.testing.assert_allclose(gap.backbone(D), 2 * np.sign(D) * np.maximum(np.abs(D) - 0.5, 0))
    for spring in (ij.LinearSpring(k=2.0), ij.CubicSpring(k3=2.0), gap):
        np.testing.assert_allclose(spring.secant(D) * D, spring.backbone(D), atol=1e-15)
        np.testing.assert_allclose(spring.dissipation(D), 0.0)
        np.testing.assert_allclose(spring.loading(D, 3.0), spring.backbone(D))
        slope = jax.vmap(jax.grad(lambda x, s=spring: s.backbone(x)))(jnp.asarray(D))
        np.testing.assert_allclose(spring.tangent(D), slope, atol=1e-15)


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
    with pytest.raises(ij.InputError, match="omega"):
        dashpot.dissipation(1.0)
    law = ij.PowerLawDamping(c_1=0.0621, chi=-0.082, zeta_0=5.37e-4)
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
        ij.PowerLawDamping(c_1=1.0, chi=0.0, zeta_0=-1.0)


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
