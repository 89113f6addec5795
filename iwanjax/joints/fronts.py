"""Sliders without number: a power-law distribution whose slip ends at a few moving fronts."""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.power import power

# Below any threshold in a ratio of two of them, and its square's inverse still a number.
_NOTHING = 1e-100
# Of the stiffness below a threshold, what is left of it by differences.
_ROUNDING = 1e-13


class FrontState(NamedTuple):
    r"""What the sliders remember: from threshold to threshold their springs' stretch is a line.

    Attributes
    ----------
    d : array
        Deflection.
    top : (segments,) array
        Upper end of each segment of thresholds, rising; those not in use end at phi_max.
    share : (segments,) array
        (top/phi_max)^(chi + 1): of the power law's stiffness below it.
    stretch, slope : (segments,) array
        Of the springs: stretch + slope phi.
    direction : (segments,) array
        1 or -1 where the sliders slip that way, 0 where they stick.
    last_stretch, last_direction : array
        Of the Dirac slider at phi_max.
    """

    d: Array
    top: Float[Array, " segments"]
    share: Float[Array, " segments"]
    stretch: Float[Array, " segments"]
    slope: Float[Array, " segments"]
    direction: Float[Array, " segments"]
    last_stretch: Array
    last_direction: Array


class _Move(NamedTuple):
    """A step as it is for each segment: below its front sliders slip, above they stick."""

    way: Array
    low: Array
    low_share: Array
    front: Array
    front_share: Array
    stretch: Array
    goes_on: Bool[Array, " segments"]
    within: Bool[Array, " segments"]
    last_slips: Array
    last_trial: Array
    last_threshold: Array


