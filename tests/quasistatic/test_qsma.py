"""Quasi-static modal analysis against full-size solves, eigenproblems and closed forms."""

import warnings
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import iwanjax as ij
from iwanjax.joints import PowerLawDamping
from iwanjax.quasistatic import work_dissipation
from iwanjax.types import compiled_for_one_call

ROW = np.array([0.0, -1.0, 1.0])
ALPHA = np.geomspace(1e-2, 300.0, 40)


def full_size(system: ij.JointedStructure, r: int, alpha: float) -> np.ndarray:
    """Static displacement of all coordinates by SciPy's hybrid solver, rigid bodies held."""
    M, K = np.asarray(system.structure.M), np.asarray(system.structure.K)
    B, phi = np.asarray(system.rows), np.asarray(system.modes().Phi)[:, r]
    rigid = np.asarray(system.linearised("low").rigid_body_modes())
    hold = (M @ rigid) @ (M @ rigid).T
    scale = np.max(np.abs(K)) * np.max(np.abs(phi))

    def unbalanced(u):
        forces = [
            float(joint.backbone(d)) for joint, d in zip(system.joints.values(), B @ u, strict=True)
        ]
        return (K @ u + hold @ u + B.T @ forces - alpha * M @ phi) / scale

    start = alpha * phi / float(system.modes().omega[r]) ** 2
    found = scipy.optimize.root(unbalanced, start, tol=1e-14)
    assert np.max(np.abs(found.fun)) * scale < 1e-9 * alpha, found.message
    return found.x


@pytest.mark.parametrize("r", [0, 1, 2])
def test_three_masses_against_a_full_size_solve(r):
    system = ij.three_mass()
    solution = ij.qsma(system, r, ALPHA, 1e-4)
    assert bool(solution.converged.all())
    phi = np.asarray(system.modes().Phi)[:, r]
    joint = system.elements[0]
    for level in (0, 20, 30, 39):
        u = full_size(system, r, ALPHA[level])
        q = phi @ (10.0 * u)
        assert float(solution.q[level]) == pytest.approx(q, rel=1e-8)
        assert float(solution.deflection[level, 0]) == pytest.approx(ROW @ u, rel=1e-7)
        omega = np.sqrt(ALPHA[level] / q)
        D = float(joint.dissipation(ROW @ u))
        zeta = D / (2 * np.pi * ALPHA[level] * q) + 1e-4
        assert float(solution.curves.frequency[level]) == pytest.approx(omega / (2 * np.pi))
        assert float(solution.curves.damping[level]) == pytest.approx(zeta, rel=1e-6)
        shares = np.asarray(system.modes().Phi).T @ (10.0 * u) / q
        np.testing.assert_allclose(solution.participation[level], shares, atol=1e-8)


def test_free_structure_with_several_kinds_of_joints():
    rng = np.random.default_rng(2)
    n = 9
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    difference = np.eye(n, k=1) - np.eye(n)
    joints = {
        "iwan": (difference[1], ij.Iwan4(F_S=1.0, K_T=2.0, chi=-0.4, beta=1.0)),
        "slider": (difference[3], ij.Jenkins(F_S=0.5, K_T=1.0)),
        "spring": (difference[4], ij.LinearSpring(k=3.0)),
        "cubic": (difference[5], ij.CubicSpring(k3=0.5)),
        "gap": (difference[6], ij.Gap(k=2.0, gap=0.3)),
        "stiction": (difference[7], ij.Iwan5(F_S=2.0, K_T=1.0, chi=-0.3, beta=2.0, theta=0.8)),
    }
    system = ij.JointedStructure(ij.LinearStructure(np.diag(rng.uniform(1, 2, n)), None, K), joints)
    alpha = np.geomspace(1e-3, 3.0, 9)
    solution = ij.qsma(system, 1, alpha)
    assert bool(solution.converged.all())
    for level in (0, 5, 8):
        u = full_size(system, 1, alpha[level])
        np.testing.assert_allclose(
            solution.deflection[level], np.asarray(system.rows) @ u, rtol=1e-6, atol=1e-12
        )


