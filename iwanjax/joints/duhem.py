"""Duhem's hysteresis: branches that depend on nothing but the force that they begin with."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints.discrete import AbstractDiscrete, Reaction


def tip_stiffness(
    share: Array, onward: Array, back: Array, d: Array, K_T: Array
) -> Float[Array, "..."]:
    r"""Stiffness at the tips that a slow decay's amplitude shrinks by, force/length.

    Where the force changes by :math:`dF = K_T f(\pm F/F_S)\,|dd|` on the way up and down, a branch
    of the length 2d that begins where one longer by :math:`2\delta` has ended, and those before it,
    takes

    .. math:: k_{tip}\,d\,\delta, \qquad
              k_{tip} = \frac{F_S}{d}\,\frac{4 w\rho}{(1 + \rho)^2}, \quad
              \rho = \frac{f(w)}{f(-w)}

    less than half a steady cycle, with the share w of :math:`F_S` at the tips of that: by the
    balance that :meth:`iwanjax.AbstractJoint.tip_stiffness` states. No source. :math:`K_T` at rest,
    nothing where all has yielded, as of dry friction.

    Parameters
    ----------
    share : array
        w, of the steady cycle of amplitude d.
    onward, back : array
        f(w) and f(-w), 1.
    d : array
        Amplitude over the slip F_S/K_T, 1.
    K_T : array
        Tangent stiffness at rest, force/length.
    """
    at_rest = d == 0.0
    safe = jnp.where(at_rest, 1.0, d)
    turned = 4.0 * onward * back / (onward + back) ** 2
    return K_T * jnp.where(at_rest, 1.0, turned * share / safe)


def _nodes() -> Float[np.ndarray, " nodes"]:
    """Twelve intervals to a side, closer to zero: the first is 0.024 wide.

    Of Bouc and Wen's hysteresis pinched to a fifth over 0.2 of its force recordings left 1.05 times
    their noise, as with twenty even ones. Were f constant over ten, 2.4 times; over forty, 1.15.
    """
    side = (np.arange(1, 13) / 12.0) ** 1.5
    return np.concatenate([-side[::-1], [0.0], side])


def _first_branch() -> Float[np.ndarray, " shape"]:
    """Of Bouc and Wen's hysteresis with the exponent 1; no less than in its last interval."""
    side = NODES[NODES.size // 2 :]
    onward = np.maximum(1.0 - side[1:], 0.5 * (1.0 - side[-2]))
    return np.concatenate([np.zeros(side.size), -np.log(onward)])


NODES = _nodes()
"""Shares of a Duhem spring's force between which its curve's slope changes evenly."""
FIRST_BRANCH = _first_branch()
"""Shape that searches are about: logarithms of f(-|w|) at the nodes of w from 0 to 1, then of
f(-w)/f(w) at those after 0."""


class YieldedState(NamedTuple):
    """What springs that yield remember.

    Attributes
    ----------
    d, v : array
        Deflection and rate at the end of the last step.
    share : array
        Of each one's force at its slip, what it has.
    """

    d: Array
    v: Array
    share: Array

    @classmethod
    def none(cls, force: Array) -> "YieldedState":
        """At rest, for springs of these forces."""
        zero = jnp.zeros(())
        return cls(zero, zero, jnp.zeros_like(force))


class DuhemSpring(AbstractDiscrete):
    r"""A spring that yields along one curve of any shape, :math:`dw = f(\pm w)\,|dd|`.

    Up and down alike a branch follows that curve from where it begins; f is linear between nodes
    of w. Dahl's hysteresis, Bouc and Wen's and pinched one (Baber and Noori 1985) are such (Oh and
    Bernstein, IEEE Trans. Automat. Contr. 50, 2005: Duhem models). What unloading gives back is
    stored, and nothing feeds energy where :math:`f(w) \le f(-w)` for w > 0.

    Attributes
    ----------
    force : array
        At w = 1, which nothing exceeds.
    f : (nodes,) array
        At :data:`NODES`, 1/length.
    u, work : (nodes,) array
        Deflection of the curve there, and its work over ``force``, from w = 0 on, length.
    """

    force: Array
    f: Array
    u: Array
    work: Array

    @classmethod
    def of(cls, force: Array, slip: Array, back: Array, held: Array) -> "DuhemSpring":
        """By logarithms: of f x slip on the way back to w = 0, and by how much less it is onward.

        The first at w = 0 and outwards to 1, the second from the node after w = 0 on.
        """
        f = jnp.exp(jnp.concatenate([back[::-1], back[1:] - held])) / slip
        begun, wide = jnp.asarray(NODES[:-1]), jnp.asarray(np.diff(NODES))

        def summed(steps: Array) -> Array:
            total = jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])
            return total - total[NODES.size // 2]

        moved, work = _along(f[:-1], (f[1:] - f[:-1]) / wide, begun, wide)
        return cls(force, f, summed(moved), summed(work))

    def init(self) -> YieldedState:
        """At rest."""
        return YieldedState.none(self.force)

    def step(self, d: Array, v: Array, dt: Array, state: YieldedState) -> Reaction:
        """Move to d, to arrive at rate v."""
        # Of the state's own deflection: what settles a step has moved it.
        moved, begun = d - state.d, state.share
        w, leaning = jax.jvp(lambda by: self.onward(begun, by), (moved,), (jnp.ones_like(d),))
        after, lost = YieldedState(d, v, w), self.lost(begun, w, moved)
        return Reaction(self.force * w, self.force * leaning, jnp.zeros_like(d), after, lost)

    def settled(
        self, state: YieldedState, by: Array, faster: Array, stiffness: Array
    ) -> YieldedState:
        """It follows a little further."""
        return YieldedState(state.d + by, state.v + faster, self.onward(state.share, by))

    def energy(self, d: Array, state: YieldedState) -> Array:
        """What unloading gives back, force x length."""
        return self.stored(state.share)

    def onward(self, w: Array, moved: Array) -> Array:
        """The share after a monotonic step."""
        way = jnp.where(moved < 0.0, -1.0, 1.0)
        return way * self._share(self._at(way * w)[0] + jnp.abs(moved))

    def lost(self, w: Array, after: Array, moved: Array) -> Array:
        """Energy of such a step, force x length: work less what is stored more."""
        way = jnp.where(moved < 0.0, -1.0, 1.0)
        (u, begun), (_, ended) = self._at(way * w), self._at(way * after)
        spent = jnp.maximum(u + jnp.abs(moved) - self.u[-1], 0.0)
        work = self.force * (ended - begun + spent)
        return jnp.maximum(work - self.stored(after) + self.stored(w), 0.0)

    def stored(self, w: Array) -> Array:
        """What unloading gives back, force x length."""
        return self.force * self._at(-jnp.abs(w))[1]

    def curve(self, d: Array) -> tuple[Array, Array]:
        """Virgin force and tangent."""
        u = jnp.abs(d)
        w = self._share(u)
        slope = jnp.where(u < self.u[-1], self._rate(w), 0.0)
        return self.force * jnp.sign(d) * w, self.force * slope

    def loading(self, d: Array, amplitude: Array) -> Array:
        """Force on the loading branch of a steady cycle."""
        return self.force * self.onward(-self._tip(amplitude), d + amplitude)

    def cycle(self, amplitude: Array) -> Array:
        """Energy lost in a steady cycle, force x length."""
        w = self._tip(amplitude)
        spent = jnp.maximum(2.0 * amplitude - (self.u[-1] - self.u[0]), 0.0)
        return 2.0 * self.force * (self._at(w)[1] - self._at(-w)[1] + spent)

    def tip_stiffness(self, amplitude: Array) -> Array:
        """Of a slow decay, force/length."""
        w = self._tip(amplitude)
        up, down = self._rate(w), self._rate(-w)
        up = jnp.where(w < 1.0, up, 0.0)
        slip = 1.0 / self.f[NODES.size // 2]
        return tip_stiffness(w, up, down, amplitude / slip, self.force / slip)

    def _tip(self, amplitude: Array) -> Array:
        """Share at the tips of a steady cycle: by halves, then a step of Newton for its slopes."""
        known, reach = jax.lax.stop_gradient((self, 2.0 * amplitude))

        def halved(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            middle = 0.5 * (ends[0] + ends[1])
            short = known._span(middle) < reach
            return jnp.where(short, middle, ends[0]), jnp.where(short, ends[1], middle)

        zero = jnp.zeros_like(reach)
        near = jax.lax.fori_loop(0, np.finfo(float).nmant, halved, (zero, zero + 1.0))[0]
        slope = 1.0 / self._rate(near) + 1.0 / self._rate(-near)
        return jnp.minimum(near + (2.0 * amplitude - self._span(near)) / slope, 1.0)

    def _span(self, w: Array) -> Array:
        """Deflection between the tips of a steady cycle of that share."""
        return self._at(w)[0] - self._at(-w)[0]

    def _interval(self, w: Array) -> Array:
        """In which one a share lies."""
        i = jnp.searchsorted(jnp.asarray(NODES), w, side="right") - 1
        return jnp.clip(i, 0, NODES.size - 2)

    def _slope(self, i: Array) -> Array:
        return (self.f[i + 1] - self.f[i]) / jnp.asarray(np.diff(NODES))[i]

    def _rate(self, w: Array) -> Array:
        i = self._interval(w)
        return self.f[i] + self._slope(i) * (w - jnp.asarray(NODES)[i])

    def _at(self, w: Array) -> tuple[Array, Array]:
        """Deflection and work where the curve is at w."""
        i = self._interval(w)
        begun = jnp.asarray(NODES)[i]
        u, work = _along(self.f[i], self._slope(i), begun, w - begun)
        return self.u[i] + u, self.work[i] + work

    def _share(self, u: Array) -> Array:
        """The curve's share at a deflection."""
        i = jnp.clip(jnp.searchsorted(self.u, u, side="right") - 1, 0, self.f.size - 2)
        x = self._slope(i) * (u - self.u[i])
        small = jnp.abs(x) < 1e-6
        safe = jnp.where(small, 1.0, x)
        # Long before the exponential is no number any more the share is 1.
        grown = jnp.where(small, 1.0 + 0.5 * x, jnp.expm1(jnp.minimum(safe, 50.0)) / safe)
        return jnp.minimum(jnp.asarray(NODES)[i] + self.f[i] * (u - self.u[i]) * grown, 1.0)


def _along(f: Array, slope: Array, begun: Array, x: Array) -> tuple[Array, Array]:
    """Deflection and work of a piece of the curve from a share on, f changing evenly."""
    r = slope * x / f
    small = jnp.abs(r) < 1e-4
    safe = jnp.where(small, 1.0, r)
    first = jnp.where(small, 1.0 - r * (0.5 - r / 3.0), jnp.log1p(safe) / safe)
    second = jnp.where(small, 0.5 - r * (1.0 / 3.0 - r / 4.0), (safe - jnp.log1p(safe)) / safe**2)
    u = x / f * first
    return u, begun * u + x**2 / f * second


def nearest_branch(
    d: Float[np.ndarray, "recordings N"],
    v: Float[np.ndarray, "recordings N"],
    force: Float[np.ndarray, "recordings N"],
) -> tuple[float, Float[np.ndarray, " shape"]]:
    r"""Strength and branch of the Duhem spring whose force is nearest to one in some motion.

    By least squares of :math:`\Delta w = \sum_j f_j\,\overline{h_j(\pm w)}\,|\Delta d|` over all
    samples between which the motion does not turn, h the hats of the nodes.

    Parameters
    ----------
    d, v : (recordings, N) array
        Deflections, length, and rates, length/time.
    force : (recordings, N) array
        To be come near to.

    Returns
    -------
    strength : float
        Force; a little more than the largest. Zero where nothing is seen to yield, or motion or
        force is no number.
    branch : (25,) array
        As :data:`FIRST_BRANCH`.
    """
    from scipy.optimize import nnls  # here, because few need it and it is slow to import

    strength = (1.0 + 1.0 / NODES.size) * float(np.max(np.abs(force)))
    if not (np.all(np.isfinite(d)) and 0.0 < strength < np.inf):
        return 0.0, FIRST_BRANCH
    w, moved = force / strength, np.diff(d, axis=1)
    on = (v[:, 1:] * moved > 0.0) & (v[:, :-1] * moved > 0.0)
    way = np.sign(moved)[on]
    begin, end = way * w[:, :-1][on], way * w[:, 1:][on]
    columns = np.abs(moved[on])[:, None] * _mean_hats(begin, end)
    f, _ = nnls(columns, end - begin, maxiter=10**5)
    if not np.any(f > 0.0):
        return 0.0, FIRST_BRANCH
    # Where no sample was, or none moved, as steep as the first branch is at its flattest.
    f = np.maximum(f, np.exp(-FIRST_BRANCH[-1]) * np.max(f))
    back, onward = f[NODES <= 0.0][::-1], f[NODES > 0.0]
    held = np.log(back[1:] / onward)
    return strength, np.concatenate([np.log(back), np.maximum(held, 0.0)])


def scaled(branch: Float[np.ndarray, " shape"], by: float) -> Float[np.ndarray, " shape"]:
    """The same branch where lengths are in a unit so many times as long."""
    back = np.arange(branch.size) < np.sum(NODES <= 0.0)
    return np.where(back, branch + np.log(by), branch)


def _mean_hats(begin: np.ndarray, end: np.ndarray) -> Float[np.ndarray, "steps nodes"]:
    """Of each node's hat between two shares."""
    # Shares are within the outermost nodes: how wide the hats of these are beyond is no matter.
    before, after = np.diff(NODES, prepend=NODES[0] - 1.0), np.diff(NODES, append=NODES[-1] + 1.0)

    def summed(x: np.ndarray) -> np.ndarray:
        off = x[:, None] - NODES
        rising = np.clip(1.0 + off / before, 0.0, 1.0)
        falling = np.clip(off / after, 0.0, 1.0)
        return 0.5 * before * rising**2 + after * (falling - 0.5 * falling**2)

    # Between two that are the same the mean is the hat itself.
    wide = np.where(np.abs(end - begin) < 1e-9, 1e-9, end - begin)
    return (summed(begin + wide) - summed(begin)) / wide[:, None]
