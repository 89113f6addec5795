"""Joint elements in motion: a force that follows a history, step by step."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


class Reaction(NamedTuple):
    """What an element does over one step.

    Attributes
    ----------
    force : array
        At the end of the step, opposing a growing deflection.
    stiffness, damping : array
        Its derivatives with respect to the deflection and the rate at the end of the step.
    state : pytree
        What the element remembers.
    loss : array
        Energy dissipated over the step, force x length.
    """

    force: Array
    stiffness: Array
    damping: Array
    state: Any
    loss: Array


class AbstractDiscrete(eqx.Module):
    """An element that is driven along a history of deflections.

    One for each :class:`~iwanjax.AbstractJoint`, made by its ``discrete``; all its constants
    are worked out once, so that a step costs no more than it must. Pure: ``step`` changes
    nothing, a solver may try as many ends of a step as it likes from one ``state``.

    Attributes
    ----------
    rate_dependent : bool
        Whether the force depends on the rate or the time that a step takes.
    """

    rate_dependent: ClassVar[bool] = False

    @abc.abstractmethod
    def init(self) -> Any:
        """State of the virgin element at rest, d = 0."""

    def earlier(self, state: Any, dt: Array) -> Any:
        """The state at rest so much earlier: the same where an element knows no time."""
        return state

    @abc.abstractmethod
    def step(self, d: Array, v: Array, dt: Array, state: Any) -> Reaction:
        """Move monotonically to deflection d within dt, to arrive at rate v.

        Parameters
        ----------
        d, v : array
            Deflection and its rate at the end of the step.
        dt : array
            Length of the step, time.
        state : pytree
            At its beginning.
        """

    def apart(self) -> tuple["AbstractDiscrete", Any]:
        """The element without inertia, and what has it: for solvers that know accelerations.

        That is None where nothing has. It gives its force by ``force(d, v, a)``, and by ``at(d)``
        the mass that it is.
        """
        return self, None

    def settled(self, state: Any, by: Array, faster: Array, stiffness: Array) -> Any:
        """The state after a step that in the end led a little further and arrived faster.

        For solvers that correct a deflection without another evaluation; to first order, and
        the state as it is where an element does not know better.

        Parameters
        ----------
        state : pytree
            At the end of the step.
        by, faster : array
            How much further, and by how much its rate is larger.
        stiffness : array
            The reaction's.
        """
        return state

    def haste(self, dt: Array) -> Array:
        """Length of a step over the element's shortest relaxation time.

        Endless where a force depends on time in a way that nothing is known of.
        """
        return jnp.asarray(jnp.inf if self.rate_dependent else 0.0, jnp.result_type(dt))

    @abc.abstractmethod
    def energy(self, d: Array, state: Any) -> Array:
        """Energy stored at deflection d, force x length."""


class HasLaw(Protocol):
    """Something with a virgin curve."""

    def law(self) -> Callable[[Array], tuple[Array, Array]]:
        """The function d -> (force, tangent)."""
        ...


class HasRateLaw(Protocol):
    """Something that resists motion."""

    def rate_law(self, v: Array) -> tuple[Array, Array]:
        """Force at rate v and its slope."""
        ...


class Elastic(AbstractDiscrete):
    """Force as a function of the deflection alone: the virgin curve, nothing remembered.

    Parameters
    ----------
    joint : joint
        Whose curve it is.
    """

    joint: HasLaw

    def init(self) -> tuple[()]:
        """Nothing."""
        return ()

    def step(self, d: Array, v: Array, dt: Array, state: tuple[()]) -> Reaction:
        """The curve at d."""
        force, tangent = self.joint.law()(d)
        zero = jnp.zeros_like(force)
        return Reaction(force, tangent + zero, zero, (), zero)

    def energy(self, d: Array, state: tuple[()]) -> Array:
        """Work to get there, by Gauss-Legendre quadrature in d t^3.

        A kink of the curve costs it 1e-3 of the energy, a power of the deflection nothing.
        """
        node = (0.5 * (_NODES + 1.0)).reshape(-1, *(1,) * jnp.ndim(d))
        weight = (1.5 * _WEIGHTS).reshape(node.shape) * node**2
        return jnp.sum(weight * self.joint.law()(d * node**3)[0], axis=0) * d


class Viscous(AbstractDiscrete):
    """Force as a function of the rate alone: all work is lost.

    Parameters
    ----------
    joint : joint
        With the law of the rate.
    """

    joint: HasRateLaw
    rate_dependent: ClassVar[bool] = True

    def init(self) -> tuple[Array, Array]:
        """Deflection and rate."""
        return jnp.zeros(()), jnp.zeros(())

    def step(self, d: Array, v: Array, dt: Array, state: tuple[Array, Array]) -> Reaction:
        """The force at v; its work by Simpson's rule along the cubic that joins both ends."""
        force, slope = self.joint.rate_law(v)
        d_0, v_0 = state
        middle = 1.5 * (d - d_0) / dt - 0.25 * (v_0 + v)
        power = [self.joint.rate_law(rate)[0] * rate for rate in (v_0, middle, v)]
        loss = dt / 6.0 * (power[0] + 4.0 * power[1] + power[2])
        return Reaction(force, jnp.zeros_like(force), slope, (d, v), loss)

    def haste(self, dt: Array) -> Array:
        """None of its own: it is what it resists that relaxes."""
        return jnp.zeros_like(dt)

    def energy(self, d: Array, state: tuple[Array, Array]) -> Array:
        """None."""
        return jnp.zeros_like(d)
