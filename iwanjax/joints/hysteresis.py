"""One element driven along a history of deflections."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.abstract import AbstractJoint
from iwanjax.joints.discrete import AbstractDiscrete
from iwanjax.joints.iwan import AbstractIwan
from iwanjax.joints.sliders import SLIDERS
from iwanjax.types import ArrayLike, as_real, is_traced


def hysteresis(
    joint: AbstractJoint | AbstractDiscrete,
    d_history: ArrayLike,
    *,
    sliders: int | None = SLIDERS,
    dt: ArrayLike | None = None,
    varying: Mapping[str, ArrayLike] | None = None,
    lead: ArrayLike = 0.0,
) -> Float[Array, "..."]:
    """Force of an element along a history of deflections, from rest at d = 0 on.

    Between two values the motion is taken to be monotonic; sliders are exact then, however
    far apart the values are (thesis Sec. 4.2.3 with a flag for each slider).

    Parameters
    ----------
    joint : joint or AbstractDiscrete
        One parameter set; or the discrete element itself, such as a
        :class:`~iwanjax.joints.SliderBank` of one's own.
    d_history : (..., N) array_like
        Deflections, length; leading axes are histories of their own.
    sliders : int or None
        Sliders that stand for an Iwan element; None takes the closed form of a
        four-parameter one (:class:`~iwanjax.joints.Reversals`).
    dt : float or array, optional
        Time between two values, or of d's shape the time that leads to each, for elements whose
        force depends on rate.
    varying : mapping of str to (..., N) array, optional
        Parameters that change, by name, their values beside those of d: with temperature, voltage
        or a normal force. The element keeps its state, that is the stretch of sliders' springs;
        one that is stretched further than it now withstands slips. Iwan elements have sliders then.
    lead : float or (...) array, optional
        Time from rest to where the recording begins, s, for elements that change from its
        beginning on.

    Returns
    -------
    (..., N) array
        Force at each value.

    Raises
    ------
    InputError
        For values that are not finite, a step that is not positive, rate-dependent
        elements without one, and parameters that change which the joint has not.

    Examples
    --------
    >>> import iwanjax as ij
    >>> joint = ij.Jenkins(F_S=1.0, K_T=1.0)
    >>> ij.hysteresis(joint, [0.0, 2.0, 1.0, -2.0]).tolist()  # sticks again after the reversal at 2
    [0.0, 1.0, 0.0, -1.0]
    >>> ij.hysteresis(joint, [0.0, 2.0, 3.0], varying={"F_S": [1.0, 1.0, 1.5]}).tolist()
    [0.0, 1.0, 1.5]
    """
    d = as_real(d_history, "d_history")
    if d.ndim == 0:
        raise InputError("d_history is a number; expected an array of at least one axis")
    if isinstance(joint, AbstractJoint) and any(jnp.ndim(leaf) for leaf in jax.tree.leaves(joint)):
        raise InputError(f"hysteresis drives one parameter set; {joint!r} carries a batch")
    changing = {name: as_real(x, name) for name, x in (varying or {}).items()}
    element = joint if isinstance(joint, AbstractDiscrete) else joint.discrete(sliders)
    if dt is None and element.rate_dependent:
        raise InputError(
            f"hysteresis: the force of {type(joint).__name__} depends on rate; give dt=, the time "
            "between two values"
        )
    step = as_real(1.0 if dt is None else dt, "dt")
    known = dt is None or is_traced(dt) or bool(np.all(np.asarray(dt) > 0))
    if step.shape not in ((), d.shape) or not known:
        raise InputError(f"hysteresis: dt = {dt}; expected a positive number, or one of each value")
    for name, x in changing.items():
        known = [] if isinstance(joint, AbstractDiscrete) else [i.name for i in joint.parameters]
        if name not in known or x.shape != d.shape:
            raise InputError(
                f"hysteresis: varying: {name} of shape {x.shape}; expected one of "
                f"{', '.join(known) or 'a joint, which has parameters'}, of shape {d.shape} as d"
            )
    rows, steps, *rest = (
        x.reshape(-1, d.shape[-1]) for x in (d, jnp.broadcast_to(step, d.shape), *changing.values())
    )
    now = dict(zip(changing, rest, strict=True))
    before = jnp.broadcast_to(as_real(lead, "lead"), d.shape[:-1]).reshape(-1)
    return _driven(joint if now else element, sliders, rows, steps, now, before).reshape(d.shape)


@eqx.filter_jit
def _driven(
    element: AbstractJoint | AbstractDiscrete,
    sliders: int | None,
    d: Array,
    dt: Array,
    varying: dict[str, Array],
    lead: Array,
) -> Array:
    """A discrete element, or a joint that is made into one anew at each value."""

    def at(values: dict[str, Array]) -> AbstractDiscrete:
        if isinstance(element, AbstractDiscrete):
            return element
        joint = element.with_parameters(**values)
        if isinstance(joint, AbstractIwan) and values:
            # Neither reversals nor slip fronts know how far springs are stretched.
            return joint.slider_bank(SLIDERS if sliders is None else sliders)
        return joint.discrete(sliders)

    def one(history: Array, steps: Array, values: dict[str, Array], lead: Array) -> Array:
        def advance(state: Any, ends: tuple[Any, ...]) -> tuple[Any, Array]:
            to, moved, dt, now = ends
            reaction = at(now).step(to, moved / dt, dt, state)
            return reaction.state, reaction.force

        moved = jnp.diff(history, prepend=0.0)
        first = at({name: x[0] for name, x in values.items()})
        begin = first.earlier(first.init(), lead)
        return jax.lax.scan(advance, begin, (history, moved, steps, values))[1]

    return jax.vmap(one)(d, dt, varying, lead)


def last_amplitude(d: np.ndarray) -> float:
    """Half of what a history (N,) moves between its last two turning points, ends included."""
    ends = np.concatenate([d[:1], d[turning_points(d)], d[-1:]])
    return 0.5 * float(np.max(np.abs(np.diff(ends[-3:]))))


def turning_points(d: np.ndarray) -> np.ndarray:
    """Samples at which a history turns."""
    moved = np.sign(np.diff(d))
    at = np.flatnonzero(moved)
    return at[1:][np.diff(moved[at]) != 0]
