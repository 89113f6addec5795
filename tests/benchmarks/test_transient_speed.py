"""Speed of integration in time, beside a plain NumPy loop and OpenSees where it is installed.

Run by ``make bench``. Figures land in ``extra_info`` and are printed; nothing is asserted of
time. All three integrate the same system by the average acceleration, and agree.
"""

import time

import jax
import numpy as np
import pytest
from test_qsma_speed import first_and_best, lap_joint

import iwanjax as ij
from iwanjax.dynamics import half_sine, point_input
from iwanjax.joints import SliderBank

DT, OMEGA, P = 0.02, 1.744115, 15_000.0
STEPS, NUMPY_STEPS = 20_000, 2_000


def hit(steps: int) -> np.ndarray:
    return np.asarray(half_sine(DT * np.arange(steps + 1), P, OMEGA))


def numpy_loop(bank: SliderBank, steps: int) -> tuple[float, np.ndarray]:
    """Seconds a step, and the last displacement: full matrices, Newton, sliders in NumPy."""
    js = ij.three_mass()
    M, K = np.asarray(js.structure.M), np.asarray(js.structure.K)
    b, f = np.asarray(js.rows)[0], hit(steps)
    phi, k = np.asarray(bank.phi), np.asarray(bank.k)
    stretch, d_0 = np.zeros_like(phi), 0.0
    u, v, a = np.zeros(3), np.zeros(3), np.zeros(3)
    start = time.perf_counter()
    for force in f[1:]:
        target = M @ (4.0 / DT**2 * u + 4.0 / DT * v + a)
        target[1] += force
        new = u.copy()
        for _ in range(20):
            trial = stretch + (b @ new - d_0)
            held = np.clip(trial, -phi, phi)
            r = target - (4.0 / DT**2 * M + K) @ new - b * (k @ held)
            if np.max(np.abs(r)) < 1e-12 * np.max(np.abs(target)):
                break
            tangent = np.sum(k[np.abs(trial) < phi])
            new = new + np.linalg.solve(4.0 / DT**2 * M + K + tangent * np.outer(b, b), r)
        stretch, d_0 = np.clip(stretch + (b @ new - d_0), -phi, phi), b @ new
        a_new = 4.0 / DT**2 * (new - u) - 4.0 / DT * v - a
        u, v, a = new, v + 0.5 * DT * (a + a_new), a_new
    return (time.perf_counter() - start) / steps, u


def opensees(bank: SliderBank, steps: int) -> tuple[float, np.ndarray]:
    """Seconds a step of a C++ structural code with the same sliders in parallel."""
    ops = pytest.importorskip("openseespy.opensees")
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    for i in range(4):
        ops.node(i, 0.0)
    ops.fix(0, 1)
    for i in (1, 2, 3):
        ops.mass(i, 10.0)
    ops.uniaxialMaterial("Elastic", 1, 9.0)
    for i in range(3):
        ops.element("zeroLength", i + 1, i, i + 1, "-mat", 1, "-dir", 1)
    tags = range(100, 100 + bank.phi.size)
    for tag, k, phi in zip(tags, bank.k, bank.phi, strict=True):
        ops.uniaxialMaterial("ElasticPP", tag, float(k), float(phi))
    ops.uniaxialMaterial("Parallel", 99, *tags)
    ops.element("zeroLength", 10, 2, 3, "-mat", 99, "-dir", 1)
    ops.timeSeries("Path", 1, "-dt", DT, "-values", *hit(steps).tolist())
    ops.pattern("Plain", 1, 1)
    ops.load(2, 1.0)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.test("NormDispIncr", 1e-9, 20)
    ops.algorithm("Newton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("SimulatedResponse")
    start = time.perf_counter()
    assert ops.analyze(steps, DT) == 0
    return (time.perf_counter() - start) / steps, np.array([ops.nodeDisp(i, 1) for i in (1, 2, 3)])


def test_three_masses_with_100_sliders(benchmark, capsys):
    """Target: 5 microseconds a step."""
    js = ij.three_mass()
    bank = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0).slider_bank(100)
    force, row = hit(STEPS), point_input(js, 1)
    found = {}

    def integrate(method: str) -> jax.Array:
        found[method] = ij.simulate(
            js, force, DT, inputs=row, method=method, keep=("displacement",), sliders=100
        ).displacement
        return found[method]

    times = {m: first_and_best(lambda m=m: integrate(m), 5) for m in ("newmark", "exact")}
    benchmark.pedantic(lambda: jax.block_until_ready(integrate("newmark")), rounds=3)
    slow, u = numpy_loop(bank, NUMPY_STEPS)
    assert found["newmark"][NUMPY_STEPS] == pytest.approx(u, rel=1e-6)
    told = {m: best / STEPS * 1e6 for m, (_, best) in times.items()}
    told["numpy"] = slow * 1e6
    try:
        each, u = opensees(bank, STEPS)
        assert found["newmark"][-1] == pytest.approx(u, rel=1e-4)
        told["opensees"] = each * 1e6
    except pytest.skip.Exception:
        pass
    benchmark.extra_info.update(told)
    with capsys.disabled():
        print("\nmicroseconds a step: " + ", ".join(f"{k} {v:.2f}" for k, v in told.items()))
        print(f"first call {times['newmark'][0]:.1f} s")


def test_beam_with_1000_sliders(benchmark, capsys):
    """78 coordinates, five joints of 200 sliders; target: 80 000 steps a second."""
    js = lap_joint()
    strength = 0.02
    joints = {f"J{j}": ij.Iwan4(F_S=strength, K_T=1.0, chi=-0.5, beta=0.5) for j in range(5)}
    js = js.with_joints(joints)
    dt = 0.1 / float(js.modes().omega[2])
    force = half_sine(dt * np.arange(STEPS + 1), 1.0, float(js.modes().omega[0]))
    row = point_input(js, 5)
    told = {}
    for modes in (None, 20):

        def integrate(modes=modes) -> jax.Array | None:
            return ij.simulate(
                js, force, dt, inputs=row, sensors=row, modes=modes, keep=("velocity",)
            ).velocity

        first, best = first_and_best(integrate, 3)
        told[f"{modes or 'all'} modes"] = STEPS / best
        told[f"{modes or 'all'} modes, first call s"] = first
    benchmark.pedantic(lambda: jax.block_until_ready(integrate()), rounds=3)
    benchmark.extra_info.update(told)
    with capsys.disabled():
        print("\nsteps a second: " + ", ".join(f"{k} {v:.3g}" for k, v in told.items()))
