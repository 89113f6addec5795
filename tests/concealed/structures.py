"""Bolted structures on which effects are concealed: an oscillator, chains and lapped beams.

Every structure is a linear model without its joints (K is K_infinity), the named places where
a force may act, and the nominal joints and hammer of its test. The joints' strengths and the
hammer's peaks belong together: the hard hits drive the largest joint deflection to between
0.1 and 1 times the deflection of macroslip. Doubling the steps within a sampling interval changes
responses by less than 7e-4.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import eigh

from iwanjax.trial.structure import Array, Iwan, TrialStructure


@dataclass(frozen=True, kw_only=True)
class Structure(TrialStructure):
    """A structure and the hammer test that is done on it."""

    peaks: Mapping[str, float]
    """Peak force (N) of the hardest hit at each input."""
    pulse: tuple[int, int]
    """Shortest and longest half-sine pulse, in sampling intervals."""


def rayleigh(M: Array, K: Array, first: tuple[int, float], second: tuple[int, float]) -> Array:
    """Damping a M + b K that gives two modes (counted from 0) their damping ratios."""
    omega = np.sqrt(eigh(K, M, eigvals_only=True))
    modes, ratios = zip(first, second, strict=True)
    w = omega[list(modes)]
    a, b = np.linalg.solve(np.stack([0.5 / w, 0.5 * w], axis=1), np.asarray(ratios))
    return a * M + b * K


def strength(phi_max: float, K_T: float, chi: float, beta: float) -> float:
    """F_S of the joint of tangent stiffness K_T that slips fully at the deflection phi_max."""
    return K_T * phi_max * (beta + (chi + 1) / (chi + 2)) / (1 + beta)


def _joint(phi_max: float, K_T: float, chi: float, beta: float) -> Iwan:
    return strength(phi_max, K_T, chi, beta), K_T, chi, beta


def oscillator() -> Structure:
    """One mass on a spring and an Iwan joint, near 40 Hz; its only place is the joint's."""
    one = np.ones(1)
    joints = {"J1": _joint(1.4e-3, 2.2e4, -0.5, 2.0)}
    M, K = np.eye(1), np.array([[4.1e4]])
    omega = np.sqrt(K[0, 0] + joints["J1"][1])
    return Structure(
        name="oscillator",
        M=M,
        C=np.array([[2 * 0.006 * omega]]),
        K=K,
        rows={"J1": one},
        sensors={"a1": one},
        inputs={"m1": one},
        joints=joints,
        rate=1024.0,
        samples=2048,
        peaks={"m1": 45.0},
        pulse=(8, 14),
    )


_CHAINS: dict[int, tuple[float, float, tuple[Iwan, ...], float]] = {
    # masses: (spring between neighbours, spring at the ends, joints, peak of the hammer)
    2: (6.0e4, 4.0e4, (_joint(8.0e-4, 5.0e4, -0.45, 2.0),), 70.0),
    3: (1.2e5, 4.0e4, (_joint(8.0e-4, 6.0e4, -0.5, 1.5),), 90.0),
    4: (1.4e5, 5.0e4, (_joint(8.0e-4, 6.0e4, -0.4, 2.5), _joint(8.0e-4, 7.0e4, -0.55, 1.5)), 90.0),
    5: (1.3e5, 6.0e4, (_joint(8.0e-4, 6.0e4, -0.45, 1.5), _joint(8.0e-4, 8.0e4, -0.5, 2.5)), 95.0),
    6: (1.2e5, 8.0e4, (_joint(8.0e-4, 8.0e4, -0.5, 2.0), _joint(8.0e-4, 7.0e4, -0.4, 1.5)), 100.0),
}
_MASSES = (1.0, 1.1, 0.9, 1.05, 0.95, 1.0)


