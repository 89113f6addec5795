"""Integration in time against closed forms, plain loops, other integrators and itself."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize
from reference.test_brake_reuss import beam  # noqa: F401

import iwanjax as ij
from iwanjax.dynamics import base_input, half_sine, modal_input, point_input, sine
from iwanjax.dynamics.transient import QUANTITIES
from iwanjax.types import compiled_for_one_call

METHODS = ["exact", "newmark"]
HIT = 1.744115  # rad/s, of the half sine in the thesis's Sec. 2.3.1


def hit(samples, dt, p: Any = 1.0):
    """The thesis's blow (2.29); levels on a leading axis."""
    return half_sine(dt * np.arange(samples), p, HIT)


# --- locked joints ---------------------------------------------------------------------------


def linear_response(js, u, v, row, force, t):
    """Closed form: each mode under a constant force, damped by its own ratio."""
    linear = js.linearised("low")
    M, C, K = (np.asarray(A) for A in (linear.M, linear.C, linear.K))
    values, Phi = scipy.linalg.eigh(K, M)
    omega = np.sqrt(np.where(values < 1e-12, 0.0, values))
    sigma = 0.5 * np.diag(Phi.T @ C @ Phi)
    q, p, f = Phi.T @ M @ u, Phi.T @ M @ v, Phi.T @ row * force
    found = np.zeros((len(t), len(omega)))
    for r, (w, s) in enumerate(zip(omega, sigma, strict=True)):
        if w == 0.0:
            found[:, r] = q[r] + p[r] * t + 0.5 * f[r] * t**2
        else:
            still, w_d = f[r] / w**2, np.sqrt(w**2 - s**2)
            a, b = q[r] - still, (p[r] + s * (q[r] - still)) / w_d
            found[:, r] = still + np.exp(-s * t) * (a * np.cos(w_d * t) + b * np.sin(w_d * t))
    return found @ Phi.T


@pytest.mark.parametrize("case", ["undamped", "damped", "free"])
def test_locked_joints_after_a_thousand_cycles(case):
    locked = ij.LinearSpring(k=1.0)
    if case == "free":
        spring = 9.0 * np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
        structure = ij.LinearStructure(10 * np.eye(3), None, spring)
        js = ij.JointedStructure(structure, {"J1": ([0.0, -1.0, 1.0], locked)})
    else:
        js = ij.three_mass(joint=locked, zeta=1e-4 if case == "damped" else 0.0)
    omega = float(js.modes().omega[0])
    u, v, row, force = np.array([0.1, -0.2, 0.3]), np.array([1.0, 0.5, -1.5]), np.eye(3)[0], 0.02
    dt = 2 * np.pi / omega / 16
    steps = 16_000
    found = ij.simulate(
        js,
        np.full(steps + 1, force),
        dt,
        inputs=row,
        displacement=u,
        velocity=v,
        keep=["displacement"],
        every=40,
    )
    expected = linear_response(js, u, v, row, force, np.asarray(found.time))
    assert float(found.time[-1]) * omega > 2 * np.pi * 999
    peak = np.max(np.abs(expected))
    np.testing.assert_allclose(found.displacement, expected, atol=1e-9 * peak)
    # The elastic motion by itself: a rigid body's may be far larger.
    elastic = np.diff(expected, axis=1)
    error = np.max(np.abs(np.diff(found.displacement, axis=1) - elastic))
    assert error < 1e-9 * np.max(np.abs(elastic))


def test_a_structure_without_joints_moves_in_its_modes():
    K = np.asarray(ij.three_mass().structure.K)
    js = ij.JointedStructure(ij.LinearStructure(10 * np.eye(3), 0.02 * K, K), {})
    u, v, row, force = np.array([0.1, -0.2, 0.3]), np.array([1.0, 0.5, -1.5]), np.eye(3)[0], 0.02
    found = ij.simulate(
        js,
        np.full(400, force),
        0.05,
        inputs=row,
        displacement=u,
        velocity=v,
        keep=[*QUANTITIES, "energy"],
    )
    expected = linear_response(js, u, v, row, force, np.asarray(found.time))
    np.testing.assert_allclose(found.displacement, expected, atol=1e-11 * np.abs(expected).max())
    assert bool(found.balanced)
    assert found.joint_force.shape == (400, 0)
    energy = found.energy
    stored = energy.kinetic + energy.elastic + energy.viscous - energy.work
    np.testing.assert_allclose(stored, stored[0], rtol=1e-4)
    assert not np.any(energy.joints)


