"""Speed of quasi-static modal analysis beside a naive full-size solve in the same run.

Run by ``make bench``. Every figure lands in the benchmark's ``extra_info`` and is printed:
time, ratio to the naive solve, compile time, peak memory. Nothing is asserted of time; the
results' correctness is.
"""

import resource
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.structures.small import solve_spd

LEVELS, MODES, SETS = 50, [0, 1, 2], 100_000
NAIVE_SETS = 16


def lap_joint() -> ij.JointedStructure:
    """78 coordinates: two free chains of 39 masses, weakly coupled, five joints between them."""
    n = 39
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    rows = np.zeros((5, 2 * n))
    for j in range(5):
        rows[j, n - 5 + j], rows[j, n + j] = -1.0, 1.0
    whole = np.kron(np.eye(2), K) + 0.2 * rows.T @ rows
    spring = ij.LinearSpring(k=1.0)
    return ij.JointedStructure(
        ij.LinearStructure(np.eye(2 * n), None, whole),
        {f"J{j}": (rows[j], spring) for j in range(5)},
    )


@pytest.fixture(scope="module")
def study():
    """The structure, its load levels, and random joints of the thesis's ranges (Sec. 3.4.3)."""
    system = lap_joint()
    levels = np.stack([w**2 * np.geomspace(0.1, 20.0, LEVELS) for w in system.modes().omega[:3]])
    stroke = np.abs(ij.qsma(system, MODES, levels).deflection[:, -1]).max(axis=0)
    rng = np.random.default_rng(0)

    def joints(sets: int, *, batched_stiffness: bool = False) -> ij.JointedStructure:
        drawn = {}
        for j in range(5):
            chi = rng.uniform(-0.99, -0.01, sets)
            # Powers of ten as the thesis draws them: phi_max 1 to 10 strokes, R 0.1 to 1 R_max.
            phi = float(stroke[j]) * 10.0 ** rng.uniform(0.0, 1.0, sets)
            rho = 10.0 ** rng.uniform(-1.0, 0.0, sets)
            K_T = np.ones(sets) if batched_stiffness else 1.0
            F_S = phi * (1 - rho / (chi + 2))
            drawn[f"J{j}"] = ij.Iwan4(F_S=F_S, K_T=K_T, chi=chi, beta=1 / rho - 1)
        return system.with_joints(drawn)

    return system, levels, joints


def first_and_best(call, rounds: int) -> tuple[float, float]:
    """Seconds of the first call, compilation included, and of the best later one."""
    times = []
    for _ in range(rounds + 1):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return times[0], min(times[1:])


def naive(system: ij.JointedStructure, levels: np.ndarray):
    """Newton on all 78 coordinates, level after level, a dense solve a step, vmapped over sets."""
    K, M, B = system.structure.K, system.structure.M, system.rows
    K0 = K + B.T @ B
    rigid = ij.LinearStructure(M, None, K0).rigid_body_modes()
    hold = M @ rigid @ rigid.T @ M

    def one(elements):
        def mode(phi, alphas):
            def level(u, alpha):
                def newton(_, u):
                    d = B @ u
                    pairs = [joint.law()(d[j]) for j, joint in enumerate(elements)]
                    force = jnp.stack([pair[0] for pair in pairs])
                    tangent = jnp.stack([pair[1] for pair in pairs])
                    r = alpha * (M @ phi) - (K + hold) @ u - B.T @ force
                    return u + jnp.linalg.solve(K + hold + (B.T * tangent) @ B, r)

                u = jax.lax.fori_loop(0, 5, newton, u)
                return u, phi @ M @ u

            return jax.lax.scan(level, jnp.zeros(K.shape[0]), alphas)[1]

        return jnp.stack([mode(system.basis.Phi[:, r], jnp.asarray(levels[r])) for r in MODES])

    axes = jax.tree.map(lambda leaf: 0 if leaf.ndim else None, system.elements)
    return jax.jit(jax.vmap(one, in_axes=(axes,)))


