"""Terms of the general law: knots of its spring, dampers, sliders, bristles and so on.

All are of a place's motion over its largest: x = d/D, u = v/V.
"""

import numpy as np
from jaxtyping import Float

_Grid = Float[np.ndarray, " points"]


def _knots() -> _Grid:
    """Of the spring, seven intervals to a side, closer to zero: the first is 0.05 wide.

    One more to either side is beyond what the law was fitted to.
    """
    side = np.append((np.arange(1, 8) / 7.0) ** 1.5, OUTSIDE)
    return np.concatenate([-side[::-1], [0.0], side])


def _intervals(knots: _Grid) -> Float[np.ndarray, "orders intervals terms"]:
    """Polynomials of each term of the spring between the knots, in the distance from the left one.

    The first term is x. Each of the next has a slope that grows by one about a knot within D: its
    second derivative is a hat of unit area there, so that it is the spring of a clearance that
    ends, or that begins, smoothly. All vanish at x = 0 with their slopes, and go on straight beyond
    D. The last are the square and the cube of x, there as well.
    """
    h, inner, zero = np.diff(knots), len(knots) - 4, len(knots) // 2
    bend = np.zeros((len(knots), 1 + inner))
    bend[2:-2, 1:] = np.diag(2.0 / (h[1:-2] + h[2:-1]))
    rise = np.diff(bend, axis=0) / h[:, None]

    def summed(steps: np.ndarray, at_zero: np.ndarray) -> np.ndarray:
        values = np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
        return values - values[zero] + at_zero

    left, wide = bend[:-1], h[:, None]
    straight = np.eye(1 + inner)[0]
    slope = summed(wide * (left + wide * rise / 2.0), straight)
    force = summed(wide * (slope[:-1] + wide * (left / 2.0 + wide * rise / 6.0)), 0.0 * straight)
    energy = summed(
        wide * (force[:-1] + wide * (slope[:-1] / 2.0 + wide * (left / 6.0 + wide * rise / 24.0))),
        0.0 * straight,
    )
    splines = np.stack([energy[:-1], force[:-1], slope[:-1], left, rise])
    x, one = knots[:-1], np.ones(len(h))
    square = x**3 / 3.0, x**2, 2.0 * x, 2.0 * one, 0.0 * one
    cube = x**4 / 4.0, x**3, 3.0 * x**2, 6.0 * x, 6.0 * one
    return np.concatenate([splines, np.stack([square, cube], axis=2)], axis=2)


def _slips() -> tuple[_Grid, Float[np.ndarray, "sliders nodes"]]:
    """Deflections of slip, four to each octave, and their shares of the strength at each node.

    Nodes are half an octave apart, from D down to D/512; strength is linear between them over the
    logarithm of slip. Dry friction that slips at once between two nodes an octave apart left 12
    times the noise of held-out recordings, 4.5 times by half an octave.
    """
    nodes = len(_yields())
    octaves = np.arange(2 * nodes - 1) / 4.0
    hats = np.maximum(1.0 - np.abs(2.0 * octaves[:, None] - np.arange(nodes)), 0.0)
    return 2.0**-octaves, hats / hats.sum(axis=0)


def _rates() -> _Grid:
    r"""Rates at which dampers saturate, half a decade apart.

    Sums of :math:`u/(u + \epsilon)` are the Stieltjes functions, every root of u among them.
    """
    return 10.0 ** (-np.arange(5) / 2.0)


def _times() -> _Grid:
    """Relaxation times over T/(2 pi): half a decade apart, about that of the slowest motion."""
    return 10.0 ** ((np.arange(4) - 2.0) / 2.0)


def _yields() -> _Grid:
    """Slip of springs that yield gradually, over D: half an octave apart as the sliders' nodes.

    With both an octave apart Bouc and Wen's hysteresis of the exponent 1.7 left 5.1 times the noise
    of held-out recordings, 2.3 times so.
    """
    return 2.0 ** (-np.arange(19) / 2.0)


def _bristles() -> tuple[_Grid, _Grid]:
    """Slip of bristles over D, half an octave apart, and by what their rate counts over V.

    Of forces by Canudas de Wit's law whose friction falls by a third or a sixth about 0.03, 0.1 and
    0.3 V these leave 0.3 to 1.1 % (least squares along three decays). Slips an octave apart, one
    half of them with a limit 1/(1 + (10 u)^2), left 1.6 to 2.3 %; without any it is 6 to 7 %.
    """
    phi, fading = YIELDS[:13], np.array([0.0, 4.0, 12.0, 36.0])
    return np.tile(phi, len(fading)), np.repeat(fading, len(phi))


