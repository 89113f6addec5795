r"""Mode shapes that follow the amplitude, for large slip.

In modal coordinates of the stuck structure, eta = Phi^T M u, a joint's loss of force
g = K_T d - f(d) acts on every mode. The thesis loads the structure in the linear shape
and leaves the other modes static,

.. math:: d = q\,p_r + W_r(0)\,g(d), \qquad
          W_r(\lambda) = \sum_{k\ne r} \frac{p_k p_k^T}{\lambda_k-\lambda} .

A shape that vibrates at omega^2 = lambda takes the others' inertia along: W_r(lambda) in
place of W_r(0), with lambda = lambda_r - p_r^T g/q. That is the fixed point of updating
the load's shape by the deflection it causes (after Festjens et al. 2013), and the mode of
the structure with its joints replaced by their secants.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints import AbstractJoint
from iwanjax.quasistatic.levels import Levels, Task
from iwanjax.results import Result

_TOLERANCE = 1e-11
_MAX_STEPS = 200
# Mismatch of the deflections, relative to the largest, above which a level is not solved.
_ACCEPTED = 1e-9


class _Lane(NamedTuple):
    """One level of one mode of one parameter set."""

    d: Float[Array, " joints"]
    q: Array
    lam: Array
    norm2: Array
    error: Array
    done: Array


def updated_shapes(
    joints: tuple[AbstractJoint, ...], task: Task, found: Levels, start: Array
) -> Levels:
    """Solve every level again with its shape updated, starting from the linear shape's.

    Frequency is that of the updated shape; damping is energy lost over 4 pi times its
    kinetic energy, so that the other modes' share of the motion counts.

    Parameters
    ----------
    joints : m joints
        Leaves scalar or (sets,); of the reference's stiffness.
    task : Task
        As for the linear shape.
    found : Levels
        The linear shape's solution.
    start : (sets, modes, levels, joints) array
        Its deflections.

    Returns
    -------
    Levels
    """
    import optimistix as optx  # here, because few need it and it is slow to import

    basis = task.basis

    def lane(r: Array, elements: tuple[AbstractJoint, ...], alpha: Array, start: Array) -> _Lane:
        p = basis.P[:, r]
        other = jnp.arange(basis.omega2.shape[0]) != r
        # A lane the linear shape did not solve is not tried: any finite start will do.
        solved = jnp.all(jnp.isfinite(start))
        safe = jnp.where(solved, start, alpha * p / basis.omega2[r])
        scale = jnp.max(jnp.abs(jax.lax.stop_gradient(safe)))

        def motion(d: Array) -> tuple[Array, Array, Array]:
            slack = [
                element.initial_stiffness * x - element.law()(x)[0]
                for element, x in zip(elements, d, strict=True)
            ]
            g = jnp.stack(slack)
            q = (alpha + p @ g) / basis.omega2[r]
            lam = alpha / q
            distance = jnp.where(other, basis.omega2 - lam, 1.0)
            return q, lam, jnp.where(other, g @ basis.P, 0.0) / distance

        def mismatch(x: Array, _: None) -> Array:
            q, _lam, others = motion(x * scale)
            return x - (q * p + basis.P @ others) / scale

        solver = optx.Dogleg(rtol=_TOLERANCE, atol=_TOLERANCE)
        solution = optx.root_find(mismatch, solver, safe / scale, max_steps=_MAX_STEPS, throw=False)
        d = solution.value * scale
        q, lam, others = motion(d)
        error = jax.lax.stop_gradient(jnp.max(jnp.abs(mismatch(solution.value, None))))
        done = solved & (solution.result == optx.RESULTS.successful) & (error < _ACCEPTED)
        return _Lane(d, q, lam, q**2 + jnp.sum(others**2), error, done)

    in_axes = jax.tree.map(lambda leaf: 0 if jnp.ndim(leaf) else None, joints)
    over_levels = jax.vmap(lane, in_axes=(None, None, 0, 0))
    over_modes = jax.vmap(over_levels, in_axes=(0, None, 0, 0))
    over_sets = jax.vmap(over_modes, in_axes=(None, in_axes, None, 0))
    lanes = over_sets(task.modes, joints, task.alpha, start)
    spread = jax.tree.map(lambda leaf: leaf[:, None, None] if jnp.ndim(leaf) else leaf, joints)
    energy, softening = jnp.zeros(()), jnp.zeros(())
    for j, element in enumerate(spread):
        x = lanes.d[..., j]
        energy = energy + element.dissipation(x, omega=jnp.sqrt(lanes.lam))
        if task.frequency == "first_harmonic":
            pull = basis.P[j, task.modes][:, None]
            softening = softening + pull * (element.harmonic_stiffness(x) - element.secant(x)) * x
    lam = lanes.lam + softening / lanes.q
    background = task.background
    zeta0 = background(lanes.q) if callable(background) else background[:, None]
    damping = energy / (2.0 * jnp.pi * lanes.lam * lanes.norm2) + zeta0

    def kept(x: Array) -> Array:
        return jnp.where(lanes.done, x, jnp.nan)

    return Levels(
        q=kept(lanes.q),
        frequency=kept(jnp.sqrt(lam) / (2.0 * jnp.pi)),
        damping=kept(damping),
        dissipation=kept(energy),
        result=jnp.where(
            (found.result == Result.CONVERGED) & ~lanes.done, Result.EXHAUSTED, found.result
        ).astype(jnp.int8),
        error=lanes.error,
        deflection=jnp.where(lanes.done[..., None], lanes.d, jnp.nan),
    )