class SlipFronts(AbstractDiscrete):
    r"""All sliders of a five-parameter element, by the fronts up to which they have slipped.

    A slider of threshold phi lets go at the stretch phi and slips on at theta phi. As all
    springs are of one kind per threshold and follow one deflection, their stretch is piecewise
    a line in phi: zero slope and the deflection where nothing has slipped yet,
    :math:`\pm\theta\phi` and what came after the turn elsewhere. In a monotonic step each such
    segment slips from below up to a front of its own,

    .. math:: s + \sigma\phi \ge \phi \iff \phi \le \frac{s}{1-\sigma}

    (s, sigma: stretch and slope, signed along the motion), and all forces are differences of
    :math:`\phi^{\chi+1}` and :math:`\phi^{\chi+2}` at fronts. No slider lets go at an instant
    but the Dirac one: neither force nor tangent knows a grid. Exact until a history leaves more
    segments than there is room for; then those that matter least become one, with the force that
    they have together, and what their springs lose by it counts as dissipated. The error
    falls with the square of the number of segments.

    Parameters
    ----------
    stiffness, last : array
        Of the power law and of the Dirac slider, force/length.
    n, phi_max, theta : array
        chi + 1; deflection at macroslip, length; kinetic over static friction.
    segments : int
        Room for so many.
    """

    stiffness: Array
    last: Array
    n: Array
    phi_max: Array
    theta: Array
    segments: int = eqx.field(static=True)

    def init(self) -> FrontState:
        """All sliders stick, no spring is stretched."""
        still = jnp.zeros(self.segments) * self.phi_max
        return FrontState(
            still[0], still + self.phi_max, still + 1.0, still, still, still, still[0], still[0]
        )

    def step(self, d: Array, v: Array, dt: Array, state: FrontState) -> Reaction:
        """Move to d: exact for any motion that does not turn on the way, but for what is merged."""
        move = self._move(d - state.d, state)
        n, theta, phi_max = self.n, self.theta, self.phi_max
        # Springs' stiffness and moments of slipping and of sticking parts, from end to end.
        ends = (move.low, move.front, state.top), (move.low_share, move.front_share, state.share)
        k, p, q = self._between(*ends)
        slides = move.way * theta
        segments_force = slides * p[0] + move.stretch * k[1] + state.slope * p[1]
        last = jnp.where(
            move.last_slips, jnp.copysign(theta * phi_max, move.last_trial), move.last_trial
        )
        force = jnp.sum(segments_force) + self.last * last
        free = self._free(move.way, state.slope)
        # Where a front moves on, sliders drop from phi to theta phi.
        drops = (1.0 - theta) * n * move.front_share / free
        held = jnp.sum(k[1] - jnp.where(move.within, self.stiffness * drops, 0.0))
        held = held + jnp.where(move.last_slips, 0.0, self.last)
        # Each slider that lets go falls from phi to theta phi and is dragged from there on.
        moved = jnp.abs(d - state.d)
        falls = (0.5 * (1.0 - theta**2) - theta * free) * q[0] + theta * move.way * (
            move.stretch * p[0]
        )
        lost = jnp.sum(jnp.where(move.goes_on, theta * moved * p[0], falls))
        beyond = jnp.abs(move.last_trial) - move.last_threshold
        kinetic = theta * phi_max
        fallen = 0.5 * (move.last_threshold - kinetic) * (move.last_threshold + kinetic)
        lost = lost + jnp.where(move.last_slips, self.last * (fallen + kinetic * beyond), 0.0)
        after, merged = self._merged(d, last, move, state, (k, p, q))
        return Reaction(force, held, jnp.zeros_like(force), after, lost + merged)

    def energy(self, d: Array, state: FrontState) -> Array:
        """Of the springs."""
        low, low_share = _below(state.top), _below(state.share)
        k, p, q = (each[0] for each in self._between((low, state.top), (low_share, state.share)))
        a, b = state.stretch, state.slope
        return 0.5 * (jnp.sum(_square(a, b, k, p, q)) + self.last * state.last_stretch**2)

    def _move(self, moved: Array, state: FrontState) -> _Move:
        """Fronts of a step."""
        theta, phi_max = self.theta, self.phi_max
        way = jnp.sign(moved)
        low, low_share = _below(state.top), _below(state.share)
        stretch = state.stretch + moved
        goes_on = state.direction * moved > 0.0
        reach = way * stretch / self._free(way, state.slope)
        within = ~goes_on & (moved != 0.0) & (reach > low) & (reach < state.top)
        whole = goes_on | ((moved != 0.0) & (reach >= state.top))
        front = jnp.where(within, reach, jnp.where(whole, state.top, low))
        inside = power(jnp.where(within, reach, phi_max) / phi_max, self.n)
        share = jnp.where(within, inside, jnp.where(whole, state.share, low_share))
        trial = state.last_stretch + moved
        threshold = jnp.where(state.last_direction * moved > 0.0, theta * phi_max, phi_max)
        slips = (jnp.abs(trial) >= threshold) & (moved != 0.0)
        return _Move(
            way, low, low_share, front, share, stretch, goes_on, within, slips, trial, threshold
        )

    def _free(self, way: Array, slope: Array) -> Array:
        """1 - sigma: how much faster thresholds grow than the springs' stretch."""
        return jnp.maximum(1.0 - way * slope, _NOTHING)

    def _between(
        self, ends: tuple[Array, ...], shares: tuple[Array, ...]
    ) -> tuple[list[Array], list[Array], list[Array]]:
        """Stiffness and its first and second moments in phi from end to end."""
        n = self.n
        powers = (
            [self.stiffness * x for x in shares],
            [self.stiffness * n / (n + 1.0) * x * e for x, e in zip(shares, ends, strict=True)],
            [self.stiffness * n / (n + 2.0) * x * e**2 for x, e in zip(shares, ends, strict=True)],
        )
        k, p, q = ([b - a for a, b in itertools.pairwise(x)] for x in powers)
        return k, p, q

    def _merged(
        self,
        d: Array,
        last: Array,
        move: _Move,
        state: FrontState,
        parts: tuple[list[Array], list[Array], list[Array]],
    ) -> tuple[FrontState, Array]:
        """The state after a step, in as many segments as there is room for; and what that loses.

        Of each segment there are two parts now. Ends between parts that are alike go, and so do
        those that matter least where too many are left.
        """
        m, theta = self.segments, self.theta
        k, p, q = (_interleaved(*x) for x in parts)
        resting = move.way == 0.0
        top = _interleaved(move.front, state.top)
        share = _interleaved(move.front_share, state.share)
        bottom = _interleaved(move.low, move.front)
        zero = jnp.zeros(m) * theta
        stretch = _interleaved(zero, move.stretch)
        slope = _interleaved(zero + move.way * theta, state.slope)
        direction = _interleaved(zero + move.way, jnp.where(resting, state.direction, 0.0))
        # What rounding leaves between two ends is nothing: it would part what else is one.
        there = (top > bottom) & (k > _ROUNDING * self.stiffness * share)
        # The part that follows: beyond what slips up to its segment's end, and the next segment
        # where nothing slips, both of which are empty.
        first, second = _next(there, 1, False), _next(there, 2, False)
        jump = [
            jnp.where(first, _next(x, 1), jnp.where(second, _next(x, 2), _next(x, 3))) - x
            for x in (stretch, slope, direction, k)
        ]
        # Two of one size lose less together than a small one and a large one, whose law it bends.
        differs = jnp.abs(jump[0] + jump[1] * top) + jnp.abs(jump[1]) * top
        matters = jnp.sqrt(k * (k + jump[3])) * differs
        # A front moves on: small as the part that slips may be, it is where the next step begins.
        matters = jnp.where(jump[2] != 0.0, self.stiffness * self.phi_max + matters, matters)
        follows = top < self.phi_max
        matters = jnp.where(there & follows, matters, 0.0)
        matters = jax.lax.stop_gradient(matters)
        least = jnp.sort(matters)[m]
        kept = matters > least
        place = jnp.cumsum(kept) - kept
        into = ((place[:, None] == jnp.arange(m)) & there[:, None]).astype(k.dtype)
        columns = [k, p, stretch * k + slope * p, slope * k, direction * k]
        columns = jnp.stack([*columns, jnp.where(kept, top, 0.0), jnp.where(kept, share, 0.0)])
        k_all, p_all, force, leaning, slipping, new_top, new_share = columns @ into
        used = k_all > 0.0
        safe = jnp.where(used, k_all, 1.0)
        new_slope = jnp.where(used, leaning / safe, 0.0)
        new_stretch = jnp.where(used, (force - new_slope * p_all) / safe, 0.0)
        # Only where all of them slip does a segment.
        same = jnp.abs(slipping) >= k_all * (1.0 - 1e-12)
        new_direction = jnp.where(used & same, jnp.sign(slipping), 0.0)
        new_stretch = jnp.where(new_direction != 0.0, 0.0, new_stretch)
        open_end = new_top == 0.0
        new_top = jnp.where(open_end, self.phi_max, new_top)
        new_share = jnp.where(open_end, 1.0, new_share)
        last_direction = jnp.where(
            move.last_slips,
            jnp.sign(move.last_trial),
            jnp.where(resting, state.last_direction, 0.0),
        )
        after = FrontState(
            d, new_top, new_share, new_stretch, new_slope, new_direction, last, last_direction
        )
        q_all = q @ into
        stored = jnp.sum(jnp.where(there, _square(stretch, slope, k, p, q), 0.0))
        left = jnp.sum(_square(new_stretch, new_slope, k_all, p_all, q_all))
        crowded = jnp.sum(matters > 0.0) > m - 1
        return after, jnp.where(crowded, jnp.maximum(0.5 * (stored - left), 0.0), 0.0)


def _square(a: Array, b: Array, k: Array, p: Array, q: Array) -> Array:
    """Integral of (a + b phi)^2 over stiffness, by its moments."""
    return a**2 * k + 2.0 * a * b * p + b**2 * q


def _below(x: Array) -> Array:
    """Of each segment the lower end: the one before's upper."""
    return jnp.concatenate([jnp.zeros_like(x[:1]), x[:-1]])


def _next(x: Array, by: int, end: float | bool = 0.0) -> Array:
    return jnp.concatenate([x[by:], jnp.full(by, end, x.dtype)])


def _interleaved(first: Array, second: Array) -> Array:
    return jnp.stack([first, second], axis=-1).reshape(-1)