def _terms() -> tuple[str, ...]:
    return (
        "spring",
        *(f"spring at {x:+.3f} D" for x in KNOTS[2:-2]),
        *("quadratic spring", "cubic spring"),
        *(f"damper saturating at {u:.3g} V" for u in RATES),
        *("damper of positive rates", "damper of negative rates"),
        f"damper rising at {RISE:.3g} V",
        *("quadratic damper", "cubic damper", "damper of large deflections"),
        *(f"slider at D/{1.0 / phi:.3g}" for phi in YIELDS),
        *(f"relaxing spring of {t:.3g} T/(2 pi)" for t in TIMES),
        *(f"yielding spring of {phi:.3g} D" for phi in YIELDS),
        *(
            f"bristles of {phi:.3g} D" + (f" that fade at {1.0 / fading:.3g} V" if fading else "")
            for phi, fading in zip(BRISTLES, FADING, strict=True)
        ),
        *MASSES,
        "spring that yields along a curve",
        "mass that resonates",
    )


OUTSIDE = 2.0
"""Times the largest motion up to which powers of it go on as they are; beyond they go straight.

A recording that is held out moves a place by a fifth more than those fitted, as a rule of hits at
another place. A cubic spring of splines that went on straight from there on left 9 times the noise
of it, a damper of the deflection's square that stayed what it was 15 times."""
KNOTS = _knots()
"""Where the spring's slope may change, x."""
INTERVALS = _intervals(KNOTS)
"""Energy, force, slope, its derivative and that one's at the left of each interval, by term."""
SLIPS, SHARES = _slips()
"""Slip of each slider over D, and what each node's strength is to it."""
RATES = _rates()
"""Of the saturating dampers, u."""
RISE = float(np.median(RATES))
"""Where a damper turns from :math:`u|u|` to u: with it sums of dampers are within 1.2 % of any
power of u from 1 to 2 over two decades, 18 % off without."""
TIMES = _times()
"""Of the relaxing springs over T/(2 pi)."""
YIELDS = _yields()
"""Slip of the yielding springs over D."""
BRISTLES, FADING = _bristles()
"""Slip of the bristles over D, and by what their rate counts over V."""
MASSES = ("mass", "mass of large deflections")
"""Of constant size, and growing with the square of the deflection."""
RESONANCE = np.zeros(2)
"""Of the mass that resonates to begin with: logarithms of its frequency over 1/T and of its damping
ratio."""
TERMS = _terms()
"""Names of all terms, in the order of the law's strengths."""


def _parts() -> dict[str, slice]:
    found, first = {}, 0
    for name, count in (
        ("spring", len(KNOTS) - 1),
        ("damper", len(RATES) + 6),
        ("sliders", SHARES.shape[1]),
        ("relaxation", len(TIMES)),
        ("yielding", len(YIELDS)),
        ("bristles", len(BRISTLES)),
        ("inertia", len(MASSES)),
        ("duhem", 1),
        ("resonance", 1),
    ):
        found[name] = slice(first, first + count)
        first += count
    return found


PARTS = _parts()
"""Where the strengths of each part stand."""


RESONATES = PARTS["resonance"].start
"""The mass that resonates."""
POWERS = np.arange(PARTS["spring"].stop - 2, PARTS["spring"].stop)
"""The spring's square and cube of the deflection."""
BENDS = np.arange(1, POWERS[0])
"""Splines of the spring, other than what is straight."""
ELASTIC = PARTS["spring"].stop
"""How many belong to the spring, and may be negative."""


def _groups() -> tuple[slice, ...]:
    sides = PARTS["damper"].start + len(RATES)
    alone = [*POWERS, *range(sides + 2, PARTS["damper"].stop)]
    return (
        slice(0, POWERS[0]),
        slice(PARTS["damper"].start, sides),
        slice(sides, sides + 2),
        *(slice(i, i + 1) for i in alone),
        *(own for name, own in PARTS.items() if name not in ("spring", "damper")),
    )


GROUPS = _groups()
"""Terms that are as large as one another beforehand: a power of the motion by itself."""


def _without(*parts: str) -> tuple[int, ...]:
    left_out = np.concatenate([np.arange(len(TERMS))[PARTS[name]] for name in parts])
    return tuple(np.setdiff1d(np.arange(len(TERMS)), left_out).tolist())


def _few() -> tuple[int, ...]:
    every = np.arange(len(TERMS))
    own = {name: every[part] for name, part in PARTS.items()}
    saturating, others = np.split(own["damper"], [len(RATES)])
    kept = ["relaxation", "inertia", "resonance"]
    found = [every[:1], BENDS[2:-2:2], POWERS, saturating[::2], others, own["sliders"][::2]]
    return tuple(np.sort(np.concatenate([*found, *(own[name] for name in kept)])).tolist())


LINEAR = (
    PARTS["spring"].start,
    *range(PARTS["relaxation"].start, PARTS["relaxation"].stop),
    PARTS["inertia"].start,
)
"""What has no amplitude: a spring, springs that relax, a mass."""
FEW = _few()
"""Of the others slopes at zero and at two deflections to either side, dampers a decade and sliders
an octave apart, and neither springs that yield gradually nor bristles: a fourth of all terms."""
BANKS = _without("duhem")
"""All terms side by side, without the spring that yields along a curve."""
DUHEM = _without("sliders", "yielding", "bristles")
"""With that spring in place of other hysteresis."""