def test_a_mode_that_leaves_the_joint_alone_is_linear():
    # Two equal masses: in phase the joint between them does not move.
    joint = ij.Iwan4(F_S=1.0, K_T=1.0, chi=-0.5, beta=1.0)
    structure = ij.LinearStructure(np.eye(2), None, 4.0 * np.eye(2))
    system = ij.JointedStructure(structure, {"J": (np.array([-1.0, 1.0]), joint)})
    solution = ij.qsma(system, 0, np.geomspace(1e-2, 1e2, 30), 1e-3)
    assert bool(solution.converged.all())
    np.testing.assert_allclose(solution.curves.frequency, 1.0 / np.pi, rtol=1e-12)
    np.testing.assert_allclose(solution.curves.damping, 1e-3, rtol=1e-9)


@pytest.mark.long
def test_more_joints_than_are_unrolled():
    n = 11
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    difference = (np.eye(n, k=1) - np.eye(n))[: n - 1]
    joints = {
        # Two that slip among springs: each distribution of sliders takes its time to compile.
        f"J{i}": (
            row,
            ij.Iwan4(F_S=0.5 + 0.1 * i, K_T=1.0, chi=-0.5, beta=1.0)
            if i in (2, 7)
            else ij.CubicSpring(k3=0.1 + 0.05 * i),
        )
        for i, row in enumerate(difference)
    }
    system = ij.JointedStructure(ij.LinearStructure(np.eye(n), None, K), joints)
    alpha = np.geomspace(1e-3, 2.0, 24)
    solution = ij.qsma(system, 0, alpha)
    assert bool(solution.converged.all())
    u = full_size(system, 0, alpha[-1])
    np.testing.assert_allclose(
        solution.deflection[-1], np.asarray(system.rows) @ u, rtol=1e-6, atol=1e-9
    )


def test_a_dashpot_damps_like_viscous_damping():
    c = 1e-3
    joints = {
        "iwan": (ROW, ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)),
        "dashpot": (np.array([1.0, 0.0, 0.0]), ij.Dashpot(c=c)),
    }
    structure = ij.three_mass().structure
    system = ij.JointedStructure(structure, joints)
    omega, Phi = system.modes()
    found = ij.qsma(system, 1, [1e-10]).curves.damping[0]
    assert float(found) == pytest.approx(
        c * float(Phi[0, 1] ** 2) / (2 * float(omega[1])), rel=1e-3
    )
    same = ij.LinearStructure(structure.M, c * np.diag([1.0, 0, 0]), structure.K)
    viscous = ij.qsma(ij.JointedStructure(same, {"iwan": joints["iwan"]}), 1, [1e-10])
    assert float(viscous.curves.damping[0]) == pytest.approx(float(found), rel=1e-9)


def test_joints_whose_rows_depend_on_each_other():
    iwan = ij.Iwan4(F_S=5.0, K_T=0.5, chi=-0.5, beta=5.0)
    structure = ij.three_mass().structure
    two = ij.JointedStructure(structure, {"a": (ROW, iwan), "b": (ROW, iwan)})
    twice = ij.three_mass(joint=ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0))
    found, expected = ij.qsma(two, 1, ALPHA), ij.qsma(twice, 1, ALPHA)
    np.testing.assert_allclose(found.q, expected.q, rtol=1e-10)
    np.testing.assert_allclose(found.dissipation, expected.dissipation, rtol=1e-8)
    assert found.deflection.shape == (40, 2)


@pytest.mark.parametrize("frequency", ["secant", "first_harmonic"])
def test_modal_iwan_oscillator_is_its_closed_form(frequency):
    """Eqs. (2.12), (2.13) with the corrected (2.8)."""
    joint = ij.Iwan4(F_S=2.877, K_T=7.843e-2, chi=-0.5150, beta=5.614)
    system = ij.oscillator(stiffness=1.399, joint=joint, zeta=1e-4)
    solution = ij.qsma(system, 0, np.geomspace(1e-3, 300.0, 50), frequency=frequency)
    q = solution.q
    stiffness = joint.secant(q) if frequency == "secant" else joint.harmonic_stiffness(q)
    np.testing.assert_allclose(
        (2 * np.pi * solution.curves.frequency) ** 2, 1.399 + stiffness, rtol=1e-12
    )
    zeta = joint.dissipation(q) / (2 * np.pi * (1.399 + joint.secant(q)) * q**2) + 1e-4
    np.testing.assert_allclose(solution.curves.damping, zeta, rtol=1e-12)


def test_both_roads_to_the_dissipation_agree():
    system = ij.three_mass()
    alpha = np.geomspace(1e-2, 40.0, 30)
    joints = ij.qsma(system, 1, alpha, 1e-4)
    work = ij.qsma(system, 1, alpha, 1e-4, dissipation="work")
    np.testing.assert_allclose(work.dissipation, joints.dissipation, rtol=1e-6)
    np.testing.assert_allclose(work.curves.damping, joints.curves.damping, rtol=1e-6)
    np.testing.assert_array_equal(work.curves.amplitude, joints.curves.amplitude)