def chain(n: int) -> Structure:
    """A chain of n masses of about 1 kg between two walls, modes between about 20 and 120 Hz.

    A joint bridges m1 and m2; from four masses on, another bridges the last two. A neighbour
    pair with a joint is named after the joint only, so that every place has one name.
    """
    between, ends, joints, peak = _CHAINS[n]
    unit = np.eye(n)
    pairs = {f"m{i + 1}-m{i + 2}": unit[i + 1] - unit[i] for i in range(n - 1)}
    K = np.zeros((n, n))
    K[0, 0] += ends
    K[-1, -1] += 0.6 * ends
    bridged = ["m1-m2", f"m{n - 1}-m{n}"][: len(joints)]
    for row in pairs.values():
        K += between * np.outer(row, row)
    for label in bridged:
        # The joint carries part of what its neighbours' springs carry.
        K -= 0.4 * between * np.outer(pairs[label], pairs[label])
    named = {f"J{i + 1}": joint for i, joint in enumerate(joints)}
    rows = {f"m{i + 1}-ground": unit[i] for i in range(n)}
    rows |= {label: row for label, row in pairs.items() if label not in bridged}
    rows |= {f"J{i + 1}": pairs[label] for i, label in enumerate(bridged)}
    M = np.diag(_MASSES[:n])
    stuck = K + sum(j[1] * np.outer(rows[name], rows[name]) for name, j in named.items())
    return Structure(
        name=f"chain{n}",
        M=M,
        C=rayleigh(M, stuck, (0, 0.012), (n - 1, 0.008)),
        K=K,
        rows=rows,
        sensors={f"a{i + 1}": unit[i] for i in range(n)},
        inputs={"m1": unit[0], f"m{n}": unit[-1]},
        joints=named,
        rate=2048.0,
        samples=3072,
        peaks={"m1": peak, f"m{n}": peak},
        pulse=(8, 14),
    )


_E, _DENSITY = 2.1e11, 7800.0


def _beam_element(length: float, width: float, height: float) -> tuple[Array, Array]:
    """Consistent mass and stiffness of a planar frame element: u, w, theta at either end."""
    area, inertia = width * height, width * height**3 / 12
    a, b = _E * area / length, _E * inertia / length**3
    m, s = _DENSITY * area * length, length
    K = np.zeros((6, 6))
    M = np.zeros((6, 6))
    axial, bending = np.ix_([0, 3], [0, 3]), np.ix_([1, 2, 4, 5], [1, 2, 4, 5])
    K[axial] = a * np.array([[1, -1], [-1, 1]])
    M[axial] = m / 6 * np.array([[2, 1], [1, 2]])
    K[bending] = b * np.array(
        [
            [12, 6 * s, -12, 6 * s],
            [6 * s, 4 * s**2, -6 * s, 2 * s**2],
            [-12, -6 * s, 12, -6 * s],
            [6 * s, 2 * s**2, -6 * s, 4 * s**2],
        ]
    )
    M[bending] = (m / 420) * np.array(
        [
            [156, 22 * s, 54, -13 * s],
            [22 * s, 4 * s**2, 13 * s, -3 * s**2],
            [54, 13 * s, 156, -22 * s],
            [-13 * s, -3 * s**2, -22 * s, 4 * s**2],
        ]
    )
    return M, K


_BOLTS = (0.10, 0.18, 0.26)
"""Positions of the lap beam's bolts (m)."""
_Node = tuple[str, float]
"""Of the lower or upper beam, at a position (m)."""


def _lapped(
    name: str,
    beams: Mapping[str, tuple[float, ...]],
    places: Mapping[str, _Node],
    sensors: Mapping[str, _Node],
    samples: int,
) -> Structure:
    """Two steel beams, 0.5 m together, lapped and bolted at three places; one end clamped.

    A bolt is a transverse spring, and in the interface a weak shank spring (both in K) beside
    an Iwan joint along the slip u1 - u2 + h/2 (theta1 + theta2). Beams are nodes' positions.
    """
    width, height = 0.025, 0.014
    nodes = [(beam, x) for beam, positions in beams.items() for x in positions]
    n = 3 * len(nodes)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for i, (one, two) in enumerate(itertools.pairwise(nodes)):
        if one[0] == two[0]:
            at = slice(3 * i, 3 * i + 6)
            m, k = _beam_element(two[1] - one[1], width, height)
            M[at, at] += m
            K[at, at] += k
    unit = np.eye(n)
    slip, opening = [], []
    for x in _BOLTS:
        one, two = nodes.index(("lower", x)), nodes.index(("upper", x))
        turn = 0.5 * height * (unit[3 * one + 2] + unit[3 * two + 2])
        slip.append(unit[3 * one] - unit[3 * two] + turn)
        opening.append(unit[3 * two + 1] - unit[3 * one + 1])
    K_T = 6.0e7
    for row in opening:
        K += 5.0e7 * np.outer(row, row)
    for row in slip:
        K += 0.02 * K_T * np.outer(row, row)
    free = slice(3, None)  # the first node is clamped
    M, K = M[free, free], K[free, free]
    joints = {
        "J1": _joint(1.4e-5, K_T, -0.5, 2.0),
        "J2": _joint(1.4e-5, 0.9 * K_T, -0.4, 1.5),
        "J3": _joint(1.4e-5, 1.1 * K_T, -0.55, 2.5),
    }

    def across(node: _Node) -> Array:
        return unit[3 * nodes.index(node) + 1][free]

    rows = {f"J{i}": row[free] for i, row in enumerate(slip, 1)}
    rows |= {label: across(node) for label, node in places.items()}
    rows |= {f"opening{i}": row[free] for i, row in enumerate(opening, 1)}
    stuck = K + sum(j[1] * np.outer(rows[name], rows[name]) for name, j in joints.items())
    return Structure(
        name=name,
        M=M,
        C=rayleigh(M, stuck, (0, 0.003), (2, 0.003)),
        K=K,
        rows=rows,
        sensors={label: across(node) for label, node in sensors.items()},
        inputs={"tip": across(("upper", 0.50)), "mid": across(("upper", 0.32))},
        joints=joints,
        rate=4096.0,
        samples=samples,
        peaks={"tip": 120.0, "mid": 250.0},
        pulse=(8, 14),
        steps=24,
    )


