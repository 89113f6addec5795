"""The loop over time: steps, samples that are kept, and what it takes to judge the run."""

import math
from typing import Any, Literal, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.dynamics.balance import Joints, StepEnd, balance
from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.dynamics.energy import accounts, exchanged, held, work_on_joints
from iwanjax.dynamics.error_estimate import ErrorState, Estimator, Step, fast_share, relative_error
from iwanjax.dynamics.stepping import ModalMotion, Stepper
from iwanjax.joints import AbstractJoint

Quantity: TypeAlias = Literal[
    "displacement", "velocity", "acceleration", "joint_force", "joint_deflection", "energy"
]
"""What a simulation may keep."""

# Share of a step in which joints are brought to their initial deflections.
_AT_ONCE = 1e-9


class Options(NamedTuple):
    """What a kernel is compiled for.

    Attributes
    ----------
    keep : tuple of str
        Quantities.
    every : int
        Samples from one that is kept to the next.
    substeps : int or None
        Steps from one sample to the next; None where one kernel serves any number of them, which
        cannot be differentiated in reverse.
    sliders : int or None
        Of an Iwan joint.
    group : int
        Steps of the simulation for one of its error.
    judge : bool
        Whether the run's error and energy are wanted.
    compare : bool
        Whether the modes' motion is kept, to compare runs by.
    """

    keep: tuple[Quantity, ...]
    every: int
    substeps: int | None
    sliders: int | None
    group: int
    judge: bool
    compare: bool


class Run(NamedTuple):
    """What came out, with a batch on leading axes.

    Attributes
    ----------
    kept : dict of str to array
        Quantities at the samples that are kept.
    balanced : bool array
        Whether the joints were in balance at every step.
    error : array
        Estimated, relative to the motion (rms); NaN by the method "newmark".
    imbalance : array
        Largest amount of energy not accounted for, over the largest that ever went in; NaN
        where a joint does not know its energy.
    haste : array
        Largest step over the relaxation time of anything that depends on a rate.
    fast : array
        Share of the motion in modes that joints move too fast for the step, of velocities (rms).
    modes : (N, 2, modes) array or None
        Displacements and velocities of elastic modes, where they are compared.
    """

    kept: dict[str, Array]
    balanced: Array
    error: Array
    imbalance: Array
    haste: Array
    fast: Array
    modes: Array | None


class _Point(NamedTuple):
    """State of the integration at a sample."""

    motion: ModalMotion
    f: Array
    d: Array
    rate: Array
    g: Array
    g_before: Array
    states: tuple[Any, ...]
    sums: Array
    error: ErrorState | None
    haste: Array


@eqx.filter_jit
def run(
    elements: tuple[AbstractJoint, ...],
    f: Array,
    by: Stepper,
    grouped: Stepper | None,
    start: list[Array],
    substeps: Array,
    options: Options,
    axes: Any,
) -> Run:
    """Integrate one case, or a batch of them along the given axes.

    ``grouped`` is one step of the error's own for ``options.group`` of the simulation's; None
    where nobody judges the run.
    """

    def one(elements: tuple[AbstractJoint, ...], f: Array) -> Run:
        return _integrate(elements, f, by, grouped, start, substeps, options)

    if axes is None:
        return one(elements, f)
    return jax.vmap(one, in_axes=axes)(elements, f)