def test_work_integral_of_a_known_curve():
    q = np.geomspace(1e-3, 1.0, 80)
    for n in (0.2, 0.5, 0.9):
        alpha = 4.0 * q - 0.3 * q ** (n + 1)
        expected = 4 * 0.3 * n / (n + 2) * q ** (n + 2)
        found = work_dissipation(alpha, q)
        # Below the first level the curve is only guessed; that share fades with amplitude.
        np.testing.assert_allclose(found, expected, rtol=2e-3)
        np.testing.assert_allclose(found[40:], expected[40:], rtol=2e-5)
    np.testing.assert_allclose(work_dissipation(4.0 * q, q), 0.0, atol=1e-14)
    with pytest.raises(ij.InputError, match="at least 6, on"):
        work_dissipation(q[:5], q[:5])


def test_updated_shape_is_the_mode_of_the_secant_structure():
    system = ij.three_mass()
    K = np.asarray(system.structure.K)
    for r in range(3):
        solution = ij.qsma(system, r, ALPHA, 1e-4, shape="updated")
        assert bool(solution.converged.all())
        assert 0 < float(solution.error.max()) < 1e-9
        for level in (0, 20, 39):
            k = float(system.elements[0].secant(solution.deflection[level, 0]))
            values = scipy.linalg.eigh(K + k * np.outer(ROW, ROW), 10 * np.eye(3))[0]
            omega = 2 * np.pi * float(solution.curves.frequency[level])
            assert omega == pytest.approx(np.sqrt(values[r]), rel=1e-10)
        # Little slip leaves the shape alone; much slip does not.
        linear = ij.qsma(system, r, ALPHA, 1e-4)
        difference = np.abs(solution.curves.damping / linear.curves.damping - 1)
        assert difference[0] < 1e-3 < difference[-1]


def test_modes_by_index_list_and_shape():
    system = ij.three_mass()
    several = ij.qsma(system, [0, 2], ALPHA)
    assert several.q.shape == (2, 40)
    assert several.participation.shape == (2, 40, 3)
    one = ij.qsma(system, 2, ALPHA)
    np.testing.assert_allclose(several.q[1], one.q, rtol=1e-12)
    shape = np.array([-1.0, 1.5, -0.7])
    np.testing.assert_array_equal(ij.qsma(system, shape, ALPHA).q, one.q)
    levels = np.stack([ALPHA, 2 * ALPHA])
    each = ij.qsma(system, [0, 2], levels, zeta0=[1e-4, 2e-4])
    np.testing.assert_allclose(each.q[1], ij.qsma(system, 2, 2 * ALPHA).q, rtol=1e-12)


def test_background_damping_as_a_power_law():
    law = PowerLawDamping(c_1=1e-3, chi=-0.2, zeta_0=1e-4)
    system = ij.three_mass()
    plain, more = ij.qsma(system, 1, ALPHA, 0.0), ij.qsma(system, 1, ALPHA, law)
    np.testing.assert_allclose(more.curves.damping - plain.curves.damping, law(plain.q), rtol=1e-9)


def batch_of(system: ij.JointedStructure, sets: int, rng: np.random.Generator, **fixed):
    values = {
        "F_S": 10.0 * np.exp(rng.normal(0, 0.7, sets)),
        "K_T": np.exp(rng.normal(0, 0.3, sets)),
        "chi": rng.uniform(-0.95, -0.05, sets),
        "beta": np.exp(rng.normal(1, 1, sets)),
    } | fixed
    return system.with_joints({"J1": ij.Iwan4(**values)})


