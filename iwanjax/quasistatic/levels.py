"""All levels, modes and parameter sets of a quasi-static modal analysis, chunk by chunk."""

import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Literal, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Float, Int

from iwanjax.joints import AbstractJoint, PowerLawDamping
from iwanjax.quasistatic.alike import of_each
from iwanjax.quasistatic.condensation import Reduction, reduce_to_joints
from iwanjax.quasistatic.equilibrium import equilibrium, joint_deflections
from iwanjax.results import Result
from iwanjax.structures import ModalBasis
from iwanjax.threads import available_threads
from iwanjax.types import is_traced

# Relative Newton step above which a level counts as not solved; iteration aims ten times lower.
_ACCEPTED = 1e-9
# Deflection over that of the stuck structure beyond which only round-off holds the structure.
_RUNAWAY = 1e8
# Lanes (levels x modes x sets) worked on at once: few enough to stay in the cache.
_LANES = 4800
BLOCK = 2048
"""Sets handed to one core at a time."""

Background: TypeAlias = Float[Array, " modes"] | PowerLawDamping
"""Damping ratio beside the joints: one number a mode, or a law of the modal amplitude."""


class Levels(NamedTuple):
    """Arrays (sets, modes, levels) unless said otherwise; NaN where not converged.

    Attributes
    ----------
    q : modal displacement phi^T M u.
    frequency : natural frequency, Hz.
    damping : damping ratio.
    dissipation : energy per cycle in the joints.
    result : Result code.
    error : relative size of the last Newton step.
    deflection : (sets, modes, levels, joints) amplitude of each joint, or None.
    """

    q: Float[Array, "sets modes levels"]
    frequency: Float[Array, "sets modes levels"]
    damping: Float[Array, "sets modes levels"]
    dissipation: Float[Array, "sets modes levels"]
    result: Int[Array, "sets modes levels"]
    error: Float[Array, "sets modes levels"]
    deflection: Float[Array, "sets modes levels joints"] | None


class Task(eqx.Module):
    """What to compute; the same for all parameter sets.

    Parameters
    ----------
    basis : ModalBasis
        Reference modes.
    alpha : (modes, levels) array
        Increasing load levels of each mode.
    background : (modes,) array or PowerLawDamping
        Damping ratio beside the joints.
    modes : (modes,) array of int
        Which modes of the reference; traced, so that all share one compiled kernel.
    fixed : bool
        Whether the joints' stiffness is the reference's.
    frequency : {"secant", "first_harmonic"}
        Which stiffness of the modal loop the frequency is that of.
    deflections : bool
        Whether to return the joints' deflections.
    """

    basis: ModalBasis
    alpha: Float[Array, "modes levels"]
    background: Background
    modes: Int[Array, " modes"]
    fixed: bool = eqx.field(static=True)
    frequency: Literal["secant", "first_harmonic"] = eqx.field(static=True)
    deflections: bool = eqx.field(static=True)


def solve_levels(joints: tuple[AbstractJoint, ...], task: Task) -> Levels:
    """Solve a batch of parameter sets, on all cores when it is large.

    Parameters
    ----------
    joints : m joints
        Leaves scalar or (sets,).
    task : Task

    Returns
    -------
    Levels
        With one set when no leaf is batched.
    """
    batched, shared = eqx.partition(joints, lambda leaf: jnp.ndim(leaf) == 1)
    leaves = jax.tree.leaves(batched)
    sets = leaves[0].shape[0] if leaves else 1
    if is_traced(joints, task) or jax.default_backend() != "cpu" or sets <= BLOCK:
        return _solve_chunks(joints, task)
    # XLA gains next to nothing from a second core on arrays that fit the cache; two calls
    # side by side do. Blocks of one size share one compiled kernel.
    out: list[np.ndarray] | None = None
    lock = threading.Lock()

    def block(start: int) -> None:
        nonlocal out
        index = np.minimum(np.arange(start, start + BLOCK), sets - 1)
        part = jax.tree.map(lambda leaf: leaf[index], batched)
        found = [
            np.asarray(x) for x in _solve_chunks(eqx.combine(part, shared), task) if x is not None
        ]
        with lock:
            if out is None:
                out = [np.empty((sets, *x.shape[1:]), x.dtype) for x in found]
        count = min(BLOCK, sets - start)
        for whole, x in zip(out, found, strict=True):
            whole[start : start + count] = x[:count]

    block(0)
    with ThreadPoolExecutor(available_threads()) as pool:
        list(pool.map(block, range(BLOCK, sets, BLOCK)))
    arrays = [jnp.asarray(x) for x in out or []]
    return Levels(*arrays) if task.deflections else Levels(*arrays, deflection=None)


