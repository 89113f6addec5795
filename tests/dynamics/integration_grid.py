"""Simulations from microslip to deep macroslip, with steps short and long, beside a converged run.

`python tests/dynamics/integration_grid.py [--only NAME ...] [--out TABLE.md]`

The converged run shares nothing with the package but the sliders' thresholds and stiffnesses: modes
by SciPy, joints by kicks between exact linear motion (Strang's splitting, explicit), steps halved
until halving them again changes nothing. Errors are rms over the record, of all elastic modes'
displacements or velocities, the larger; a silent error is one of a response that was returned.
"""

import argparse
import math
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, expm

import iwanjax as ij
from iwanjax.dynamics import half_sine

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.structures import STRUCTURES

Array = NDArray[np.float64]

SAMPLES = 800
PERIODS = (0.02, 0.2, 0.7, 2.0)
"""Steps over the period of the fastest mode that joints take part in."""
LOADS = {"microslip": 0.02, "partial slip": 1.0, "macroslip": 60.0}
"""Deflection of the joint that moves most, over phi_max, if all were stuck."""
ALLOWED = 0.01
"""Error and missing energy that a response may be returned with, unless told otherwise."""
CONVERGED = 0.002
"""Largest change that a converged run's last halving of its step may bring."""


@dataclass(frozen=True)
class System:
    """A structure and the row along which it is struck."""

    structure: ij.JointedStructure
    row: Array


def joint_mode(js: ij.JointedStructure) -> float:
    """Circular frequency of the fastest mode that joints take part in."""
    omega = np.sqrt(np.asarray(js.basis.omega2))
    strain = omega * np.abs(np.asarray(js.rows) @ np.asarray(js.basis.Phi))
    part = np.max(strain / np.max(strain, axis=1, keepdims=True), axis=0)
    return float(np.max(omega[part > 1e-3]))


def modal_sensors(js: ij.JointedStructure) -> Array:
    """Rows that see the modal displacements of the elastic modes."""
    omega2 = np.asarray(js.basis.omega2)
    Phi = np.asarray(js.basis.Phi)[:, omega2 > 1e-9 * np.max(omega2)]
    return (np.asarray(js.structure.M) @ Phi).T


def blow(
    js: ij.JointedStructure, row: Array, dt: float, level: float, samples: int = SAMPLES
) -> Array:
    """A half sine whose deflections would be ``level`` times phi_max if the joints were stuck."""
    lowest = float(js.modes().omega[0])
    duration = min(max(8 * dt, 2.0 / lowest), 0.2 * samples * dt)
    force = np.asarray(half_sine(dt * np.arange(samples + 1), 1.0, np.pi / duration))
    return force * level / _kicked(System(js, row), force, dt, 1, stuck=True).reach


def distance(found: Any, expected: Any) -> list[float]:
    """Rms of the difference over rms of what was expected, displacement and velocity."""
    return [
        float(np.linalg.norm(np.asarray(a) - np.asarray(b)) / np.linalg.norm(np.asarray(b)))
        for a, b in (
            (found.displacement, expected.displacement),
            (found.velocity, expected.velocity),
        )
    ]


@dataclass(frozen=True)
class Converged:
    """Modal displacements and velocities at the samples, and the largest deflection over phi_max.

    ``change`` is what the last halving of the step has changed, as an error.
    """

    displacement: Array
    velocity: Array
    reach: float
    change: float


def converged(system: System, force: Array, dt: float) -> Converged:
    """The response to forces that are linear between samples, by kicks and exact linear motion."""
    omega = joint_mode(system.structure)
    steps = max(1, math.ceil(dt * omega / 0.1))
    before = _kicked(system, force, dt, steps)
    while True:
        steps *= 2
        after = _kicked(system, force, dt, steps)
        change = max(distance(before, after))
        if change <= CONVERGED or steps * SAMPLES > 3e7:
            return Converged(after.displacement, after.velocity, after.reach, change)
        before = after


