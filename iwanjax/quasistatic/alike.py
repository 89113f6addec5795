"""Joints of one kind evaluated together: one piece of compiled code for all of them."""

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.joints import AbstractJoint

FEW = 2048
"""Deflections of a joint up to which copying them costs less than compiling each law apart. A large
batch has 4800 at once and 768 at its coarse levels, a fit 120: half and twice change neither."""


def of_each(
    function: Callable[[AbstractJoint, Array], tuple[Array, ...]],
    joints: Sequence[AbstractJoint],
    at: Sequence[Array],
) -> list[tuple[Array, ...]]:
    """Of each joint a function of its deflection, element by element, in the joints' order.

    Written out for each of five Iwan elements, their laws are most of what a compiler has to go
    through: joints of one type, whose leaves are all numbers or batches of them, are stacked.

    Parameters
    ----------
    function : function
        Joint, deflection -> tuple of arrays.
    joints : m joints
    at : m arrays
        Deflections, of one shape.
    """
    kinds: dict[object, list[int]] = {}
    for i, joint in enumerate(joints):
        leaves, structure = jax.tree.flatten(joint)
        # Others may hold tables, whose axis is none of the batch.
        alike = structure if len(leaves) == len(type(joint).parameters) else i
        kinds.setdefault(alike, []).append(i)
    found: dict[int, tuple[Array, ...]] = {}
    for own in kinds.values():
        if len(own) == 1 or at[own[0]].size > FEW:
            found |= {i: function(joints[i], at[i]) for i in own}
            continue
        d = jnp.stack(jnp.broadcast_arrays(*(at[i] for i in own)))
        stacked = jax.tree.map(partial(_stacked, d.ndim), *(joints[i] for i in own))
        # What is the same for all, a plain number, comes without the axis.
        values = [x if jnp.ndim(x) < d.ndim else jnp.unstack(x) for x in function(stacked, d)]
        for k, i in enumerate(own):
            found[i] = tuple(x[k] if isinstance(x, tuple) else x for x in values)
    return [found[i] for i in range(len(joints))]


def _stacked(axes: int, *leaves: Array) -> Array:
    """Along a new first axis, of so many axes in all."""
    wide = jnp.stack(jnp.broadcast_arrays(*leaves))
    return jnp.reshape(wide, (len(leaves), *(1,) * (axes - wide.ndim), *wide.shape[1:]))
