"""Joints attached to a structure: limits, references, and what is refused."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

import iwanjax as ij
from iwanjax.dynamics.steady_state import parameter_set
from iwanjax.structures.model_file import Model
from iwanjax.structures.modification import modified_modes
from iwanjax.updating.joint_groups import structural_parameters

ROW = np.array([0.0, -1.0, 1.0])
JOINT = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)


@pytest.mark.reference
def test_three_masses_of_table_2_1():
    omega, Phi = ij.three_mass().modes()
    np.testing.assert_allclose(omega, [0.424470, 1.215684, 1.744115], rtol=1e-6)
    table = [[0.1051, 0.2433, -0.1725], [0.1891, 0.0871, 0.2380], [0.2307, -0.1822, -0.1166]]
    # Four printed digits.
    np.testing.assert_allclose(Phi, table, atol=5.1e-5)


def test_limits_of_the_amplitude_range():
    system = ij.three_mass()
    K = np.asarray(system.structure.K)
    for limit, k in (("low", 1.0), ("high", 0.0)):
        expected = scipy.linalg.eigh(K + k * np.outer(ROW, ROW), 10 * np.eye(3), eigvals_only=True)
        np.testing.assert_allclose(system.modes(limit).omega ** 2, expected, rtol=1e-12)
    np.testing.assert_allclose(
        system.modes().frequency, system.modes().omega / (2 * np.pi), rtol=1e-15
    )


def test_pieces_that_only_joints_hold_together():
    # Free in space, and two pieces once the joint slips.
    spring = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K = scipy.linalg.block_diag(spring, spring)
    system = ij.JointedStructure(
        ij.LinearStructure(np.eye(4), None, K), {"J": (np.array([0.0, -1.0, 1.0, 0.0]), JOINT)}
    )
    assert system.modes("low").omega.shape == (3,)
    assert system.modes("high").omega.shape == (2,)


def test_with_joints_keeps_the_reference():
    system = ij.three_mass()
    other = system.with_joints({"J1": ij.Jenkins(F_S=1.0, K_T=2.0)})
    np.testing.assert_array_equal(other.basis.omega2, system.basis.omega2)
    assert isinstance(other.joints["J1"], ij.Jenkins)
    assert float(other.modes().omega[1]) > float(system.modes().omega[1])


modified = eqx.filter_jit(modified_modes)


@settings(max_examples=25)
@given(st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3))
def test_modes_follow_a_change_of_stiffness_exactly(exponents):
    rng = np.random.default_rng(5)
    A = rng.normal(size=(8, 8))
    K, B = A @ A.T + np.diag(np.arange(1.0, 9.0) * 20), rng.normal(size=(3, 8))
    joints = {f"J{i}": (B[i], ij.LinearSpring(k=3.0)) for i in range(3)}
    system = ij.JointedStructure(ij.LinearStructure(np.eye(8), None, K), joints)
    k = 3.0 * 10.0 ** np.array(exponents)
    found = modified(system.basis, jnp.arange(8), [jnp.array([x - 3.0]) for x in k])
    values, vectors = scipy.linalg.eigh(K + (B.T * k) @ B)
    assurance = (vectors.T @ np.asarray(system.basis.Phi)) ** 2
    known = np.asarray(found.assurance[:, 0]) > 0.5
    # Where one mode is unmistakably the reference's, it is that one and no other.
    match = np.argmax(assurance, axis=0)
    np.testing.assert_allclose(np.asarray(found.lam[:, 0])[known], values[match][known], rtol=1e-9)
    y = np.array([row[:, 0] for row in found.y])
    expected = np.abs(B @ vectors[:, match])[:, known]
    np.testing.assert_allclose(np.abs(y[:, known]), expected, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(
        found.assurance[:, 0][known], assurance.max(axis=0)[known], rtol=1e-6
    )
    if np.max(np.abs(exponents)) < 0.1:
        assert np.all(known)


def test_modified_frequency_has_the_right_gradient():
    system = ij.three_mass()

    def eigenvalue(k):
        return modified_modes(system.basis, jnp.array([1]), [jnp.array([k - 1.0])]).lam[0, 0]

    both = jax.jit(jax.value_and_grad(eigenvalue))
    found = both(1.7)[1]
    expected = (both(1.7 + 1e-5)[0] - both(1.7 - 1e-5)[0]) / 2e-5
    assert float(found) == pytest.approx(float(expected), rel=1e-8)
    # d(omega^2)/dk = (row phi)^2.
    y = modified_modes(system.basis, jnp.array([1]), [jnp.array([0.7])]).y[0][0, 0]
    assert float(found) == pytest.approx(float(y) ** 2, rel=1e-10)


STRUCTURE = ij.LinearStructure(10 * np.eye(3), None, ij.three_mass().structure.K)
BAD_JOINTS = {
    "no structure": ((np.eye(3), {"J": (ROW, JOINT)}), "expects a LinearStructure .*, got ndarray"),
    "a list": ((STRUCTURE, [(ROW, JOINT)]), "expects a mapping"),
    "short row": ((STRUCTURE, {"J": (ROW[:2], JOINT)}), r"row of joint 'J' has shape \(2,\)"),
    "NaN in the row": ((STRUCTURE, {"J": (ROW * np.nan, JOINT)}), "row of joint 'J' holds 3 NaN"),
    "zero row": ((STRUCTURE, {"J": (0 * ROW, JOINT)}), "row of joint 'J' is all zeros"),
    "no element": ((STRUCTURE, {"J": (ROW, 3.0)}), "expected a joint element.*got float"),
    "swapped": ((STRUCTURE, {"J": (JOINT, ROW)}), "row of joint 'J'"),
    "row alone": ((STRUCTURE, {"J": ROW}), r"joint 'J': expected \(row, joint\)"),
    "label": ((STRUCTURE, {1: (ROW, JOINT)}), "label 1 is not a string"),
    "no row": ((STRUCTURE, {"J": JOINT}), r"joint 'J' has no row: expected \(row, joint\)$"),
    "unknown row": (
        (Model(STRUCTURE, {"J1": ROW}, {}, {}), {"J": JOINT}),
        "joint 'J' has no row: .* one of the model's rows J1; did you mean 'J1'",
    ),
    "damping twice": (
        (ij.LinearStructure(np.eye(3), np.eye(3), STRUCTURE.K), {"J": (ROW, JOINT)}, 0.01),
        "the structure has a damping matrix C",
    ),
    "negative zeta": ((STRUCTURE, {"J": (ROW, JOINT)}, -0.01), "negative damping ratio"),
}


def test_joints_sit_at_the_model_s_rows_of_their_names():
    model = Model(STRUCTURE, {"J1": ROW, "other": 2.0 * ROW}, {}, {})
    found = ij.JointedStructure(model, {"J1": JOINT})
    expected = ij.JointedStructure(STRUCTURE, {"J1": (ROW, JOINT)})
    assert eqx.tree_equal(found, expected)


def test_damping_is_that_of_the_modes_with_sticking_joints():
    zeta = [0.01, 0.02]
    damped = ij.JointedStructure(STRUCTURE, {"J1": (ROW, JOINT)}, zeta=zeta)
    omega, Phi = damped.modes()
    modal = np.asarray(Phi).T @ np.asarray(damped.structure.C) @ np.asarray(Phi)
    np.testing.assert_allclose(
        modal, np.diag(2.0 * np.append(zeta, 0.0) * np.asarray(omega)), atol=1e-12
    )


@pytest.mark.parametrize("case", BAD_JOINTS)
def test_bad_joints_get_one_clear_line(case):
    arguments, message = BAD_JOINTS[case]
    with pytest.raises(ij.InputError, match=message) as caught:
        ij.JointedStructure(*arguments)
    assert "\n" not in str(caught.value)


def test_a_structure_without_joints_is_linear():
    linear = ij.JointedStructure(STRUCTURE, {})
    values = scipy.linalg.eigvalsh(np.asarray(STRUCTURE.K), np.asarray(STRUCTURE.M))
    for limit in ("low", "high"):
        elastic = values[-linear.modes(limit).omega.size :]
        np.testing.assert_allclose(linear.modes(limit).omega ** 2, elastic, rtol=1e-12)


@pytest.mark.parametrize("ask", ["qsma", "fit", "steady state"])
def test_who_needs_amplitude_refuses_a_structure_without_joints(ask):
    linear = ij.JointedStructure(STRUCTURE, {})
    run = {
        "qsma": lambda: ij.qsma(linear, 0, [1.0]),
        "fit": lambda: structural_parameters(linear),
        "steady state": lambda: parameter_set(linear),
    }
    with pytest.raises(
        ij.InputError, match=f"{ask}: the structure has no joints; it is linear.*at least one joint"
    ):
        run[ask]()


def test_a_row_that_sees_only_rigid_motion_is_refused():
    free = ij.LinearStructure(np.diag([1.0, 2.0]), None, [[1.0, -1.0], [-1.0, 1.0]])
    # The centre of mass stays where it is in the elastic mode.
    centre = np.array([1.0, 2.0])
    with pytest.raises(ij.InputError, match="'J' does not deflect in any elastic mode"):
        ij.JointedStructure(free, {"J": (centre, ij.CubicSpring(k3=1.0))})


def test_joints_on_one_row_are_one_independent_deflection():
    joints = {"J": (ROW, ij.CubicSpring(k3=1.0)), "K": (ROW, JOINT)}
    assert ij.JointedStructure(STRUCTURE, joints).basis.independent == (0,)


def test_other_refusals():
    system = ij.three_mass()
    with pytest.raises(ij.InputError, match=r"no joint is called 'J9'; there are J1$"):
        system.with_joints({"J9": JOINT})
    batch = system.with_joints({"J1": ij.Jenkins(F_S=1.0, K_T=np.array([1.0, 2.0]))})
    with pytest.raises(ij.InputError, match="batch of shape"):
        batch.modes()
    cubic = system.with_joints({"J1": ij.CubicSpring(k3=1.0)})
    with pytest.raises(ij.InputError, match="'J1' has no stiffness at large amplitude"):
        cubic.modes("high")
    with pytest.raises(ij.InputError, match="being traced"):
        jax.jit(lambda k: ij.three_mass(joint=ij.LinearSpring(k=k)).basis.omega2)(1.0)
    with pytest.raises(ij.InputError, match="must be positive"):
        ij.three_mass(mass=-1.0)
    with pytest.raises(ij.InputError, match=r"zeta = -0\.1 is negative"):
        ij.oscillator(stiffness=1.0, joint=JOINT, zeta=-0.1)