_SENSORS: Mapping[str, _Node] = {
    "a1": ("upper", 0.50),
    "a2": ("upper", 0.38),
    "a3": ("upper", 0.26),
    "a4": ("lower", 0.14),
}


def lap_beam() -> Structure:
    """The lapped beams in 45 coordinates, with ten places and four sensors."""
    return _lapped(
        "lap_beam",
        {
            "lower": (0.0, 0.05, 0.10, 0.14, 0.18, 0.22, 0.26),
            "upper": (0.10, 0.14, 0.18, 0.22, 0.26, 0.32, 0.38, 0.44, 0.50),
        },
        {
            "w1-ground": ("lower", 0.05),
            "w2-ground": ("lower", 0.22),
            "w3-ground": ("upper", 0.38),
            "tip-ground": ("upper", 0.50),
        },
        _SENSORS,
        samples=4096,
    )


def large_lap_beam() -> Structure:
    """The lapped beams in 57 coordinates, with twenty places and six sensors: for speed."""
    lower = (0.0, 0.025, 0.05, 0.075, 0.10, 0.14, 0.18, 0.22, 0.26)
    upper = (0.10, 0.14, 0.18, 0.22, 0.26, 0.32, 0.35, 0.38, 0.41, 0.44, 0.50)
    at = [("lower", x) for x in lower[1:]] + [("upper", x) for x in upper[5:]]
    return _lapped(
        "large_lap_beam",
        {"lower": lower, "upper": upper},
        {f"w{i}-ground": node for i, node in enumerate(at, 1)},
        {**_SENSORS, "a5": ("upper", 0.44), "a6": ("lower", 0.22)},
        samples=6144,
    )


def brake_reuss() -> Structure:
    """The Brake-Reuss beam on bungees, reduced from a mesh; N, mm and tonne.

    Its joints are those of Table 3.5 of the thesis, along the slip of the five patches.
    """
    with np.load(Path(__file__).with_name("brake_reuss.npz")) as file:
        arrays = dict(file)

    def named(group: str) -> dict[str, Array]:
        return {
            name.removeprefix(f"{group}:"): array
            for name, array in arrays.items()
            if name.startswith(f"{group}:")
        }

    # chi, phi_max (mm), R and K_T of the outer, inner and middle patches
    outer, inner = (-0.418, 8.789e-4, 7.947e6, 5.8e5), (-0.639, 4.346e-4, 5.199e5, 1.1e5)
    middle = (-0.271, 6.612e-4, 4.769e7, 3.7e5)
    joints = {}
    for i, (chi, phi_max, R, K_T) in enumerate((outer, inner, middle, inner, outer), 1):
        sliders = R * phi_max ** (1 + chi) / (1 + chi)
        joints[f"J{i}"] = _joint(phi_max, K_T, chi, (K_T - sliders) / sliders)
    return Structure(
        name="brake_reuss",
        M=arrays["M"],
        C=arrays["C"],
        K=arrays["K"],
        rows=named("row"),
        sensors=named("sensor"),
        inputs=named("input"),
        joints=joints,
        rate=4096.0,
        samples=4096,
        peaks={"tip": 45.0, "mid": 60.0},
        pulse=(5, 9),
        steps=64,
    )


STRUCTURES: Mapping[str, Structure] = {
    s.name: s for s in (oscillator(), *map(chain, _CHAINS), lap_beam(), brake_reuss())
}