def test_newmark_lowers_the_frequency_by_a_twelfth_of_the_angle_squared():
    js = ij.oscillator(stiffness=8.0, joint=ij.LinearSpring(k=1.0))
    omega, steps = 3.0, 400
    for angle in (0.2, 0.1, 0.05):
        dt = angle / omega
        found = ij.simulate(
            js,
            np.zeros(steps + 1),
            dt,
            inputs=[1.0],
            displacement=[1.0],
            method="newmark",
            keep=["displacement"],
        ).displacement[:, 0]
        theta = 2 * np.arctan(angle / 2)
        np.testing.assert_allclose(found, np.cos(theta * np.arange(steps + 1)), atol=1e-11)
        # Three neighbours of a sine tell its angle.
        k = np.argmax(np.abs(found[1:-1])) + 1
        theta = np.arccos((found[k - 1] + found[k + 1]) / (2 * found[k]))
        assert 1 - theta / angle == pytest.approx(angle**2 / 12, rel=0.2 * angle**2 + 1e-9)


# --- an independent loop ---------------------------------------------------------------------


def newmark_in_numpy(js, phi, k, theta, force, dt):
    """Average acceleration in physical coordinates, one bank of sliders, Newton at each step."""
    M, C, K = (np.asarray(A) for A in (js.structure.M, js.structure.C, js.structure.K))
    row = np.asarray(js.rows[0])
    stretch, flag = np.zeros_like(phi), np.zeros_like(phi)

    def bank(moved):
        way = np.sign(moved)
        goes_on = (flag == way) & (flag != 0)
        trial = stretch + moved
        slips = way * trial >= np.where(goes_on, theta * phi, phi)
        if moved == 0:
            slips[:] = False
        new = np.where(slips, way * theta * phi, trial)
        new_flag = np.where(slips, way, 0.0 if moved else flag)
        return k @ new, k @ ~slips, new, new_flag

    u, v = np.zeros(3), np.zeros(3)
    a = np.linalg.solve(M, force[0])
    rows = [(u, v, a, 0.0)]
    for f in force[1:]:
        u_0, v_0, a_0 = u, v, a
        for _ in range(100):
            a = 4 / dt**2 * (u - u_0) - 4 / dt * v_0 - a_0
            v = v_0 + dt / 2 * (a_0 + a)
            joint, tangent, new, new_flag = bank(row @ (u - u_0))
            r = M @ a + C @ v + K @ u + row * joint - f
            if np.max(np.abs(r)) < 1e-12 * np.max(np.abs(K @ u) + 1e-30):
                break
            J = 4 / dt**2 * M + 2 / dt * C + K + tangent * np.outer(row, row)
            u = u - np.linalg.solve(J, r)
        else:
            raise AssertionError("no balance")
        stretch, flag = new, new_flag
        rows.append((u, v, a, joint))
    return [np.array(column) for column in zip(*rows, strict=True)]


class AsBank(ij.Iwan5):
    """A five-parameter element as a bank of sliders."""

    def discrete(self, sliders=200):
        return self.slider_bank(sliders)


@pytest.mark.parametrize("theta", [1.0, 0.5])
def test_newmark_against_a_plain_loop(theta):
    joint = AsBank(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0, theta=theta)
    js, dt = ij.three_mass(joint=joint, zeta=1e-3), 0.05
    force = np.outer(hit(500, dt, 400.0), [0.0, 1.0, 0.0])
    sliders = joint.slider_bank(50)
    phi, k = np.asarray(sliders.phi), np.asarray(sliders.k)
    keep = ["displacement", "velocity", "acceleration", "joint_force", "joint_deflection"]
    found = ij.simulate(js, force, dt, method="newmark", sliders=50, keep=keep)
    expected = newmark_in_numpy(js, phi, k, theta, force, dt)
    # In macroslip for a while.
    assert np.max(np.abs(found.joint_deflection)) > float(joint.phi_max)
    ours = (found.displacement, found.velocity, found.acceleration, found.joint_force[:, 0])
    for mine, other in zip(ours, expected, strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-9 * np.max(np.abs(other)))