@pytest.mark.parametrize("sets", [5, 700])
def test_a_batch_with_varying_stiffness_is_its_members(sets):
    system = ij.three_mass()
    batch = batch_of(system, sets, np.random.default_rng(1))
    solution = ij.qsma(batch, [0, 1], ALPHA, 1e-4)
    assert solution.q.shape == (sets, 2, 40)
    assert bool(solution.converged.all())
    joint = batch.elements[0]
    for i in (0, sets // 2, sets - 1):
        own = ij.three_mass(joint=jax.tree.map(lambda leaf, i=i: leaf[i], joint))
        one = ij.qsma(own, [0, 1], ALPHA, 1e-4)
        np.testing.assert_allclose(solution.curves.frequency[i], one.curves.frequency, rtol=1e-10)
        np.testing.assert_allclose(solution.curves.damping[i], one.curves.damping, rtol=1e-8)
        np.testing.assert_allclose(solution.deflection[i], one.deflection, rtol=1e-7)


def test_a_large_batch_is_worked_in_blocks():
    system = ij.three_mass()
    sets = 4500
    batch = batch_of(system, sets, np.random.default_rng(3), K_T=1.0)
    whole = ij.qsma(batch, 1, ALPHA[:10], deflections=False)
    assert whole.q.shape == (sets, 10)
    assert whole.deflection is None
    part = batch.with_joints(
        {"J1": jax.tree.map(lambda leaf: leaf[-3:] if leaf.ndim else leaf, batch.elements[0])}
    )
    np.testing.assert_allclose(whole.q[-3:], ij.qsma(part, 1, ALPHA[:10]).q, rtol=1e-12)
    with pytest.raises(ij.InputError, match="deflections=True"):
        _ = whole.participation


def test_gradients_are_implicit_and_right():
    system = ij.three_mass()
    weights = np.cos(np.arange(40.0))

    def loss(p, road="joints", shape="linear", frequency="secant"):
        joint = ij.Iwan4(F_S=p[0], K_T=p[1], chi=p[2], beta=p[3])
        curves = ij.qsma(
            system.with_joints({"J1": joint}),
            1,
            p[4] * ALPHA,
            1e-4,
            dissipation=road,
            shape=shape,
            frequency=frequency,
        ).curves
        return weights @ curves.damping * 100 + weights @ curves.frequency

    point = jnp.array([10.0, 1.0, -0.5, 5.0, 1.1])
    slopes = {}
    for options in ({"frequency": "first_harmonic"}, {"road": "work"}, {}):
        value = partial(loss, **options)
        both = compiled_for_one_call(jax.value_and_grad(value))
        found = np.asarray(both(point)[1])
        for i in range(5):
            h = 1e-5 * abs(float(point[i]))
            step = h * np.eye(5)[i]
            (ahead, slopes["ahead", i]), (behind, slopes["behind", i]) = (
                both(point + x) for x in (step, -step)
            )
            assert found[i] == pytest.approx(float(ahead - behind) / (2 * h), rel=1e-5, abs=1e-7)
    # Forward over reverse: the rule may be differentiated again; by chi, of the last of them.
    second = compiled_for_one_call(jax.hessian(lambda c: loss(point.at[2].set(c))))(-0.5)
    expected = float(slopes["ahead", 2][2] - slopes["behind", 2][2]) / 1e-5
    assert float(second) == pytest.approx(expected, rel=1e-5)


@pytest.mark.long
def test_updated_shape_has_gradients_in_the_other_parameters():
    system = ij.three_mass()

    @jax.jit
    def damping(chi):
        joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=chi, beta=5.0)
        solution = ij.qsma(system.with_joints({"J1": joint}), 1, ALPHA[::4], shape="updated")
        return jnp.sum(solution.curves.damping)

    found = float(jax.jit(jax.grad(damping))(-0.5))
    expected = float(damping(-0.5 + 1e-5) - damping(-0.5 - 1e-5)) / 2e-5
    assert found == pytest.approx(expected, rel=1e-6)


def test_no_equilibrium_is_said_and_never_a_number():
    spring = np.array([[1.0, -1.0], [-1.0, 1.0]])
    system = ij.JointedStructure(
        ij.LinearStructure(np.eye(4), None, scipy.linalg.block_diag(spring, spring)),
        {
            "J": (
                np.array([0.0, -1.0, 1.0, 0.0]),
                ij.Iwan4(F_S=1.0, K_T=2.0, chi=-0.5, beta=1.0),
            )
        },
    )
    with pytest.warns(UserWarning, match="levels hold NaN: no static equilibrium"):
        solution = ij.qsma(system, 0, np.geomspace(1e-2, 1e2, 30))
    good = np.asarray(solution.converged)
    assert good[0]
    assert not good[-1]
    # Once the joint has let go it stays so.
    assert np.all(np.diff(good.astype(int)) <= 0)
    assert np.all(np.isnan(np.asarray(solution.q)[~good]))
    assert np.all(np.isfinite(np.asarray(solution.curves.damping)[good]))
    # The load passes F_S where q stops: |y| alpha / lambda-like balance of the free pieces.
    assert np.all(np.asarray(solution.result)[~good] == ij.Result.NO_EQUILIBRIUM)