def _integrate(
    elements: tuple[AbstractJoint, ...],
    f: Array,
    by: Stepper,
    grouped: Stepper | None,
    start: list[Array],
    substeps: Array,
    options: Options,
) -> Run:
    """All samples that are kept, and how good they are."""
    joints = Joints.of(tuple(each.discrete(options.sliders) for each in elements))
    modal = by.modal
    P, W = modal.P, modal.W
    with_energy = "energy" in options.keep
    judged_by_rate = options.judge and joints.rate_dependent
    estimator = None
    if grouped is not None:
        each = options.substeps == 1
        estimator = Estimator(by, grouped, joints.remember, options.group, each, substeps)

    def exchange(before: _Point, after: _Point) -> list[Array]:
        f, g = (before.f, after.f), (before.g, after.g)
        if with_energy:
            return list(exchanged(by, before.motion, after.motion, f, g))
        if not options.judge:
            return [jnp.zeros((), by.dt.dtype)] * 3
        rates = [before.rate, after.rate]
        if by.average is not None:
            rates = [P @ at.motion.v for at in (before, after)]
        none = jnp.zeros((), by.dt.dtype)
        return [none, none, work_on_joints(by, (before.d, after.d), (rates[0], rates[1]), g)]

    def step(at: _Point, x: tuple[Array, Array]) -> _Point:
        f, counts = x
        free = by.free(at.motion, at.f, f, at.g)
        d, v = P @ free.displacement + modal.R_df @ f, P @ free.velocity
        end = StepEnd(joints, at.states, d, v, by.G, by.H, modal.stiffness, by.dt)
        g = balance(2.0 * at.g - at.g_before, end)
        reaction = end.react(g)
        motion, (d, rate) = by.pushed(free, g), end.ends(g)
        error = at.error
        if estimator is not None and error is not None:
            forces = (at.g_before, at.g, g)
            ends = (at.motion, motion, d - at.d, (at.rate, rate))
            taken = Step(*ends, forces, end, reaction, counts)
            error = estimator.step(error, taken)
        haste = at.haste
        if judged_by_rate:
            found = joints.haste(by.dt, reaction.damping, by.H)
            haste = jnp.maximum(haste, jax.lax.stop_gradient(found))
        after = _Point(motion, f, d, rate, g, at.g, reaction.state, at.sums, error, haste)
        spent = jnp.stack([*exchange(at, after), jnp.sum(reaction.loss)])
        return after._replace(sums=at.sums + spent)

    def sample(at: _Point, x: tuple[Array, Array]) -> tuple[_Point, None]:
        f, counts = x
        if options.substeps == 1:
            return step(at, x), None
        begin = at.f

        def part(i: Array, at: _Point) -> _Point:
            return step(at, (begin + (i + 1) / substeps * (f - begin), counts))

        many = substeps if options.substeps is None else options.substeps
        at = jax.lax.fori_loop(0, many, part, at)
        if estimator is not None and at.error is not None:
            at = at._replace(error=estimator.sampled(at.error, at.motion, counts))
        return at, None

    def energies(at: _Point) -> Array:
        q, v = at.motion.displacement, at.motion.velocity
        d = at.d
        stored = jnp.sum(joints.energy(d, at.states))
        return jnp.concatenate([held(modal, q, v, d, at.g, at.f), stored[None], at.sums])

    def kept(at: _Point) -> dict[str, Array]:
        q, v = at.motion.displacement, at.motion.velocity
        p = W @ at.f + P.T @ at.g
        d = at.d
        lost = modal.C * v if modal.C.ndim == 1 else modal.C @ v
        found = {
            "displacement": modal.Y @ q + modal.R_yg @ at.g + modal.R_yf @ at.f,
            "velocity": modal.Y @ v,
            "acceleration": modal.Y @ (p - lost - modal.omega2 * q),
            "joint_force": modal.stiffness * d - at.g,
            "joint_deflection": d,
            "energy": energies(at),
        }
        # What nobody asked for is not even computed once this is compiled.
        wanted = {name: found[name] for name in options.keep}
        if options.compare:
            wanted["modes"] = jnp.where(modal.omega2 > 0.0, jnp.stack([q, v]), 0.0)
        return wanted | {"ok": jnp.all(jnp.isfinite(at.g))}

    def keep(at: _Point, x: tuple[Array, Array]) -> tuple[_Point, dict[str, Array]]:
        f, counts = x
        if options.every == 1:
            at = sample(at, (f[0], counts))[0]
        else:
            at = jax.lax.scan(lambda a, f: sample(a, (f, counts)), at, f)[0]
        return at, kept(at)

    first = _first(modal, joints, f[0], start, by, estimator)
    count = (f.shape[0] - 1) // options.every
    length = max(1, math.isqrt(count))
    blocks = -(-count // length)
    used = f[1 : 1 + count * options.every]
    padding = blocks * length * options.every - used.shape[0]
    used = jnp.concatenate([used, jnp.broadcast_to(used[-1:], (padding, f.shape[1]))])
    shape = (blocks, length)
    counts = jnp.where(jnp.arange(blocks * length) < count, 1.0, 0.0).reshape(shape)
    # In reverse each block is run again from its beginning: memory grows with the root.
    rows = jax.checkpoint(lambda at, x: jax.lax.scan(keep, at, x), prevent_cse=False)

    def block(at: _Point, x: Any) -> tuple[_Point, tuple[dict[str, Array], Array]]:
        at, found = rows(at, x)
        return at, (found, energies(at) if options.judge else jnp.zeros(0))

    xs = (used.reshape(*shape, options.every, f.shape[1]), counts)
    last, (whole, balances) = jax.lax.scan(block, first, xs)
    initial = kept(first)
    whole = {
        name: jnp.concatenate(
            [initial[name][None], row.reshape(blocks * length, *row.shape[2:])[:count]]
        )
        for name, row in whole.items()
    }
    unknown = jnp.full((), jnp.nan, f.dtype)
    return Run(
        balanced=jnp.all(whole.pop("ok")),
        modes=whole.pop("modes", None),
        kept=whole,
        haste=last.haste,
        fast=jnp.zeros((), f.dtype) if last.error is None else fast_share(last.error.sums),
        error=unknown if last.error is None else relative_error(last.error.sums),
        imbalance=_imbalance(energies(first), balances, with_energy) if options.judge else unknown,
    )


def _imbalance(first: Array, rows: Array, with_energy: bool) -> Array:
    """Energy not accounted for over what went in, by each account that was kept."""
    energy = accounts(jax.lax.stop_gradient(jnp.concatenate([first[None], rows])))
    missing = [energy.joints - energy.slip]
    held = energy.kinetic + energy.elastic + energy.stored
    if with_energy:
        missing += [energy.imbalance, energy.imbalance + missing[0]]
    # What was held or lost in joints by any instant went in before.
    went_in = jnp.max(held + energy.slip)
    most = jnp.max(jnp.abs(jnp.stack(missing)))
    return jnp.where(most == 0.0, 0.0, most / jnp.where(went_in > 0.0, went_in, 1.0))


def _first(
    modal: ModalCoordinates,
    joints: Joints,
    f: Array,
    start: list[Array],
    by: Stepper,
    estimator: Estimator | None,
) -> _Point:
    """The state at t = 0: joints brought to their deflections at once, without turning."""
    q, v = start
    m = joints.count
    still = jnp.zeros_like(q)
    correction = None if by.average is None else (still, still)
    end = StepEnd(
        joints,
        joints.init(),
        modal.P @ q + modal.R_df @ f,
        modal.P @ v,
        modal.R_dg,
        jnp.zeros((m, m), q.dtype),
        modal.stiffness,
        _AT_ONCE * by.dt,
    )
    g = balance(jnp.zeros(m, q.dtype), end)
    motion, (d, rate) = ModalMotion(q, v, correction), end.ends(g)
    state, none = end.react(g).state, jnp.zeros((), q.dtype)
    changing = jnp.any(v != 0.0)
    if joints.rate_dependent:
        changing |= jnp.any(q != 0.0) | jnp.any(f != 0.0)
    error = None if estimator is None else estimator.init(changing)
    return _Point(motion, f, d, rate, g, g, state, jnp.zeros(4, q.dtype), error, none)
