r"""How far a simulation is from the converged one, estimated while it runs.

The exact rule errs by what the joints' forces are not linear within a step. Their second
difference e says so: the mean of a parabola through three samples is :math:`-e/12` away from the
straight line's. Where the forces are in change at the first instant already, what came before it is
not known, and the first step is taken to err as the second. A fast mode errs by
what the average acceleration does otherwise than its equation of motion. What forces do within a
period that is shorter than the step cannot be seen from the step's ends: so the share of the motion
that is in such modes is known, too. A joint that turns within a step has gone further than either
end, by :math:`\delta`. The error moves on as a small motion of its own, by the same rule with the
joints' tangents; where the steps are short, by one for four of them. It is held against the motion
at the samples: of a mode that rings whole periods from one to the next they show almost nothing.

A joint of sliders remembers the force at which it turned. After a turn with the error
:math:`\varepsilon` in deflection and the slope K before it, the branch that starts there with its
full stiffness :math:`K_{ref}` is offset by :math:`\mu`, so that the force's error is continuous:

.. math:: \delta F = K\,(\varepsilon + \mu), \qquad
          K_{ref}(\varepsilon+\mu_{new}) = K(\varepsilon+\mu) - (K_{ref}-K)\,\delta
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from iwanjax.dynamics.balance import StepEnd, solved
from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.dynamics.stepping import ModalMotion, Stepper
from iwanjax.joints import Reaction
from iwanjax.types import is_traced

# Steps of a simulation for one of its error, where they are short.
_GROUP = 4
# As long as that longer step resolves every mode that joints move: omega dt below this angle, rad.
# Beyond, an error would be missed that comes and goes within a period.
_RESOLVED = 1.0
# A short run has too few steps to be sampled by groups of them.
_MANY = 128


def group_size(modal: ModalCoordinates, dt: float, steps: int) -> int:
    """Steps of a simulation for one of its error: several where they are short and many."""
    if is_traced(modal.omega2, modal.P) or steps < _MANY:
        return 1
    moved = np.any(np.asarray(modal.P) != 0.0, axis=0)
    fastest = math.sqrt(float(np.max(np.asarray(modal.omega2), where=moved, initial=0.0)))
    return _GROUP if _GROUP * dt * fastest <= _RESOLVED else 1


class ErrorState(NamedTuple):
    """The estimated error so far.

    Attributes
    ----------
    motion : ModalMotion
        Of the modes.
    g, d : (joints,) array
        Of the pseudo-forces and of the deflections.
    offset : (joints,) array
        Of the branches that the joints are on, length.
    tangent, moved : (joints,) array
        Stiffness at the last step's end, and how far that step led.
    curved : (joints,) array
        Sum of the steps' own errors since the motion's last step, force.
    exact : pair of (modes,) arrays or None
        Displacements and velocities of the fast modes under the pseudo-forces, without error.
    steps : array
        Number of steps since.
    begun : array
        Number of steps since the first instant, two for more and where nothing changed there.
    sums : (5,) array
        Squared error and, at samples, size of the elastic modes' displacements, then of their
        velocities; and squared velocities of those that joints move too fast for the step.
    """

    motion: ModalMotion
    g: Array
    d: Array
    offset: Array
    tangent: Array
    moved: Array
    curved: Array
    exact: tuple[Array, Array] | None
    steps: Array
    begun: Array
    sums: Array


class Step(NamedTuple):
    """What has happened over a step.

    Attributes
    ----------
    before, after : ModalMotion
        At its ends.
    moved : (joints,) array
        Deflections of the joints over it.
    rates : pair of (joints,) arrays
        Of the joints at its ends.
    g : three (joints,) arrays
        Pseudo-forces a step before, at the beginning and at the end.
    end : StepEnd
        What was balanced at its end.
    reaction : Reaction
        Of the joints.
    counts : array
        1, or 0 for a step behind the last sample.
    """

    before: ModalMotion
    after: ModalMotion
    moved: Array
    rates: tuple[Array, Array]
    g: tuple[Array, Array, Array]
    end: StepEnd
    reaction: Reaction
    counts: Array


class Estimator(eqx.Module):
    """What the error moves by.

    Attributes
    ----------
    by : Stepper
        What makes the simulation's steps.
    grouped : Stepper
        What makes the error's.
    remember : (joints,) bool array
        Which joints have sliders.
    size : int
        Steps of the simulation for one of the error.
    sampled_each : bool
        Whether every step of the simulation ends at a sample.
    substeps : array
        Steps of the simulation from one sample to the next.
    """

    by: Stepper
    grouped: Stepper
    remember: Bool[Array, " joints"]
    size: int = eqx.field(static=True)
    sampled_each: bool = eqx.field(static=True)
    substeps: Array

    def init(self, changing: Array) -> ErrorState:
        """No error yet; ``changing`` says whether forces are in change at the first instant."""
        modal = self.by.modal
        still, none = jnp.zeros_like(modal.omega2), jnp.zeros_like(modal.stiffness)
        pair = (still, still)
        return ErrorState(
            ModalMotion(*pair, None if self.grouped.average is None else pair),
            none,
            none,
            none,
            modal.stiffness,
            none,
            none,
            None if self.by.average is None else pair,
            jnp.zeros((), jnp.int32),
            jnp.where(changing, 0, 2),
            jnp.zeros(5, none.dtype),
        )

    def step(self, error: ErrorState, step: Step) -> ErrorState:
        """The error after another step; no derivative goes through it."""
        self, error, step = jax.lax.stop_gradient((self, error, step))
        g_before, g_0, g_1 = step.g
        errs = jnp.array([0.0, 2.0, 1.0], g_1.dtype)[error.begun] / 12.0
        error = error._replace(
            begun=jnp.minimum(error.begun + 1, 2),
            curved=error.curved + errs * (2.0 * g_0 - g_1 - g_before),
            exact=self._exact(error, step),
            offset=self._turned(error, step),
            tangent=step.reaction.stiffness,
            moved=step.moved,
            steps=error.steps + 1,
        )
        if self.size == 1:
            return self._moved(error, step)
        due = error.steps == self.size
        return jax.lax.cond(due, lambda e: self._moved(e, step), lambda e: e, error)

    def sampled(self, error: ErrorState, motion: ModalMotion, counts: Array) -> ErrorState:
        """The state at a sample: its motion counts as often as errors are added before it."""
        if self.sampled_each:
            return error
        motion = jax.lax.stop_gradient(motion)
        none = jnp.zeros((), counts.dtype)
        q, v = (self._square(x) for x in (motion.displacement, motion.velocity))
        often = counts * self.substeps / self.size
        return error._replace(sums=error.sums + often * jnp.stack([none, q, none, v, none]))

    def _square(self, x: Array) -> Array:
        """Sum of squares over the elastic modes."""
        return jnp.sum(jnp.where(self.by.modal.omega2 > 0.0, x**2, 0.0))

    def _moved(self, error: ErrorState, step: Step) -> ErrorState:
        """The error after a step of its own."""
        by, modal, reaction = self.grouped, self.by.modal, step.reaction
        curved = error.curved / self.size
        free = by.free_of(error.motion, error.g + curved, curved)
        # Of the rule for fast modes; what they do does not depend on this error again.
        off_q = off_v = jnp.zeros_like(modal.omega2)
        if error.exact is not None and step.after.correction is not None:
            (q, v), (q_found, v_found) = error.exact, step.after.correction
            off_q, off_v = q - q_found, v - v_found
        d, v = modal.P @ (free.displacement + off_q), modal.P @ (free.velocity + off_v)
        end = step.end._replace(G=by.G, H=by.H)
        soft = (end.stiffness - reaction.stiffness) * d
        g = solved(end, reaction, soft - reaction.stiffness * error.offset - reaction.damping * v)
        motion = by.pushed(free, g)
        now, none = step.after, jnp.zeros((), step.counts.dtype)
        each = self.sampled_each
        moved_fast = self.by.fast & jnp.any(modal.P != 0.0, axis=0)
        squares = jnp.stack(
            [
                self._square(off_q + motion.displacement),
                self._square(now.displacement) if each else none,
                self._square(off_v + motion.velocity),
                self._square(now.velocity) if each else none,
                jnp.sum(jnp.where(moved_fast, now.velocity**2, 0.0)),
            ]
        )
        return ErrorState(
            motion,
            g,
            d + by.G @ g,
            error.offset,
            error.tangent,
            error.moved,
            jnp.zeros_like(error.curved),
            error.exact,
            jnp.zeros_like(error.steps),
            error.begun,
            error.sums + step.counts * squares,
        )

    def _exact(self, error: ErrorState, step: Step) -> tuple[Array, Array] | None:
        """What the pseudo-forces do to the fast modes by their equation of motion."""
        if error.exact is None:
            return None
        _, g_0, g_1 = step.g
        return self.by.linear.free(*error.exact, self.by.quick(g_0), self.by.quick(g_1))

    def _turned(self, error: ErrorState, step: Step) -> Array:
        """Offsets of the joints' branches after a step."""
        stiffness, (v_0, v_1) = step.end.stiffness, step.rates
        slides = self.remember & (stiffness > 0.0)
        share = jnp.clip(error.tangent / jnp.where(slides, stiffness, 1.0), 0.0, 1.0)
        # The joint follows another branch where a step leads back from where the last one led. With
        # a mode faster than the step that is not where its rate changes sign.
        back = slides & (error.moved * step.moved < 0.0)
        offset = jnp.where(back, share * (error.d + error.offset) - error.d, error.offset)
        # Of a parabola with the rates as slopes: what lies beyond the farther of the step's ends.
        turns = slides & (v_0 * v_1 < 0.0)
        least = jnp.minimum(v_0**2, v_1**2) / jnp.where(turns, jnp.abs(v_1 - v_0), 1.0)
        beyond = 0.5 * self.by.dt * jnp.sign(v_0) * least
        return offset - jnp.where(turns, (1.0 - share) * beyond, 0.0)


def relative_error(sums: Array) -> Array:
    """Root mean square of the error over that of the motion, of displacement or velocity.

    The larger of the two; 0 where nothing moves.
    """
    error, size = sums[..., 0:4:2], sums[..., 1:4:2]
    moves = size > 0.0
    ratio = jnp.sqrt(error / jnp.where(moves, size, 1.0))
    return jnp.max(jnp.where(moves | (error != 0.0), ratio, 0.0), axis=-1)


def fast_share(sums: Array) -> Array:
    """Rms of the velocities of modes that joints move too fast for the step, over that of all."""
    size = sums[..., 3]
    return jnp.sqrt(sums[..., 4] / jnp.where(size > 0.0, size, 1.0))