def _kicked(
    system: System, force: Array, dt: float, steps: int, *, stuck: bool = False
) -> Converged:
    """The same with so many steps from one sample to the next; or with joints that never slip."""
    js = system.structure
    M, K, B = (np.asarray(x) for x in (js.structure.M, js.structure.K, js.rows))
    C = np.asarray(js.structure.C)
    joints = [joint for joint in js.joints.values() if isinstance(joint, ij.Iwan4)]
    K_T = np.array([float(joint.K_T) for joint in joints])
    omega2, Phi = eigh(K + B.T @ (K_T[:, None] * B), M)
    omega2[omega2 < 1e-9 * omega2[-1]] = 0.0
    P, W, damping = B @ Phi, system.row @ Phi, Phi.T @ C @ Phi
    classical = np.allclose(damping, np.diag(np.diag(damping)), atol=1e-9 * np.abs(damping).max())
    damping = np.diag(damping) if classical else damping
    banks = [joint.discrete() for joint in joints]
    phi, k = (np.stack([np.asarray(getattr(bank, x)) for bank in banks]) for x in ("phi", "k"))
    q, v, d = _march(
        tuple(map(jnp.asarray, _linear(omega2, damping, dt / steps))),
        *map(jnp.asarray, (P, W, np.inf * phi if stuck else phi, k, force)),
        dt / steps,
        steps,
    )
    phi_max = np.array([float(joint.phi_max) for joint in joints])
    reach = float(np.max(np.abs(np.asarray(d)) / phi_max))
    sees = modal_sensors(js) @ Phi
    return Converged(np.asarray(q) @ sees.T, np.asarray(v) @ sees.T, reach, math.nan)


def _linear(omega2: Array, damping: Array, h: float) -> tuple[Array, Array, Array]:
    """Transition over h of (q, h v), and what modal forces at its ends add: exponentials."""
    m = omega2.shape[0]
    if damping.ndim == 1:
        whole = np.zeros((m, 4, 4))
        whole[:, 0, 1] = 1.0
        whole[:, 1, 0], whole[:, 1, 1], whole[:, 1, 2] = -omega2 * h**2, -damping * h, h**2
        whole[:, 2, 3] = 1.0
        whole = np.asarray(expm(whole), np.float64)
        return whole[:, :2, :2], whole[:, :2, 2] - whole[:, :2, 3], whole[:, :2, 3]
    eye, none = np.eye(m), np.zeros((m, m))
    generator = np.block(
        [
            [none, eye, none, none],
            [-np.diag(omega2) * h**2, -damping * h, h**2 * eye, none],
            [none, none, none, eye],
            [none, none, none, none],
        ]
    )
    whole = np.asarray(expm(generator), np.float64)
    two = 2 * m
    last = whole[:two, two + m :]
    return whole[:two, :two], whole[:two, two : two + m] - last, last


