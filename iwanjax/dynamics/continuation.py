"""Periodic motions one after the other, each by Newton's method from the last."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex

from iwanjax.dynamics.harmonic_balance import Motion, PeriodicSystem
from iwanjax.dynamics.steady_control import Control

_MOST_ITERATIONS = 50


class Solution(NamedTuple):
    """A motion in balance.

    Attributes
    ----------
    motion : Motion
        NaN where no balance was found.
    force : (joints, harmonics) complex array
        Of the joints.
    response : (sensors, harmonics) complex array
        Displacements at the sensors.
    balanced : bool array
        Whether a balance was found.
    """

    motion: Motion
    force: Complex[Array, "joints harmonics"]
    response: Complex[Array, "sensors harmonics"]
    balanced: Bool[Array, ""]


class _Corrector(NamedTuple):
    z: Array
    step: Array
    J: Array
    share: Array
    size: Array
    balanced: Array
    iterations: Array


class _Equations(NamedTuple):
    """Residual of one motion as a function of z: deflections in ``unit``, and what is beside."""

    system: PeriodicSystem
    control: Control
    unit: Array

    def pack(self, motion: Motion) -> Array:
        X = motion.X / self.unit
        parts = [X.real.ravel(), X.imag.ravel(), self.control.beside(motion)]
        return jnp.concatenate(parts)

    def motion(self, z: Array) -> Motion:
        shape = (self.system.joints.count, len(self.system.cycle.harmonics))
        count = shape[0] * shape[1]
        X = (z[:count] + 1j * z[count : 2 * count]).reshape(shape) * self.unit
        return self.control.motion(X, z[2 * count :])

    def balanced(self, z: Array, r: Array, tolerance: Array) -> Array:
        """Whether a residual is small against the deflections, its conditions against one.

        A frequency or force that runs away makes nothing balanced: it counts as one at most.
        """
        count = 2 * self.system.joints.count * len(self.system.cycle.harmonics)
        size = jnp.max(jnp.abs(jnp.concatenate([z[:count], jnp.clip(z[count:], -1.0, 1.0)])))
        away = jnp.max(jnp.abs(r[:count])) <= tolerance * size
        return away & jnp.all(jnp.abs(r[count:]) <= tolerance) & (self.motion(z).omega > 0.0)

    def residual(self, z: Array, F: Array) -> Array:
        motion = self.motion(z)
        found = self.system.balance(motion, F, self.control.linear(self.system, motion))
        away = found.residual / self.unit
        extra = self.control.conditions(found.response[0, self.system.cycle.first])
        return jnp.concatenate([away.real.ravel(), away.imag.ravel(), extra])

    def evaluate(self, z: Array) -> tuple[Array, Array]:
        """Residual and its derivative, whose dear part, the joints', is taken joint by joint."""
        at = self.motion(z)
        count = len(self.system.cycle.harmonics)

        def forces(coefficients: Array, omega: Array) -> tuple[Array, Array]:
            F = self.system.forces(coefficients[:, :count] + 1j * coefficients[:, count:], omega)
            return F, F

        coefficients = jnp.concatenate([at.X.real, at.X.imag], axis=1)
        # A joint's force depends on its own deflection alone: all are moved at a time.
        directions = [jnp.eye(2 * count), jnp.zeros(2 * count)]
        if self.control.finds_frequency:
            directions[0] = jnp.concatenate([directions[0], jnp.zeros((1, 2 * count))])
            directions[1] = jnp.concatenate([directions[1], jnp.ones(1)])

        def slope(direction: Array, rate: Array) -> tuple[Array, Array]:
            moved = jnp.broadcast_to(direction, coefficients.shape)
            _, dF, F = jax.jvp(forces, (coefficients, at.omega), (moved, rate), has_aux=True)
            return dF, F

        slopes, F = jax.vmap(slope, out_axes=(0, None))(*directions)

        def linearised(z: Array) -> Array:
            motion = self.motion(z)
            moved = motion.X - at.X
            change = jnp.concatenate([moved.real, moved.imag], axis=1)
            dF = jnp.einsum("kjh,jk->jh", slopes[: 2 * count], change)
            if self.control.finds_frequency:
                dF = dF + slopes[-1] * (motion.omega - at.omega)
            return self.residual(z, F + dF)

        return self.residual(z, F), jax.jacfwd(linearised)(z)