# --- other integrators -----------------------------------------------------------------------


class Case(NamedTuple):
    """A joint between two masses, its force as a plain function, and what it remembers."""

    joint: ij.AbstractJoint
    force: Callable[[float, float, float], float]
    memory: Callable[[float, float, float], float] = lambda d, v, x: 0.0
    # Of the error against the step; a contact's beginning falls anywhere in its step.
    order: tuple[float, float] = (1.95, 2.05)


CASES = {
    "spring": Case(ij.LinearSpring(k=4.0), lambda d, v, x: 4 * d),
    "cubic": Case(ij.CubicSpring(k3=40.0), lambda d, v, x: 40 * d**3),
    "dashpot": Case(ij.Dashpot(c=0.3), lambda d, v, x: 0.3 * v),
    "drag": Case(ij.QuadraticDrag(c=0.3), lambda d, v, x: 0.3 * v * abs(v)),
    "Maxwell": Case(
        ij.Maxwell(k=5.0, c=2.0), lambda d, v, x: x, lambda d, v, x: 5.0 * v - x * 5.0 / 2.0
    ),
    "gap": Case(
        ij.Gap(k=30.0, gap=0.2),
        lambda d, v, x: 30 * math.copysign(max(abs(d) - 0.2, 0.0), d),
        order=(1.5, 2.5),
    ),
}
M_2, K_2 = np.diag([1.0, 2.0]), np.array([[6.0, -2.0], [-2.0, 5.0]])
# In proportion to the structure without its joint: with it modes are coupled.
C_2 = 0.1 * M_2 + 0.05 * K_2
ROW_2, START_U, START_V = np.array([-1.0, 1.0]), np.array([0.2, 0.2]), np.array([-1.0, 1.5])
INSTANTS = np.arange(1.0, 9.0)
STEPS = 3200


def by_solve_ivp(case: Case) -> np.ndarray:
    """Two masses driven at the second by a sine of 2 rad/s, at the instants."""
    inverse = np.linalg.inv(M_2)

    def rate(t, y):
        u, v, x = y[:2], y[2:4], y[4]
        d, d_rate = ROW_2 @ u, ROW_2 @ v
        f = np.array([0.0, 1.5 * np.sin(2 * t)]) - ROW_2 * case.force(d, d_rate, x)
        return np.array([*v, *(inverse @ (f - C_2 @ v - K_2 @ u)), case.memory(d, d_rate, x)])

    start = np.array([*START_U, *START_V, 0.0])
    # Steps short enough not to run over a contact.
    return (
        scipy.integrate.solve_ivp(
            rate, (0, 8), start, "DOP853", INSTANTS, rtol=1e-11, atol=1e-12, max_step=0.1
        )
        .y[:2]
        .T
    )