@jax.jit
def _march(
    linear: tuple[jax.Array, ...],
    P: jax.Array,
    W: jax.Array,
    phi: jax.Array,
    k: jax.Array,
    force: jax.Array,
    h: jax.Array,
    steps: jax.Array,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Modal displacements and velocities, and joints' deflections, at the samples."""
    E, E_0, E_1 = linear
    K_ref = jnp.sum(k, axis=1)

    def moved(z: jax.Array, f_0: jax.Array, f_1: jax.Array) -> jax.Array:
        """z = (q, h v), (modes, 2), after a step without joints."""
        if E.ndim == 3:
            return jnp.einsum("mij,mj->mi", E, z) + W[:, None] * (E_0 * f_0 + E_1 * f_1)
        flat = E @ z.T.reshape(-1) + (E_0 * f_0 + E_1 * f_1) @ W
        return flat.reshape(2, -1).T

    def pulled(d: jax.Array, last: jax.Array, stretch: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Pseudo-forces K_ref d - F, and the sliders' stretches."""
        stretch = jnp.clip(stretch + (d - last)[:, None], -phi, phi)
        return K_ref * d - jnp.sum(k * stretch, axis=1), stretch

    def sample(at: tuple[jax.Array, ...], ends: tuple[jax.Array, jax.Array]) -> tuple[Any, Any]:
        slope = (ends[1] - ends[0]) / steps

        def step(i: jax.Array, at: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
            z, d, g, stretch = at
            f_0, f_1 = ends[0] + slope * i, ends[0] + slope * (i + 1)
            # (q, h v): a kick of h/2 is h^2/2 times the modal forces.
            z = moved(z.at[:, 1].add(0.5 * h**2 * (P.T @ g)), f_0, f_1)
            last, d = d, P @ z[:, 0]
            g, stretch = pulled(d, last, stretch)
            return z.at[:, 1].add(0.5 * h**2 * (P.T @ g)), d, g, stretch

        at = jax.lax.fori_loop(0, steps, step, at)
        return at, (at[0], at[1])

    none = jnp.zeros_like(K_ref)
    start = (jnp.zeros((P.shape[1], 2)), none, none, jnp.zeros_like(phi))
    _, (z, d) = jax.lax.scan(sample, start, (force[:-1], force[1:]))
    z = jnp.concatenate([jnp.zeros_like(z[:1]), z])
    return z[..., 0], z[..., 1] / h, d


def random_system(n: int, seed: int) -> System:
    """A chain with cross springs, free or grounded, and one to three joints of any stiffness."""
    rng = np.random.default_rng([29, seed])
    ratio = 10.0 ** rng.uniform(-1.0, 4.0)

    def spring() -> float:
        return 10.0 ** rng.uniform(0.0, 1.0)

    K = np.zeros((n, n))
    pairs = [(i, i + 1) for i in range(n - 1)]
    pairs += [tuple(rng.choice(n, 2, replace=False)) for _ in range(n // 4)]
    for i, j in pairs:
        row = np.eye(n)[j] - np.eye(n)[i]
        K += spring() * np.outer(row, row)
    if rng.uniform() < 0.7:
        K[0, 0] += spring()
    M = np.diag(10.0 ** rng.uniform(-0.5, 0.5, n))
    joints = {}
    for place in range(1 + n % 3):
        i, j = rng.choice(n, 2, replace=False)
        K_T = ratio * spring()
        joint = ij.Iwan4(
            F_S=K_T * 10.0 ** rng.uniform(-1.0, 1.0),
            K_T=K_T,
            chi=rng.uniform(-0.9, 0.0),
            beta=10.0 ** rng.uniform(-1.0, 1.0),
        )
        joints[f"J{place + 1}"] = (np.eye(n)[j] - np.eye(n)[i], joint)
    bare = ij.JointedStructure(ij.LinearStructure(M, None, K), joints)
    C = np.asarray(bare.linearised("low").damping_matrix(10.0 ** rng.uniform(-4.0, -2.0)))
    if rng.uniform() < 0.3:
        # A damper that couples the modes: a tenth of what is critical for a mass and a spring.
        row = np.eye(n)[-1] - np.eye(n)[0]
        C = C + 0.2 * np.outer(row, row)
    js = ij.JointedStructure(ij.LinearStructure(M, C, K), joints)
    return System(js, np.eye(n)[int(rng.integers(n))])


def _concealed(name: str, point: str) -> System:
    """One of the structures of the concealed cases."""
    given = STRUCTURES[name]
    joints = {
        label: (given.rows[label], ij.Iwan4(F_S=F_S, K_T=K_T, chi=chi, beta=beta))
        for label, (F_S, K_T, chi, beta) in given.joints.items()
    }
    js = ij.JointedStructure(ij.LinearStructure(given.M, given.C, given.K), joints)
    return System(js, np.asarray(given.inputs[point]))


def _beam(model: Any, joints: dict[str, ij.Iwan4], point: str, zeta: float) -> System:
    entries = {name: (model.rows[name], joint) for name, joint in joints.items()}
    bare = ij.JointedStructure(model.structure, entries)
    C = bare.linearised("low").damping_matrix(zeta)
    structure = ij.LinearStructure(model.structure.M, C, model.structure.K)
    return System(ij.JointedStructure(structure, entries), np.asarray(model.inputs[point]))


def _sumali() -> System:
    from iwanjax.structures.fem.sumali import sumali_springs

    return _beam(ij.sumali_beam().model(sumali_springs()), ij.sumali_joints(), "left", 1e-4)


def _brake_reuss() -> System:
    from iwanjax.structures.fem.brake_reuss import brake_reuss_springs

    model = ij.brake_reuss_beam(size=20.0).model(brake_reuss_springs("y"))
    (point, *_) = model.inputs
    return _beam(model, ij.brake_reuss_joints(), point, 4.5e-4)


_SIZES = (2, 2, 2, 3, 3, 3, 7, 7, 7, 12, 12, 12, 20, 20, 20, 20, 29, 29, 40, 40)

SYSTEMS: dict[str, Callable[[], System]] = {
    "three masses": lambda: System(ij.three_mass(zeta=1e-3), np.eye(3)[1]),
    "chain of six": partial(_concealed, "chain6", "m1"),
    "Sumali beam": _sumali,
    "Brake-Reuss beam": _brake_reuss,
    "lap beam, not reduced": partial(_concealed, "lap_beam", "tip"),
    # Alike ones share their compiled kernels.
    **{f"random {seed}": partial(random_system, n, seed) for seed, n in enumerate(_SIZES)},
}


@dataclass(frozen=True)
class Cell:
    """One simulation beside its converged run; errors are shares, NaN where it was refused."""

    name: str
    coordinates: int
    periods: float
    regime: str
    reach: float
    error: float
    imbalance: float
    change: float
    said: str

    @property
    def silent(self) -> bool:
        """Whether a response was returned that is wrong."""
        return not (self.said.startswith("refused") or self.error <= ALLOWED)

    def __str__(self) -> str:
        numbers = f"{100 * self.error:.3f} | {100 * self.imbalance:.3f} | {100 * self.change:.3f}"
        return (
            f"| {self.name} | {self.coordinates} | {self.periods:g} | {self.regime} | "
            f"{self.reach:.3g} | {numbers} | {self.said} |"
        )


HEAD = """\
| structure | coordinates | step / period | load | deflection / phi_max | error % | energy % | \
reference's change % | simulate said |
|---|---|---|---|---|---|---|---|---|"""


def cell(name: str, system: System, periods: float, regime: str) -> Cell:
    """Simulate with the package's defaults and hold it against the converged run."""
    js, row = system.structure, system.row
    dt = periods * 2 * np.pi / joint_mode(js)
    force = blow(js, row, dt, LOADS[regime])
    truth = converged(system, force, dt)
    head = (name, js.structure.size, periods, regime, truth.reach)
    try:
        found = ij.simulate(
            js,
            force,
            dt,
            inputs=row,
            sensors=modal_sensors(js),
            keep=["displacement", "velocity"],
        )
    except ij.AccuracyError as error:
        step = re.search(r"try steps of (\S+) s", str(error))
        named = f"refused: steps of {step[1]} s" if step else f"refused without a step: {error}"
        return Cell(*head, math.nan, math.nan, truth.change, named)
    said = "ok" if found.substeps == 1 else f"refined to {found.substeps}"
    wrong = max(distance(found, truth))
    return Cell(*head, wrong, float(found.imbalance), truth.change, said)


def cells(name: str) -> list[Cell]:
    """All of a structure."""
    system = SYSTEMS[name]()
    return [cell(name, system, periods, regime) for periods in PERIODS for regime in LOADS]


def summary(found: list[Cell]) -> str:
    """How many were as asked, refined and refused, and the largest error that was silent."""
    kept = [each for each in found if not each.said.startswith("refused")]
    refined = sum(each.said != "ok" for each in kept)
    worst = max((each.error for each in kept), default=0.0)
    return (
        f"{len(found)} cells: {len(kept) - refined} with the step asked for, {refined} refined, "
        f"{len(found) - len(kept)} refused; largest error {100 * worst:.2f} %, largest missing "
        f"energy {100 * max((each.imbalance for each in kept), default=0.0):.2f} %, "
        f"{sum(each.silent for each in found)} silent above {ALLOWED:.0%}"
    )


def main(arguments: list[str] | None = None) -> int:
    """Print the grid's table; 1 where an error is silent."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--only", nargs="+", choices=tuple(SYSTEMS), metavar="NAME")
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    ij.compile_quickly()
    found: list[Cell] = []
    print(HEAD, flush=True)
    for name in chosen.only or SYSTEMS:
        rows = cells(name)
        found += rows
        print(*rows, sep="\n", flush=True)
        print(f"{name}: {time.process_time():.0f} s of the processor so far", file=sys.stderr)
    print(summary(found))
    if chosen.out:
        lines = [HEAD, *map(str, found), "", summary(found)]
        chosen.out.write_text("\n".join(lines) + "\n")
    return int(any(each.silent for each in found))


if __name__ == "__main__":
    sys.exit(main())