@eqx.filter_jit
def _solve_chunks(joints: tuple[AbstractJoint, ...], task: Task) -> Levels:
    """The same in one compiled call, chunk by chunk."""
    batched, shared = eqx.partition(joints, lambda leaf: jnp.ndim(leaf) == 1)
    leaves = jax.tree.leaves(batched)
    sets = leaves[0].shape[0] if leaves else 1
    chunk = max(16, _LANES // task.alpha.size) if jax.default_backend() == "cpu" else sets
    if sets <= chunk:
        return _solve_chunk(joints, task)
    chunks = -(-sets // chunk)
    # The last chunk is filled up with copies of the last set.
    index = np.minimum(np.arange(chunks * chunk), sets - 1).reshape(chunks, chunk)

    # Saving the equilibrium alone lets a gradient rebuild the rest with one evaluation.
    @partial(jax.checkpoint, policy=jax.checkpoint_policies.save_only_these_names("equilibrium"))
    def one(part: tuple[AbstractJoint, ...]) -> Levels:
        return _solve_chunk(eqx.combine(part, shared), task)

    out = jax.lax.map(one, jax.tree.map(lambda leaf: leaf[index], batched))
    return jax.tree.map(lambda x: x.reshape(chunks * chunk, *x.shape[2:])[:sets], out)


def _solve_chunk(joints: tuple[AbstractJoint, ...], task: Task) -> Levels:
    """The same for one chunk, worked with the sets on the last axis."""
    reduction = reduce_to_joints(task.basis, joints, task.modes, task.fixed)
    mode = reduction.mode
    kept = tuple(joints[i] for i in reduction.nonlinear)
    load = jnp.moveaxis(task.alpha, -1, 0)[..., None]
    e, error = equilibrium(kept, reduction.system, load)
    e = [checkpoint_name(x, "equilibrium") for x in e]
    d_kept = joint_deflections(reduction.system, e)
    pull = jnp.zeros(())
    softening = jnp.zeros(())

    def slack(joint: AbstractJoint, x: Array) -> tuple[Array, ...]:
        """Force that a joint lacks to its stuck one, at the tip and in the first harmonic."""
        missing = joint.initial_stiffness * x - joint.law()(x)[0]
        if task.frequency == "secant":
            return (missing,)
        return missing, (joint.initial_stiffness - joint.harmonic_stiffness(x)) * x

    for i, each in zip(reduction.nonlinear, of_each(slack, kept, d_kept), strict=True):
        pull = pull + mode.y[i] * each[0]
        softening = softening + mode.y[i] * each[-1]
    q = (load + pull) / mode.lam
    secant = load / q
    lam = secant if task.frequency == "secant" else mode.lam - softening / q
    d = reduction.all_deflections(d_kept, load)
    omega = jnp.sqrt(secant)
    lost = of_each(lambda joint, x: (joint.dissipation(x, omega=omega),), joints, d)
    dissipation = sum((energy for (energy,) in lost), jnp.zeros(()))
    background = task.background
    zeta0 = background(q) if callable(background) else background[:, None]
    damping = dissipation / (2.0 * jnp.pi * load * q) + zeta0
    result = jax.lax.stop_gradient(_judge(reduction, load, d_kept, error))
    good = result == Result.CONVERGED
    shape = jnp.broadcast_shapes(q.shape, result.shape)

    def out(x: Array, missing: float | None = jnp.nan) -> Array:
        x = x if missing is None else jnp.where(good, x, missing)
        return jnp.transpose(jnp.broadcast_to(x, shape), (2, 1, 0))

    return Levels(
        q=out(q),
        frequency=out(jnp.sqrt(lam) / (2.0 * jnp.pi)),
        damping=out(damping),
        dissipation=out(dissipation),
        result=out(result, None),
        error=out(error, None),
        deflection=jnp.stack([out(x) for x in d], axis=-1) if task.deflections else None,
    )


def _judge(reduction: Reduction, alpha: Array, d: list[Array], error: Array) -> Array:
    """What to call the outcome of each level."""
    mode = reduction.mode
    stuck = alpha * jnp.stack([jnp.abs(y) for y in mode.y]).max(axis=0) / mode.lam
    size = jnp.stack([jnp.abs(x) for x in d]).max(axis=0)
    result = jnp.where(error <= _ACCEPTED, Result.CONVERGED, Result.EXHAUSTED)
    result = jnp.where(size <= _RUNAWAY * stuck, result, Result.NO_EQUILIBRIUM)
    return jnp.where(mode.assurance > 0.5, result, Result.LOST_MODE).astype(jnp.int8)