def follow(system: PeriodicSystem, controls: Control, tolerance: Array) -> Solution:
    """Motions one after the other, each from the last that was found.

    Where that leads nowhere, as beyond a fold, Newton's method starts from the motion of a
    linear structure and then from a larger motion against the phase. Where the frequency is
    unknown, a start has that which its own joint forces ask for, so that a level may be any
    multiple of the last.

    Parameters
    ----------
    system : PeriodicSystem
        What moves.
    controls : Control
        With a leading axis over the motions.
    tolerance : array
        Of the balance, relative to the deflections.

    Returns
    -------
    Solution
        With that axis. Differentiable: one more Newton step carries the derivatives.
    """
    start = jax.tree.map(lambda x: x[0], controls)

    def point(last: tuple[Motion, Array], control: Control) -> tuple[Any, Solution]:
        motion, level = last
        fixed, known = jax.lax.stop_gradient((system, control))
        elastic = known.tuned(fixed, known.guess(fixed))
        ratio = known.level / level
        scaled = known.tuned(fixed, Motion(motion.X * ratio, motion.f * ratio, motion.omega))
        # A jump to larger motion passes resonance: the phase turns.
        jumped = Motion(-2.0 * scaled.X, motion.f * ratio, motion.omega)
        solution = _solve(system, control, (scaled, elastic, jumped), tolerance)
        found = jax.lax.stop_gradient((solution.motion, control.level))
        kept = jax.tree.map(
            lambda new, old: jnp.where(solution.balanced, new, old), found, (motion, level)
        )
        return kept, solution

    first = jax.lax.stop_gradient((start.guess(system), start.level))
    return jax.lax.scan(point, first, controls)[1]


def _solve(
    system: PeriodicSystem, control: Control, guesses: tuple[Motion, ...], tolerance: Array
) -> Solution:
    """One motion by a safeguarded Newton method, from whichever guess leads to it."""
    frozen = jax.lax.stop_gradient((system, control, guesses))
    size = jnp.max(jnp.abs(frozen[2][1].X))
    unit = jnp.where(size > 0.0, size, 1.0)
    equations = _Equations(frozen[0], frozen[1], unit)
    attempts = jnp.stack([equations.pack(guess) for guess in frozen[2]])

    def attempt(found: _Corrector, z: Array) -> tuple[_Corrector, None]:
        fresh = _Corrector(
            jnp.where(found.balanced, found.z, z),
            jnp.zeros_like(z),
            found.J,
            jnp.ones(()),
            jnp.full((), jnp.inf),
            found.balanced,
            jnp.zeros((), jnp.int32),
        )
        return _newton(equations, fresh, tolerance), None

    nowhere, one = jnp.zeros_like(attempts[0]), jnp.ones(())
    J = jnp.eye(nowhere.size)
    none = _Corrector(nowhere, nowhere, J, one, one, jnp.zeros((), bool), jnp.zeros((), jnp.int32))
    found, _ = jax.lax.scan(attempt, none, attempts)
    # The last step is taken with everything free to vary.
    whole = _Equations(system, control, unit)
    at = whole.motion(found.z)
    r = whole.residual(found.z, system.forces(at.X, at.omega))
    z = found.z - jnp.linalg.solve(found.J, r)
    motion = whole.motion(jnp.where(found.balanced, z, jnp.nan))
    F = system.forces(motion.X, motion.omega)
    response = system.balance(motion, F, control.linear(system, motion)).response
    return Solution(motion, F, response, found.balanced)


def _newton(equations: _Equations, start: _Corrector, tolerance: Array) -> _Corrector:
    """A step that does not make the residual smaller is halved until it does."""

    def proceed(trial: _Corrector) -> Array:
        return ~trial.balanced & (trial.iterations < _MOST_ITERATIONS)

    def advance(trial: _Corrector) -> _Corrector:
        z = trial.z + trial.share * trial.step
        r, J = equations.evaluate(z)
        size = jnp.max(jnp.abs(r))
        better = size < trial.size
        balanced = equations.balanced(z, r, tolerance)
        return _Corrector(
            jnp.where(better, z, trial.z),
            jnp.where(better, -jnp.linalg.solve(J, r), trial.step),
            jnp.where(better, J, trial.J),
            jnp.where(better, 1.0, 0.5 * trial.share),
            jnp.where(better, size, trial.size),
            balanced,
            trial.iterations + 1,
        )

    return jax.lax.while_loop(proceed, advance, start)
