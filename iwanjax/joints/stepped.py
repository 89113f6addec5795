"""Elements that their step defines: all else about them follows by numerics."""

from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.abstract import Law
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.force_law import AbstractForceLaw, PlaceMotion
from iwanjax.types import ArrayLike, real

# Length of a step in which whatever depends on the rate has come to rest, s.
_ENDLESS = 1e30
# Steps of a half cycle, and half cycles until it repeats itself. The loss errs by an eighth of a
# step's square: 2e-4 of a slider's.
_STEPS, _HALVES = 128, 8


class AbstractStepped(AbstractForceLaw):
    """A law of one's own: its parameters and :meth:`follow` are all that it has to have.

    Closed forms may override what is worked out here. Its stiffness at large amplitude is not
    known (NaN) unless it says so.

    Attributes
    ----------
    rate_dependent : bool
        Whether the force depends on the rate, or on the time that a step takes.
    """

    rate_dependent: ClassVar[bool] = True

    @property
    def initial_stiffness(self) -> Array:
        """Slope of the virgin curve at rest, force/length."""
        return self.law()(jnp.zeros(self._shape()))[1]

    @property
    def limit_stiffness(self) -> Array:
        """Not known."""
        return jnp.full(self._shape(), jnp.nan)

    def discrete(self, sliders: int | None = None) -> "Stepped":
        """The element's own step."""
        return SteppedByRate(self) if self.rate_dependent else Stepped(self)

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent): one step from rest, without end in time."""

        def force(d: Array) -> Array:
            still = jnp.zeros_like(d)
            motion = PlaceMotion(d, still, still, d, jnp.asarray(_ENDLESS))
            return self.follow(motion, jnp.zeros(jnp.broadcast_shapes(d.shape, self._shape())))[0]

        return lambda d: jax.jvp(force, (d,), (jnp.ones_like(d),))

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Slope from tip to tip of the steady cycle, force/length."""
        amplitude = jnp.abs(real(d))
        at_rest = amplitude == 0
        safe = jnp.where(at_rest, 1.0, amplitude)
        tips = self.loading(safe, safe) - self.loading(-safe, safe)
        return jnp.where(at_rest, self.initial_stiffness, 0.5 * tips / safe)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Energy per steady cycle of amplitude |d|, force x length.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        omega : array_like, optional
            Circular frequency of the harmonic cycle, rad/s; for a force that depends on rate.

        Raises
        ------
        InputError
            When such a force gets none.
        """
        if omega is None and self.rate_dependent:
            raise InputError(
                f"{type(self).__name__}.dissipation needs omega= (rad/s): its loss depends on rate"
            )
        amplitude = jnp.abs(real(d))
        phase = np.pi * np.arange(_HALVES * _STEPS + 1) / _STEPS
        path = _cycles(phase, amplitude)
        rate = real(1.0 if omega is None else omega)
        force, _ = self._driven(path, rate * _cycles(phase + 0.5 * np.pi, amplitude), rate)
        one = 2 * _STEPS
        mean = 0.5 * (force[-one:] + force[-one - 1 : -1])
        return jnp.sum(mean * jnp.diff(path[-one - 1 :], axis=0), axis=0)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Force on the loading branch, from -d_0 to d_0, of the steady quasi-static cycle."""
        to, amplitude = jnp.broadcast_arrays(real(d), jnp.abs(real(d_0)))
        phase = np.pi * np.arange(1, (_HALVES - 1) * _STEPS + _STEPS // 2 + 1) / _STEPS
        turns = -_cycles(phase, amplitude)
        share = (0.5 * (1.0 - np.cos(np.pi * np.arange(_STEPS + 1) / _STEPS))).reshape(
            -1, *(1,) * to.ndim
        )
        branch = turns[-1] + share * (to - turns[-1])
        path = jnp.concatenate([jnp.zeros_like(to)[None], turns, branch])
        return self._driven(path, jnp.zeros_like(path), None)[0][-1]

    def _driven(self, d: Array, v: Array, omega: Array | None) -> tuple[Array, Array]:
        """Forces at all of a path but its first point, and the memory; slowly without a rate."""
        dt = jnp.asarray(_ENDLESS) if omega is None else np.pi / _STEPS / omega
        still = jnp.zeros(jnp.broadcast_shapes(d.shape[1:], self._shape()))
        a = jnp.zeros_like(d) if omega is None else -(omega**2) * d

        def step(memory: Array, ends: tuple[Array, Array, Array, Array]) -> tuple[Array, Array]:
            to, rate, a, moved = ends
            force, memory = self.follow(PlaceMotion(to, rate, a, moved, dt), memory)
            return jnp.broadcast_to(memory, still.shape), jnp.broadcast_to(force, still.shape)

        memory, force = jax.lax.scan(step, still, (d[1:], v[1:], a[1:], jnp.diff(d, axis=0)))
        return force, memory

    def _shape(self) -> tuple[int, ...]:
        """Of a batch of parameter sets."""
        return jnp.broadcast_shapes(
            *(jnp.shape(getattr(self, info.name)) for info in self.parameters)
        )


def _cycles(phase: np.ndarray, amplitude: Array) -> Array:
    return jnp.asarray(np.sin(phase)).reshape(-1, *(1,) * amplitude.ndim) * amplitude


class SteppedState(NamedTuple):
    """What a stepped element remembers.

    Attributes
    ----------
    d, v, v_before : array
        Deflection and rate at the end of the last step, and the rate at its beginning.
    steps : array
        How many there were, two for more.
    force, memory : array
        At the end of the last step.
    by_d, by_v : array
        What more of d and of v there adds to the memory.
    """

    d: Array
    v: Array
    v_before: Array
    steps: Array
    force: Array
    memory: Array
    by_d: Array
    by_v: Array


class Stepped(AbstractDiscrete):
    r"""An element's own step as its motion.

    The acceleration is a backward difference of second order,
    :math:`(\tfrac32 v_1 - 2 v_0 + \tfrac12 v_{-1})/\Delta t`, which any inertia leaves stable; none
    over the first step, which leads to where a motion begins, and of first order over the second.
    All work counts as lost, by the trapezoidal rule: of what the element stores nothing is known.

    Parameters
    ----------
    joint : AbstractStepped
        One parameter set.
    """

    joint: AbstractForceLaw

    def init(self) -> SteppedState:
        """At rest."""
        return SteppedState(*(jnp.zeros(()),) * 8)

    def step(self, d: Array, v: Array, dt: Array, state: SteppedState) -> Reaction:
        """Move to d, to arrive at rate v."""

        def react(d: Array, v: Array) -> tuple[Array, Array]:
            rise = jnp.where(
                state.steps > 1.0,
                1.5 * v - 2.0 * state.v + 0.5 * state.v_before,
                state.steps * (v - state.v),
            )
            a = rise / dt
            return self.joint.follow(PlaceMotion(d, v, a, d - state.d, dt), state.memory)

        one, none = jnp.ones_like(d), jnp.zeros_like(d)
        (force, memory), (stiffness, by_d) = jax.jvp(react, (d, v), (one, none))
        _, (damping, by_v) = jax.jvp(react, (d, v), (none, one))
        loss = 0.5 * (force + state.force) * (d - state.d)
        steps = jnp.minimum(state.steps + 1.0, 2.0)
        after = SteppedState(d, v, state.v, steps, force, memory, by_d, by_v)
        return Reaction(force, stiffness, damping, after, loss)

    def settled(
        self, state: SteppedState, by: Array, faster: Array, stiffness: Array
    ) -> SteppedState:
        """The same step with another end, to first order."""
        return state._replace(
            d=state.d + by,
            v=state.v + faster,
            force=state.force + stiffness * by,
            memory=state.memory + state.by_d * by + state.by_v * faster,
        )

    def energy(self, d: Array, state: SteppedState) -> Array:
        """None that is known of."""
        return jnp.zeros_like(d)


class SteppedByRate(Stepped):
    """The same where the force depends on the rate."""

    rate_dependent: ClassVar[bool] = True