def test_a_lost_mode_is_said():
    rng = np.random.default_rng(5)
    A, B = rng.normal(size=(8, 8)), rng.normal(size=(1, 8))
    structure = ij.LinearStructure(np.eye(8), None, A @ A.T + np.diag(np.arange(1.0, 9.0) * 20))
    system = ij.JointedStructure(structure, {"J": (B[0], ij.Jenkins(F_S=1.0, K_T=3.0))})
    far = system.with_joints({"J": ij.Jenkins(F_S=1.0, K_T=[3.0, 3e4])})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        solution = ij.qsma(far, list(range(8)), [1e-3])
    lost = np.asarray(solution.result)[1, :, 0] == ij.Result.LOST_MODE
    assert lost.any()
    assert not np.asarray(solution.result)[0].any()
    assert any("closer" in str(w.message) for w in caught)
    values = scipy.linalg.eigh(
        np.asarray(structure.K) + 3e4 * np.outer(B[0], B[0]), eigvals_only=True
    )
    found = (2 * np.pi * np.asarray(solution.curves.frequency)[1, ~lost, 0]) ** 2
    for lam in found:
        assert np.min(np.abs(values / lam - 1)) < 1e-3


REFUSED = {
    "levels missing": ({}, "needs load levels"),
    "no levels": ({"alpha": []}, r"alpha has shape \(0,\)"),
    "negative level": ({"alpha": [-1.0, 1.0]}, "alpha holds -1; levels must be positive"),
    "zero level": ({"alpha": [0.0, 1.0]}, "alpha holds 0"),
    "NaN level": ({"alpha": [1.0, np.nan]}, "alpha holds 1 NaN"),
    "falling levels": ({"alpha": [2.0, 1.0]}, "alpha must increase"),
    "rows of levels": ({"alpha": np.ones((2, 3))}, "alpha has 2 rows for 1 mode"),
    "mode too high": ({"alpha": [1.0], "mode": 3}, "mode 3 does not exist.*3 elastic modes"),
    "negative mode": ({"alpha": [1.0], "mode": -1}, "mode -1 does not exist"),
    "mode as text": ({"alpha": [1.0], "mode": "first"}, "expected an index"),
    "short shape": ({"alpha": [1.0], "mode": np.array([1.0, 0.0])}, "a shape must be 3 finite"),
    "fractional mode": ({"alpha": [1.0], "mode": 1.0}, "indices must be integers"),
    "negative damping": ({"alpha": [1.0], "zeta0": -1e-4}, "zeta0 = -0.0001 is negative"),
    "damping of two modes": ({"alpha": [1.0], "zeta0": [0.1, 0.2]}, "zeta0 has shape"),
    "road": ({"alpha": [1.0], "dissipation": "guess"}, "expected 'joints' or 'work'"),
    "frequency": ({"alpha": [1.0], "frequency": "third"}, "expected 'secant' or 'first_harmonic'"),
    "shape option": ({"alpha": [1.0], "shape": "free"}, "expected 'linear' or 'updated'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_are_one_clear_line(case):
    options, message = REFUSED[case]
    with pytest.raises(ij.InputError, match=message) as caught:
        ij.qsma(ij.three_mass(), **options)
    assert "\n" not in str(caught.value)


def test_other_refusals():
    system = ij.three_mass()
    with pytest.raises(ij.InputError, match="expects a JointedStructure, got LinearStructure"):
        ij.qsma(system.structure, 0, [1.0])  # pyright: ignore[reportArgumentType]
    two = ij.JointedStructure(
        system.structure,
        {
            "a": (ROW, ij.Jenkins(F_S=np.ones(2), K_T=1.0)),
            "b": (np.array([1.0, 0, 0]), ij.Jenkins(F_S=np.ones(3), K_T=1.0)),
        },
    )
    with pytest.raises(ij.InputError, match=r"different batch shapes \[\(2,\), \(3,\)\]"):
        ij.qsma(two, 0, [1.0])
    varied = batch_of(system, 3, np.random.default_rng(0))
    with pytest.raises(ij.InputError, match="each set has its own modes"):
        _ = ij.qsma(varied, 0, [1.0]).participation
    with pytest.raises(ij.InputError, match="shape='updated' needs"):
        ij.qsma(varied, 0, [1.0], shape="updated")
