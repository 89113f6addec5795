"""Masing elements without sliders: a stack of reversals and closed-form branches between them."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwanjax.joints.discrete import AbstractDiscrete, Reaction

_DEPTH = 16


class MasingJoint(Protocol):
    """An element whose loops follow from its virgin curve."""

    def law(self) -> Callable[[Array], tuple[Array, Array]]:
        """The virgin curve d -> (force, tangent)."""
        ...


class ReversalState(NamedTuple):
    """What the element remembers.

    Attributes
    ----------
    d, force : array
        Where it is.
    direction : array
        1 or -1, the way it moves; 0 before it has moved.
    tips, forces : (depth,) array
        Deflections and forces of the reversals whose loops are still open.
    order : (depth,) array of int
        Where in these they are, oldest first. None ever moves, for a move would take all its
        derivatives along.
    depth : array
        How many of them.
    """

    d: Array
    force: Array
    direction: Array
    tips: Float[Array, " depth"]
    forces: Float[Array, " depth"]
    order: Int[Array, " depth"]
    depth: Array


class Reversals(AbstractDiscrete):
    r"""Masing's rules for any history (Masing 1926; thesis Sec. 3.2.3 has the steady loop).

    After a reversal at :math:`(d_r, F_r)` the force follows the virgin curve magnified by two,

    .. math:: F = F_r + 2F_0\!\left(\frac{d - d_r}{2}\right),

    and where it meets the tip of an earlier loop that loop is closed and forgotten: the branch
    on which it was opened goes on. No sliders, so no error of discretisation, and a force that
    is smooth in the parameters. Of a decay without end 16 reversals are kept, the outermost
    loop among them: those that matter most. What it stores and loses is not known: NaN.

    Parameters
    ----------
    joint : joint
        With an odd virgin curve.
    """

    joint: MasingJoint

    def init(self) -> ReversalState:
        """At rest on the virgin curve."""
        zero = self.joint.law()(jnp.zeros(()))[0] * 0.0
        none = jnp.zeros(_DEPTH) + zero
        order = jnp.arange(_DEPTH, dtype=jnp.int32)
        return ReversalState(zero, zero, zero, none, none, order, jnp.zeros((), jnp.int32))

    def step(self, d: Array, v: Array, dt: Array, state: ReversalState) -> Reaction:
        """Move to d: exact for any motion that does not turn on the way. Its loss is NaN."""
        moved = d - state.d
        heading = jnp.where(moved == 0.0, state.direction, jnp.sign(moved))
        state = _pushed(state, heading * state.direction < 0.0)
        count = state.depth
        # The branch may meet every second tip below the last: those it closes, with their mates.
        place = np.arange(_DEPTH)
        target = (place < count) & ((count - place) % 2 == 0)
        passed = target & (heading * (d - _oldest_first(state)) >= 0.0)
        count = count - 2 * jnp.sum(passed, dtype=count.dtype)
        # A mirror image alone is no reversal: beyond its mate the virgin curve goes on.
        count = jnp.where(count == 1, 0, count)
        last = state.order[jnp.maximum(count - 1, 0)]
        virgin = count == 0
        d_r = jnp.where(virgin, 0.0, state.tips[last])
        F_r = jnp.where(virgin, 0.0, state.forces[last])
        scale = jnp.where(virgin, 1.0, 2.0)
        half, tangent = self.joint.law()((d - d_r) / scale)
        force = F_r + scale * half
        unknown = jnp.full_like(force, jnp.nan)
        kept = state._replace(d=d, force=force, direction=heading, depth=count)
        return Reaction(force, tangent, jnp.zeros_like(force), kept, unknown)

    def settled(
        self, state: ReversalState, by: Array, faster: Array, stiffness: Array
    ) -> ReversalState:
        """Along the branch."""
        return state._replace(d=state.d + by, force=state.force + stiffness * by)

    def energy(self, d: Array, state: ReversalState) -> Array:
        """Not known without sliders: NaN."""
        return jnp.full_like(d, jnp.nan)


def _oldest_first(state: ReversalState) -> Float[Array, " depth"]:
    """Deflections of the reversals in their order, to compare with: without derivatives."""
    return jax.lax.stop_gradient(state.tips)[state.order]


def _pushed(state: ReversalState, turned: Array) -> ReversalState:
    """The point of a reversal on the stack.

    The first reversal brings its mirror image along, where the virgin curve goes on. On a full
    stack two neighbours make room, and the next continues the branch before them.
    """
    full = turned & (state.depth == _DEPTH)
    place = np.arange(_DEPTH)
    least = _least_missed(jnp.append(_oldest_first(state), state.d))
    free = jax.lax.dynamic_slice(state.order, (least,), (2,))
    moved = jnp.concatenate([state.order[2:], free])
    order = jnp.where(full & (place >= least), moved, state.order)
    count = state.depth - 2 * full
    first = turned & (count == 0)
    mirrored = jnp.where(first, order[0], _DEPTH)
    last = jnp.where(turned, order[count + first], _DEPTH)
    spots = jnp.stack([mirrored, last])[:, None]
    # Products of whole stacks: a choice is made value by value, for each derivative again.
    signs = np.array([[-1.0], [1.0]])
    new = jnp.sum(jnp.where(spots == place, signs, 0.0), axis=0)

    def put(x: Array, value: Array) -> Array:
        return (1.0 - jnp.abs(new)) * x + new * value

    return state._replace(
        tips=put(state.tips, state.d),
        forces=put(state.forces, state.force),
        order=order,
        depth=count + turned + first,
    )


def _least_missed(tips: Float[Array, " n"]) -> Array:
    r"""First of the two neighbours without which branches change least; never the outermost.

    Without :math:`t_i` and :math:`t_{i+1}` the branch to :math:`t_{i+2}` starts at
    :math:`t_{i-1}`. Both branches meet at :math:`t_i`, and where they start alike they part
    alike: the force is off by about :math:`|t_{i+2} - t_i|\,|t_{i+1} - t_{i-1}|`, which counts
    beside the square of the loop :math:`|t_{i+1} - t_i|`, as large loops seldom come back.
    """
    apart = jnp.abs(tips[2:] - tips[:-2])
    missed = apart[1:] * apart[:-1] / (tips[2:-1] - tips[1:-2]) ** 2
    # Cheaper than an argmin where it is compiled.
    place = np.arange(1, len(tips) - 2)
    return jnp.max(jnp.where(missed <= jnp.min(missed), place, 0))