def floor(sets: int = 20_000) -> float:
    """Seconds a set for 3 120 powers and 474 5 x 5 solves at XLA's own rates."""
    rng = np.random.default_rng(0)
    x, a = jnp.asarray(rng.uniform(0.1, 1, 480_000)), jnp.asarray(rng.uniform(0, 1, 480_000))
    power = jax.jit(lambda x, a: x**a)
    _, powers = first_and_best(lambda: power(x, a), 10)
    A = rng.normal(size=(5, 5, sets))
    J = np.einsum("ikn,jkn->ijn", A, A) + 5 * np.eye(5)[..., None]
    rows, r = [list(map(jnp.asarray, row)) for row in J], [jnp.ones(sets)] * 5
    solve = jax.jit(solve_spd)
    _, solves = first_and_best(lambda: solve(rows, r), 10)
    return 3120 * powers / 480_000 + 474 * solves / sets


def tell(benchmark, **figures) -> None:
    benchmark.extra_info.update(figures)
    print("\n" + "  ".join(f"{k} {v:.4g}" for k, v in figures.items()))


def test_batch(benchmark, study):
    """100 000 parameter sets x 3 modes x 50 levels."""
    _, levels, joints = study
    reference = joints(NAIVE_SETS)
    slow = naive(reference, levels)
    _, naive_s = first_and_best(lambda: slow(reference.elements), 2)
    ours = ij.qsma(reference, MODES, levels)
    np.testing.assert_allclose(slow(reference.elements), ours.q, rtol=1e-7)
    batch = joints(SETS)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    solution = ij.qsma(batch, MODES, levels, deflections=False)
    first = time.perf_counter() - start
    assert bool(solution.converged.all())
    benchmark.pedantic(
        lambda: jax.block_until_ready(ij.qsma(batch, MODES, levels, deflections=False).q),
        rounds=3,
    )
    best = benchmark.stats.stats.min
    tell(
        benchmark,
        seconds=best,
        us_per_set=1e6 * best / SETS,
        times_floor=best / SETS / floor(),
        naive_over_ours=naive_s / NAIVE_SETS / (best / SETS),
        compile_s=first - best,
        peak_MiB=(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024,
    )


@pytest.mark.parametrize("varied", [False, True], ids=["joints", "joints and stiffness"])
def test_gradient(benchmark, study, varied):
    """Value and gradient of a loss in 15 or 20 parameters a set, beside the value alone."""
    _, levels, joints = study
    sets = 2048
    system = joints(sets, batched_stiffness=varied)
    weights = np.random.default_rng(1).normal(size=(3, LEVELS))

    def loss(elements):
        moved = system.with_joints(dict(zip(system.labels, elements, strict=True)))
        curves = ij.qsma(moved, MODES, levels, deflections=False).curves
        return jnp.sum(weights * (1e3 * curves.damping + curves.frequency))

    value, both = jax.jit(loss), jax.jit(jax.value_and_grad(loss))
    _, forward = first_and_best(lambda: value(system.elements), 5)
    start = time.perf_counter()
    jax.block_until_ready(both(system.elements))
    first = time.perf_counter() - start
    benchmark.pedantic(lambda: jax.block_until_ready(both(system.elements)), rounds=5)
    best = benchmark.stats.stats.min
    tell(
        benchmark,
        us_per_set=1e6 * best / sets,
        times_forward=best / forward,
        compile_s=first - best,
    )


def test_backbone(benchmark):
    """One 50-level backbone of the three masses, compiled."""
    system, alpha = ij.three_mass(), jnp.geomspace(1e-2, 3e2, LEVELS)

    @jax.jit
    def curves(alpha):
        found = ij.qsma(system, 1, alpha, 1e-4).curves
        return found.frequency, found.damping

    start = time.perf_counter()
    jax.block_until_ready(curves(alpha))
    first = time.perf_counter() - start
    benchmark(lambda: jax.block_until_ready(curves(alpha)))
    tell(benchmark, ms=1e3 * benchmark.stats.stats.min, compile_s=first)