# The joints' side of a step is the same by either method.
@pytest.mark.parametrize(
    ("name", "method"),
    [
        *((name, "exact") for name in CASES),
        ("Maxwell", "newmark"),
        ("gap", "newmark"),
        *(
            pytest.param(name, "newmark", marks=pytest.mark.long)
            for name in ("spring", "cubic", "dashpot", "drag")
        ),
    ],
)
def test_second_order_towards_what_solve_ivp_finds(name, method):
    case = CASES[name]
    js = ij.JointedStructure(ij.LinearStructure(M_2, C_2, K_2), {"J": (ROW_2, case.joint)})
    expected = by_solve_ivp(case)
    counts, errors = [200, 400, 800, 1600, 3200], []
    for n in counts:
        dt = 8.0 / n
        # As many steps at each step size: one compilation.
        found = ij.simulate(
            js,
            sine(dt * np.arange(STEPS + 1), 1.5, 2.0),
            dt,
            inputs=point_input(js, 1),
            displacement=START_U,
            velocity=START_V,
            method=method,
            keep=["displacement"],
        ).displacement
        errors.append(np.max(np.abs(found[n // 8 : n + 1 : n // 8] - expected)))
    low, high = case.order
    assert low < -np.polyfit(np.log(counts), np.log(errors), 1)[0] < high
    # Forces on straight lines, or frequencies that are low, by omega^2 dt^2/12 with omega < 10.
    assert errors[-1] < 100 / 12 * (8.0 / STEPS) ** 2 * 8.0


@pytest.mark.parametrize("method", METHODS)
def test_order_with_sliders(method):
    js, end = ij.three_mass(zeta=1e-3), 32.0
    counts, last = [400, 566, 800, 1131, 1600, 2263, 3200, 12_800], []
    for n in counts:
        t = end / n * np.arange(12_801)
        found = ij.simulate(
            js,
            sine(t, 60.0, 1.2),
            end / n,
            inputs=point_input(js, 1),
            keep=["velocity", "joint_deflection"],
            method=method,
        )
        last.append(np.asarray(found.velocity[n]))
        # In macroslip for a while: phi_max is 11.25.
        assert np.max(np.abs(found.joint_deflection[:n])) > 11.25
    errors = [np.max(np.abs(each - last[-1])) for each in last[:-1]]
    order = -np.polyfit(np.log(counts[:-1]), np.log(errors), 1)[0]
    assert 1.5 < order < 2.5


# --- energy ----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_energy_of_three_masses(method):
    js, dt, samples = ij.three_mass(zeta=1e-4), 2e-2, 10_001
    force = hit(samples, dt, np.array([[15_000.0], [300.0], [1.0]]))[..., None]
    found = ij.simulate(js, force, dt, inputs=point_input(js, 1), keep=["energy"], method=method)
    e = jax.tree.map(np.asarray, found.energy)
    work = e.work[:, -1:]
    assert np.all(np.abs(e.imbalance) <= (1e-8 if method == "exact" else 1e-10) * work)
    for name in ("kinetic", "elastic", "stored"):
        assert np.all(getattr(e, name) >= -1e-14 * work)
    # By the joints' own account nothing is ever won; forces on straight lines may win a little.
    assert np.all(np.diff(e.slip) >= 0)
    assert np.all(np.diff(e.viscous) >= 0)
    assert np.all(np.diff(e.joints) >= -1e-9 * work)
    assert np.all(e.joints[:, -1:] > 0.01 * work)
    np.testing.assert_allclose(e.slip[:, -1], e.joints[:, -1], rtol=5e-4)
    moved = np.diff(e.work)[:, int(np.pi / HIT / dt) + 2 :]
    np.testing.assert_array_equal(moved, np.zeros_like(moved))


@pytest.mark.parametrize("method", METHODS)
def test_slip_and_joints_agree_with_the_square_of_the_step(method):
    js, end = ij.three_mass(zeta=1e-4), 40.0
    differences = []
    for n in (500, 2000):
        dt = end / n
        f = hit(2001, dt, 300.0)
        row = point_input(js, 1)
        e = ij.simulate(js, f, dt, inputs=row, keep=["energy"], method=method).energy
        differences.append(abs(float(e.slip[n] / e.joints[n]) - 1))
    # Order two, give or take a third.
    assert 10 < differences[0] / differences[1] < 24


@pytest.mark.reference
def test_energy_of_the_reduced_beam(beam):  # noqa: F811
    system, dt = beam[1], 1e-5
    omega = system.modes().omega
    C = system.linearised("low").damping_matrix(5.37e-4)
    structure = ij.LinearStructure(system.structure.M, C, system.structure.K)
    entries = zip(system.labels, np.asarray(system.rows), system.elements, strict=True)
    js = ij.JointedStructure(structure, {label: (row, joint) for label, row, joint in entries})
    found = ij.simulate(
        js,
        half_sine(dt * np.arange(2001), 2000.0, 3 * omega[1]),
        dt,
        inputs=modal_input(js, 1) + modal_input(js, 5),
        keep=["energy"],
    )
    work = float(found.energy.work[-1])
    assert np.max(np.abs(found.energy.imbalance)) <= 1e-6 * work
    assert float(found.energy.joints[-1]) > 0.05 * work
    assert np.min(np.diff(found.energy.slip)) >= 0
    assert float(found.energy.slip[-1]) == pytest.approx(float(found.energy.joints[-1]), rel=1e-4)


def test_energy_with_an_initial_state():
    js = ij.three_mass(zeta=1e-3)
    found = ij.simulate(
        js,
        np.zeros(2001),
        0.05,
        inputs=point_input(js, 1),
        displacement=[0.5, 2.0, 20.0],
        velocity=[1.0, 0.0, 2.0],
        keep=["energy"],
    )
    e = found.energy
    assert float(e.kinetic[0]) == pytest.approx(5 * 5.0, rel=1e-12)
    K = js.structure.K
    u = jnp.array([0.5, 2.0, 20.0])
    assert float(e.elastic[0]) == pytest.approx(float(0.5 * u @ K @ u), rel=1e-12)
    total = float(e.kinetic[0] + e.elastic[0] + e.stored[0])
    assert np.max(np.abs(e.imbalance)) < 1e-7 * total


# --- derivatives -----------------------------------------------------------------------------


JS = ij.three_mass(zeta=1e-3)
BLOW = hit(1601, 0.04, 300.0)
NAMES = ["F_S", "K_T", "chi", "beta", "force", "velocity", "K", "C"]


def late_motion(x):
    """Logarithm of the squared velocities late in a decay; x scales what the names say."""
    joint = ij.Iwan4(F_S=10.0 * x[0], K_T=x[1], chi=-0.5 * x[2], beta=5.0 * x[3])
    scaled = (JS.structure.K * x[6], JS.structure.C * x[7])
    js = JS.with_joints({"J1": joint})
    js = eqx.tree_at(lambda js: (js.structure.K, js.structure.C), js, scaled)
    found = ij.simulate(
        js,
        BLOW * x[4],
        0.04,
        inputs=point_input(js, 1),
        velocity=jnp.array([0.0, 1.0, -1.0]) * x[5],
        keep=["velocity"],
        sliders=50,
    )
    return jnp.log(jnp.sum(found.velocity[-400:] ** 2))


def test_derivatives_against_differences():
    one = jnp.ones(8)
    reverse = np.asarray(compiled_for_one_call(jax.grad(late_motion))(one))
    along = jnp.asarray([1.0, -2.0, 3.0, 0.5, -1.0, 4.0, 2.0, -3.0])
    forward = compiled_for_one_call(lambda x: jax.jvp(late_motion, (x,), (along,))[1])(one)
    assert float(forward) == pytest.approx(float(along @ reverse), rel=1e-10)
    steps = 2.0 ** -np.arange(16, 25)
    moved = steps[:, None, None] * np.eye(8)
    many = jax.jit(jax.vmap(late_motion))
    plus, minus = (np.asarray(many((1 + s * moved).reshape(-1, 8))) for s in (1, -1))
    differences = ((plus - minus) / (2 * np.repeat(steps, 8))).reshape(-1, 8)
    # A slider that just slips or just does not makes a kink: for each parameter the pair of
    # steps counts that agrees best, and it must agree.
    apart = np.abs(np.diff(differences, axis=0) / differences[1:])
    best = np.argmin(apart, axis=0)
    assert np.all(apart[best, np.arange(8)] < 3e-6)
    expected = differences[best + 1, np.arange(8)]
    np.testing.assert_allclose(reverse, expected, rtol=1e-5)


# --- batches ---------------------------------------------------------------------------------


def iwans(F_S, K_T):
    """The three masses with other joints."""
    return JS.with_joints({"J1": ij.Iwan4(F_S=F_S, K_T=K_T, chi=-0.5, beta=5.0)})


def test_batches_are_loops():
    F_S, K_T = np.array([3.0, 10.0, 30.0]), np.array([0.8, 1.0, 1.2])
    dt, row = 0.05, point_input(JS, 1)
    blows = hit(801, dt, np.array([[30.0], [300.0], [3000.0]]))

    def run(js, force):
        found = ij.simulate(js, force, dt, inputs=row, keep=["velocity"], sliders=50)
        assert found.balanced.shape == found.velocity.shape[:-2]
        return found.velocity

    def loop(elements, forces):
        return np.stack([run(iwans(*e), f) for e, f in zip(elements, forces, strict=True)])

    many = list(zip(F_S, K_T, strict=True))
    cases = [
        (run(iwans(F_S, K_T), blows[..., None]), loop(many, blows)),
        # Some parameters with one number for all, and one blow for all.
        (run(iwans(F_S, 1.0), blows[1]), loop([(f, 1.0) for f in F_S], [blows[1]] * 3)),
        (
            jax.jit(jax.vmap(lambda a, b: run(iwans(a, b), blows[1])))(F_S, K_T),
            loop(many, [blows[1]] * 3),
        ),
    ]
    for found, expected in cases:
        size = np.max(np.abs(expected), axis=(1, 2), keepdims=True)
        np.testing.assert_allclose(found / size, expected / size, atol=1e-9)


# --- what is kept, and from where ------------------------------------------------------------


def test_every_substeps_and_sensors():
    dt, row = 0.05, point_input(JS, 1)
    coarse = hit(201, dt, 300.0)
    keep = ["displacement", "velocity", "acceleration", "joint_force", "joint_deflection"]
    whole = ij.simulate(JS, coarse, dt, inputs=row, keep=keep, substeps=4)
    t = dt / 4 * np.arange(801)
    between = np.interp(t, dt * np.arange(201), coarse)
    fine = ij.simulate(JS, between, dt / 4, inputs=row, keep=keep, every=4)
    np.testing.assert_allclose(fine.time, whole.time, rtol=1e-14)
    for name in keep:
        expected = np.asarray(getattr(whole, name))
        size = np.max(np.abs(expected))
        np.testing.assert_allclose(getattr(fine, name), expected, atol=1e-10 * size)
    across = np.asarray(whole.displacement) @ np.array([0.0, -1.0, 1.0])
    size = np.max(np.abs(across))
    np.testing.assert_allclose(whole.joint_deflection[:, 0], across, atol=1e-12 * size)
    # Sensors; a last sample that is not kept, and samples that do not fill a block.
    sensors = np.array([[0.0, -1.0, 1.0], [0.5, 0.0, 0.0]])
    part = ij.simulate(
        JS, coarse, dt, inputs=row, sensors=sensors, keep=keep[:3], substeps=4, every=7
    )
    np.testing.assert_allclose(part.time, 7 * dt * np.arange(29), rtol=1e-14)
    for name in keep[:3]:
        expected = np.asarray(getattr(whole, name))[::7] @ sensors.T
        size = np.max(np.abs(expected))
        np.testing.assert_allclose(getattr(part, name), expected, atol=1e-10 * size)
    assert part.joint_force is None
    assert part.energy is None


def many_joints(n=10, zeta=0.02):
    """A chain with an element between any two masses, of four kinds."""
    K = 50.0 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    kinds = [
        ij.Iwan4(F_S=3.0, K_T=5.0, chi=-0.5, beta=1.0),
        ij.Jenkins(F_S=1.0, K_T=4.0),
        ij.CubicSpring(k3=20.0),
        ij.Dashpot(c=0.2),
    ]
    rows = np.eye(n, k=1)[: n - 1] - np.eye(n)[: n - 1]
    entries = {f"J{i}": (rows[i], kinds[i % 4]) for i in range(n - 1)}
    bare = ij.JointedStructure(ij.LinearStructure(np.eye(n), None, K), entries)
    C = bare.linearised("low").damping_matrix(zeta)
    return ij.JointedStructure(ij.LinearStructure(np.eye(n), C, K), entries)


@pytest.mark.long
def test_many_joints_of_many_kinds():
    js = many_joints()
    t = 0.02 * np.arange(1001)
    row = point_input(js, 4)
    found = ij.simulate(js, sine(t, 20.0, 3.0), 0.02, inputs=row, sliders=30)
    assert bool(found.balanced)
    # Each element's force is what it gives along its own deflections.
    d = np.diff(found.displacement, axis=1)
    for i, (label, joint) in enumerate(list(js.joints.items())[:5]):
        force = np.asarray(found.joint_force)[:, i]
        if isinstance(joint, ij.Dashpot):
            expected = 0.2 * np.diff(found.velocity, axis=1)[:, i]
        else:
            expected = np.asarray(ij.hysteresis(joint, d[:, i], sliders=30))
        size = np.max(np.abs(expected))
        np.testing.assert_allclose(force, expected, atol=1e-9 * size, err_msg=label)
    M, C, K = (np.asarray(A) for A in (js.structure.M, js.structure.C, js.structure.K))
    u, v, a = (np.asarray(x) for x in (found.displacement, found.velocity, found.acceleration))
    load = np.outer(sine(t, 20.0, 3.0), row)
    rest = a @ M + v @ C + u @ K + np.asarray(found.joint_force) @ np.asarray(js.rows) - load
    np.testing.assert_allclose(rest, 0.0, atol=1e-10 * 20)


def test_modes_left_out_act_by_their_flexibility():
    n = 12
    K = 50.0 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    M = np.eye(n)
    row = np.eye(n)[8] - np.eye(n)[3]
    joint = ij.CubicSpring(k3=30.0)
    damped = ij.JointedStructure(ij.LinearStructure(M, 3.0 * M, K), {"J": (row, joint)})
    # Slow enough to be static: loaded and held until all has come to rest.
    t = 0.05 * np.arange(2001)
    force = 40.0 * np.minimum(t / 20, 1.0)
    load = np.eye(n)[6]
    still = scipy.optimize.root(
        lambda u: K @ u + row * 30.0 * (row @ u) ** 3 - 40.0 * load, np.zeros(n), tol=1e-13
    ).x
    found = ij.simulate(
        damped, force, 0.05, inputs=load, modes=1, keep=["displacement", "joint_deflection"]
    )
    np.testing.assert_allclose(found.displacement[-1], still, rtol=1e-8)
    assert float(found.joint_deflection[-1, 0]) == pytest.approx(row @ still, rel=1e-8)
    # All modes kept by number are all modes.
    whole, same = (
        ij.simulate(damped, force[:200], 0.05, inputs=load, modes=m, keep=["displacement"])
        for m in (None, n)
    )
    np.testing.assert_array_equal(same.displacement, whole.displacement)


def test_base_excitation_is_motion_against_an_inertial_frame():
    t = 0.02 * np.arange(1001)
    js = ij.three_mass(zeta=0.02)
    relative = ij.simulate(
        js, sine(t, 5.0, 0.9), 0.02, inputs=base_input(js, np.ones(3)), keep=["displacement"]
    )
    # The ground as a fourth, heavy mass that the force moves.
    heavy = 1e9
    M = np.diag([heavy, 10.0, 10.0, 10.0])
    L = np.array([[-1.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 1.0]])
    C, K = (L.T @ np.asarray(A) @ L for A in (js.structure.C, js.structure.K))
    free = ij.JointedStructure(
        ij.LinearStructure(M, C, K), {"J1": ([0.0, 0.0, -1.0, 1.0], js.joints["J1"])}
    )
    push = heavy * sine(t, 5.0, 0.9)
    absolute = ij.simulate(
        free, push, 0.02, inputs=[1.0, 0.0, 0.0, 0.0], sensors=L, keep=["displacement"]
    )
    size = np.max(np.abs(relative.displacement))
    np.testing.assert_allclose(absolute.displacement, relative.displacement, atol=1e-6 * size)


# --- refusals --------------------------------------------------------------------------------


class Stiction(ij.LinearSpring):
    """A force that jumps with the sign of the deflection: no balance in between."""

    def law(self):
        return lambda d: (5.0 * jnp.sign(d), jnp.zeros_like(d))


def test_no_balance_is_said_and_leaves_no_numbers():
    js = ij.three_mass(joint=Stiction(k=1e-3))
    t = 0.05 * np.arange(401)
    force = np.array([0.0, 1.0])[:, None] * sine(t, 20.0, 1.0)
    row = point_input(js, 2)
    with pytest.raises(ij.AccuracyError, match=r"joints find no balance in case 1 with steps of"):
        ij.simulate(js, force[..., None], 0.05, inputs=row)
    found = ij.simulate(js, force[..., None], 0.05, inputs=row, accuracy=None)
    np.testing.assert_array_equal(found.balanced, [True, False])
    still, moving = np.asarray(found.velocity)
    np.testing.assert_array_equal(still, np.zeros((401, 3)))
    bad = np.isnan(moving).any(axis=1)
    # From the first step without balance on.
    assert bad[-1]
    np.testing.assert_array_equal(bad, np.arange(401) >= np.argmax(bad))


ZERO = np.zeros((10, 3))
PAIR = JS.with_joints({"J1": ij.Jenkins(F_S=np.array([1.0, 2.0]), K_T=1.0)})
BAD: dict[str, tuple[dict[str, Any], str]] = {
    "one column": ({"force": np.zeros(10)}, r"force has shape \(10,\); expected \(N, 3\)"),
    "columns": ({"force": np.zeros((10, 2))}, r"force has shape \(10, 2\); expected \(N, 3\)"),
    "axes": ({"force": np.zeros((2, 2, 10, 3))}, r"force has shape \(2, 2, 10, 3\)"),
    "NaN force": ({"force": ZERO * np.nan}, "force holds 30 NaN"),
    "text": ({"force": "hammer"}, "force is of type"),
    "one sample": ({"force": np.zeros((1, 3))}, r"force has 1 sample\(s\); expected at least 2"),
    "no step": ({"dt": 0.0}, r"dt = 0\.0; expected a positive number"),
    "NaN step": ({"dt": np.nan}, "dt holds 1 NaN"),
    "steps": ({"dt": [0.1, 0.1]}, r"dt = \[0\.1, 0\.1\]; expected a positive number"),
    "text step": ({"dt": "0.1"}, "dt is of type"),
    "inputs": ({"inputs": [[1.0, 0.0]]}, r"inputs has shape \(1, 2\); expected \(rows, 3\)"),
    "inputs' rank": ({"inputs": np.zeros((1, 1, 3))}, r"inputs has shape \(1, 1, 3\)"),
    "NaN sensor": ({"sensors": [np.nan, 0.0, 0.0]}, "sensors holds 1 NaN"),
    "sensors": ({"sensors": [1.0]}, r"sensors has shape \(1, 1\); expected \(rows, 3\)"),
    "displacement": ({"displacement": [1.0]}, r"displacement has shape \(1,\); expected \(3,\)"),
    "velocity": ({"velocity": np.inf * np.ones(3)}, "velocity holds 3 NaN or infinite"),
    "every": ({"every": 0}, "every = 0; expected a whole number, at least 1"),
    "half": ({"every": 0.5}, r"every = 0\.5; expected a whole number"),
    "too few": ({"every": 10}, "every = 10, but there are 10 samples"),
    "substeps": ({"substeps": -1}, "substeps = -1; expected a whole number"),
    "method": ({"method": "euler"}, "method = 'euler'; expected 'exact' or 'newmark'"),
    "keep": ({"keep": ["speed"]}, r"keep = \['speed'\]; expected a list of displacement"),
    "keep text": ({"keep": "velocity"}, "keep = 'velocity'; expected a list"),
    "modes": ({"modes": 4}, "modes = 4; expected 1 to 3 elastic modes"),
    "no modes": ({"modes": 0}, "modes = 0; expected 1 to 3 elastic modes"),
    "energy": ({"modes": 1, "keep": ["energy"]}, "the energy needs all modes"),
    "sliders": ({"sliders": 2}, "sliders = 2; expected at least 3"),
    "batches": (
        {"structure": PAIR, "force": np.zeros((3, 10, 3))},
        r"batches of different sizes: joints \[\(2,\)\], force \(3,\)",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_clear_line(case):
    change, message = BAD[case]
    with pytest.raises(ij.InputError, match=message) as caught:
        ij.simulate(**({"structure": JS, "force": ZERO, "dt": 0.1} | change))
    assert "\n" not in str(caught.value)


def test_other_refusals():
    with pytest.raises(ij.InputError, match=r"dt = .*expected a positive number"):
        jax.jit(lambda dt: ij.simulate(JS, ZERO, dt).velocity)(0.1)
    scaled = jax.jit(
        lambda k: (
            ij.simulate(
                eqx.tree_at(lambda js: js.structure.K, JS, k * JS.structure.K), ZERO, 0.1, modes=1
            ).velocity
        )
    )
    with pytest.raises(ij.InputError, match="modes= cannot be chosen while the matrices"):
        scaled(1.0)
