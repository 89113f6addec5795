"""The response of a jointed structure in time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.dynamics.balance import Joints, StepEnd, balance
from iwanjax.dynamics.coordinates import ModalCoordinates, modal_coordinates
from iwanjax.dynamics.propagator import Method, Propagator, propagator
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.joints.sliders import SLIDERS
from iwanjax.structures import JointedStructure
from iwanjax.types import ArrayLike, as_real, is_traced, require_double_precision

Quantity: TypeAlias = Literal[
    "displacement", "velocity", "acceleration", "joint_force", "joint_deflection", "energy"
]
"""What a simulation may keep."""

QUANTITIES: tuple[Quantity, ...] = ("displacement", "velocity", "acceleration", "joint_force")
"""What it keeps unless told otherwise."""


# Share of a step in which joints are brought to their initial deflections.
_AT_ONCE = 1e-9


class Energies(NamedTuple):
    """Energies and what went in and out since the beginning, force x length, (N,) each.

    Attributes
    ----------
    kinetic : array
        Of the structure.
    elastic : array
        Of the structure without its joints.
    stored : array
        In the joints' springs.
    work : array
        Of the external forces.
    viscous : array
        Lost in the structure's damping.
    joints : array
        Lost in the joints: the work done on them less what their springs store.
    slip : array
        The same by the joints' own account of slip and rate, which takes their forces to be
        exact within a step instead of linear in time; it comes closer with the square of the
        step.
    """

    kinetic: Array
    elastic: Array
    stored: Array
    work: Array
    viscous: Array
    joints: Array
    slip: Array

    @property
    def imbalance(self) -> Array:
        """Work and initial energy that is neither stored nor lost, (N,)."""
        stored = self.kinetic + self.elastic + self.stored
        return self.work + stored[..., :1] - stored - self.viscous - self.joints


@dataclass(frozen=True, eq=False)
class Transient:
    """Result of :func:`iwanjax.simulate`.

    Attributes
    ----------
    time : (N,) array
        s, from 0.
    displacement, velocity, acceleration : (..., N, sensors) array or None
        At the sensors, by default every coordinate; a batch on leading axes.
    joint_force, joint_deflection : (..., N, joints) array or None
        Of each joint, opposing and along its row.
    energy : Energies or None
        Where it was asked for.
    balanced : (...) bool array
        Whether the joints were in balance at every step; where not, all from there on is NaN.
    labels : tuple of str
        Of the joints.
    method : {"exact", "newmark"}
        Of integration.
    """

    time: Array
    displacement: Array | None = field(repr=False)
    velocity: Array | None = field(repr=False)
    acceleration: Array | None = field(repr=False)
    joint_force: Array | None = field(repr=False)
    joint_deflection: Array | None = field(repr=False)
    energy: Energies | None = field(repr=False)
    balanced: Array
    labels: tuple[str, ...]
    method: Method


class _Options(NamedTuple):
    """What a kernel is compiled for."""

    method: Method
    keep: tuple[Quantity, ...]
    every: int
    substeps: int
    sliders: int | None


class _Point(NamedTuple):
    """State of the integration at a sample."""

    q: Array
    v: Array
    f: Array
    g: Array
    g_before: Array
    states: tuple[Any, ...]
    sums: Array


def simulate(
    structure: JointedStructure,
    force: ArrayLike,
    dt: float,
    *,
    inputs: ArrayLike | None = None,
    sensors: ArrayLike | None = None,
    displacement: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    method: Method = "exact",
    keep: Sequence[Quantity] = QUANTITIES,
    every: int = 1,
    substeps: int = 1,
    modes: int | None = None,
    sliders: int | None = SLIDERS,
) -> Transient:
    r"""Integrate :math:`M\ddot u + C\dot u + Ku + \sum_j b_jF_j(b_j^Tu) = f(t)` in time.

    The structure moves in its modes about the joints' reference stiffness; what the joints
    differ from that acts as pseudo-forces on it. At each step only these few are solved for,
    by a safeguarded Newton method. Between samples forces are linear in time: "exact" then
    takes the modes from one to the next without error, "newmark" is the average
    acceleration of the thesis (Sec. 2.3.1), which lowers every frequency by
    :math:`(\omega\Delta t)^2/12`.

    Differentiable, forward and reverse, with respect to joints, force, initial state and
    the structure's matrices; the steps are recomputed in reverse, so that memory grows with
    the root of their number. Joints with batched parameters and forces with a leading axis
    are simulated side by side.

    Parameters
    ----------
    structure : JointedStructure
        What to integrate; joints start virgin, at rest.
    force : (N, inputs) or (N,) or (batch, N, inputs) array_like
        At the samples, from t = 0 on.
    dt : float
        Time between samples, s.
    inputs : (inputs, n) or (n,) array_like, optional
        Rows along which the forces act; without it they act on each coordinate.
    sensors : (sensors, n) or (n,) array_like, optional
        Rows that are kept; without it every coordinate is.
    displacement, velocity : (n,) array_like, optional
        At t = 0. The joints have been brought there from zero at once, without turning.
    method : {"exact", "newmark"}
        Of integration.
    keep : sequence of str
        Any of "displacement", "velocity", "acceleration", "joint_force",
        "joint_deflection" and "energy".
    every : int
        Keep each such sample.
    substeps : int
        Steps from one sample to the next, with forces in between on a straight line.
    modes : int, optional
        Elastic modes to integrate, the others by their static flexibility; by default all.
    sliders : int or None
        Of an Iwan joint. None integrates four-parameter ones in closed form, on a stack of
        reversals: smooth in the parameters, but their energy is not known.

    Returns
    -------
    Transient

    Raises
    ------
    InputError
        For arrays of wrong shape or with NaN, steps that are not positive, and the energy of
        a structure whose modes are not all kept.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("simulate")
    n = structure.structure.size
    rows_in = jnp.eye(n) if inputs is None else _rows(inputs, "inputs", n)
    rows_out = jnp.eye(n) if sensors is None else _rows(sensors, "sensors", n)
    f = _force(force, rows_in.shape[0])
    _check_numbers(dt, every, substeps, method, keep, f.shape[-2])
    initial = [
        jnp.zeros(n) if given is None else _vector(given, name, n)
        for given, name in ((displacement, "displacement"), (velocity, "velocity"))
    ]
    if "energy" in keep and modes is not None:
        raise InputError("simulate: the energy needs all modes; leave modes= out")
    modal = modal_coordinates(structure, rows_in, rows_out, modes)
    step = jnp.asarray(dt / substeps, f.dtype)
    by = propagator(modal.omega2, modal.C, step, method)
    start = [modal.Phi.T @ (structure.structure.M @ given) for given in initial]
    elements = structure.elements
    batch = {jnp.shape(x) for x in jax.tree.leaves(elements)} - {()}
    sizes = {shape[0] for shape in batch} | ({f.shape[0]} if f.ndim == 3 else set())
    if any(len(shape) > 1 for shape in batch) or len(sizes) > 1:
        raise InputError(
            f"simulate: batches of different sizes: joints {sorted(batch)}, force {f.shape[:-2]}"
        )
    options = _Options(method, tuple(keep), every, substeps, sliders)
    axes = (
        jax.tree.map(lambda leaf: 0 if jnp.ndim(leaf) else None, elements),
        0 if f.ndim == 3 else None,
    )
    kept, balanced = _run(elements, f, modal, by, start, step, options, axes if sizes else None)
    energy = kept.pop("energy", None)
    return Transient(
        time=dt * every * jnp.arange(1 + (f.shape[-2] - 1) // every),
        **{name: kept.get(name) for name in (*QUANTITIES, "joint_deflection")},
        energy=None if energy is None else _accounts(energy),
        balanced=balanced,
        labels=structure.labels,
        method=method,
    )


@eqx.filter_jit
def _run(
    elements: tuple[AbstractJoint, ...],
    f: Array,
    modal: ModalCoordinates,
    by: Propagator,
    start: list[Array],
    dt: Array,
    options: _Options,
    axes: Any,
) -> tuple[dict[str, Array], Array]:
    """Integrate one case, or a batch of them along the given axes."""

    def one(elements: tuple[AbstractJoint, ...], f: Array) -> tuple[dict[str, Array], Array]:
        return _integrate(elements, f, modal, by, start, dt, options)

    if axes is None:
        return one(elements, f)
    return jax.vmap(one, in_axes=axes)(elements, f)


def _integrate(
    elements: tuple[AbstractJoint, ...],
    f: Array,
    modal: ModalCoordinates,
    by: Propagator,
    start: list[Array],
    dt: Array,
    options: _Options,
) -> tuple[dict[str, Array], Array]:
    """All samples that are kept, and whether the joints were in balance at each."""
    joints = Joints.of(tuple(each.discrete(options.sliders) for each in elements))
    P, W = modal.P, modal.W
    q_g, v_g = by.last(P.T)
    G, H = P @ q_g + modal.R_dg, P @ v_g
    with_energy = "energy" in options.keep

    def step(at: _Point, f: Array) -> _Point:
        p = W @ at.f + P.T @ at.g
        q, v = by.free(at.q, at.v, p, W @ f)
        end = StepEnd(joints, at.states, P @ q + modal.R_df @ f, P @ v, G, H, modal.stiffness, dt)
        g = balance(2.0 * at.g - at.g_before, end)
        reaction = end.react(g)
        q, v = q + q_g @ g, v + v_g @ g
        sums = at.sums
        if with_energy:
            after = _Point(q, v, f, g, at.g, reaction.state, sums)
            sums = sums + jnp.stack(
                [*_exchanged(modal, at, after, dt, options.method), jnp.sum(reaction.loss)]
            )
        return _Point(q, v, f, g, at.g, reaction.state, sums)

    def sample(at: _Point, f: Array) -> tuple[_Point, None]:
        if options.substeps == 1:
            return step(at, f), None
        parts = jnp.arange(1, options.substeps + 1) / options.substeps
        between = at.f + parts[:, None] * (f - at.f)
        return jax.lax.scan(lambda a, x: (step(a, x), None), at, between)[0], None

    def kept(at: _Point) -> dict[str, Array]:
        p = W @ at.f + P.T @ at.g
        d = P @ at.q + modal.R_dg @ at.g + modal.R_df @ at.f
        lost = modal.C * at.v if modal.C.ndim == 1 else modal.C @ at.v
        found = {
            "displacement": modal.Y @ at.q + modal.R_yg @ at.g + modal.R_yf @ at.f,
            "velocity": modal.Y @ at.v,
            "acceleration": modal.Y @ (p - lost - modal.omega2 * at.q),
            "joint_force": modal.stiffness * d - at.g,
            "joint_deflection": d,
            "energy": _energies(modal, joints, at, d) if with_energy else d,
        }
        # What nobody asked for is not even computed once this is compiled.
        return {name: found[name] for name in options.keep} | {"ok": jnp.all(jnp.isfinite(at.g))}

    def keep(at: _Point, f: Array) -> tuple[_Point, dict[str, Array]]:
        at = sample(at, f[0])[0] if options.every == 1 else jax.lax.scan(sample, at, f)[0]
        return at, kept(at)

    first = _first(modal, joints, f[0], start, dt)
    count = (f.shape[0] - 1) // options.every
    length = max(1, math.isqrt(count))
    blocks = -(-count // length)
    used = f[1 : 1 + count * options.every]
    padding = blocks * length * options.every - used.shape[0]
    used = jnp.concatenate([used, jnp.zeros((padding, f.shape[1]), f.dtype)])
    # In reverse each block is run again from its beginning: memory grows with the root.
    block = jax.checkpoint(lambda at, f: jax.lax.scan(keep, at, f), prevent_cse=False)
    _, rows = jax.lax.scan(block, first, used.reshape(blocks, length, options.every, f.shape[1]))
    initial = kept(first)
    whole = {
        name: jnp.concatenate(
            [initial[name][None], row.reshape(blocks * length, *row.shape[2:])[:count]]
        )
        for name, row in rows.items()
    }
    return whole, jnp.all(whole.pop("ok"))


def _first(
    modal: ModalCoordinates, joints: Joints, f: Array, start: list[Array], dt: Array
) -> _Point:
    """The state at t = 0: joints brought to their deflections at once, without turning."""
    q, v = start
    m = joints.count
    end = StepEnd(
        joints,
        joints.init(),
        modal.P @ q + modal.R_df @ f,
        modal.P @ v,
        modal.R_dg,
        jnp.zeros((m, m), q.dtype),
        modal.stiffness,
        _AT_ONCE * dt,
    )
    g = balance(jnp.zeros(m, q.dtype), end)
    return _Point(q, v, f, g, g, end.react(g).state, jnp.zeros(4, q.dtype))


def _exchanged(
    modal: ModalCoordinates, before: _Point, after: _Point, dt: Array, method: Method
) -> tuple[Array, Array, Array]:
    """Over a step: work of the external forces, loss by damping, work on the joints."""
    (q_0, v_0), (q, v) = (before.q, before.v), (after.q, after.v)
    p_0, p_1 = modal.W @ before.f, modal.W @ after.f
    g_0, g_1 = modal.P.T @ before.g, modal.P.T @ after.g
    d_0, d_1 = modal.P @ q_0, modal.P @ q
    elastic = 0.5 * modal.stiffness @ (d_1**2 - d_0**2)
    C = modal.C if modal.C.ndim == 2 else jnp.diag(modal.C)
    moved = q - q_0
    if method == "newmark":
        # With these sums the average acceleration conserves energy exactly.
        yielded = 0.5 * (g_0 + g_1) @ moved
        return 0.5 * (p_0 + p_1) @ moved, moved @ C @ moved / dt, elastic - yielded
    a_0 = p_0 + g_0 - C @ v_0 - modal.omega2 * q_0
    a_1 = p_1 + g_1 - C @ v - modal.omega2 * q
    # Forces are linear over the step: by parts, with q along the cubic between both ends.
    mean = 0.5 * (q_0 + q) + dt / 12.0 * (v_0 - v)
    ends = v_0 @ C @ v_0 + v @ C @ v
    slopes = 2.0 * (v_0 @ C @ a_0 - v @ C @ a_1)
    return (
        p_1 @ q - p_0 @ q_0 - (p_1 - p_0) @ mean,
        dt * (0.5 * ends + dt / 12.0 * slopes),
        elastic - (g_1 @ q - g_0 @ q_0 - (g_1 - g_0) @ mean),
    )


def _energies(modal: ModalCoordinates, joints: Joints, at: _Point, d: Array) -> Array:
    """Kinetic, elastic and stored energy at a sample, and the sums up to it."""
    elastic = 0.5 * (modal.omega2 @ at.q**2 - modal.stiffness @ d**2)
    stored = jnp.sum(joints.energy(d, at.states))
    return jnp.concatenate([jnp.stack([0.5 * at.v @ at.v, elastic, stored]), at.sums])


def _accounts(rows: Array) -> Energies:
    """Rows of :func:`_energies` by name."""
    kinetic, elastic, stored, work, viscous, done, slip = jnp.moveaxis(rows, -1, 0)
    return Energies(
        kinetic, elastic, stored, work, viscous, done - (stored - stored[..., :1]), slip
    )


def _rows(rows: ArrayLike, name: str, n: int) -> Array:
    checked = jnp.atleast_2d(as_real(rows, name))
    if checked.ndim != 2 or checked.shape[1] != n:
        raise InputError(f"{name} has shape {checked.shape}; expected (rows, {n}) like M")
    return checked


def _vector(values: ArrayLike, name: str, n: int) -> Array:
    checked = as_real(values, name)
    if checked.shape != (n,):
        raise InputError(f"{name} has shape {checked.shape}; expected ({n},) like M")
    return checked


def _force(force: ArrayLike, inputs: int) -> Array:
    f = as_real(force, "force")
    if f.ndim == 1 and inputs == 1:
        f = f[:, None]
    if f.ndim not in (2, 3) or f.shape[-1] != inputs:
        raise InputError(
            f"force has shape {f.shape}; expected (N, {inputs}), a column for each "
            "input or coordinate, or a batch of such"
        )
    if f.shape[-2] < 2:
        raise InputError(f"force has {f.shape[-2]} sample(s); expected at least 2")
    return f


def _check_numbers(
    dt: float, every: int, substeps: int, method: str, keep: Sequence[str], samples: int
) -> None:
    step = as_real(dt, "dt")
    if is_traced(step) or step.ndim or float(step) <= 0:
        raise InputError(f"simulate: dt = {dt}; expected a positive number")
    for name, value in (("every", every), ("substeps", substeps)):
        if not isinstance(value, int | np.integer) or value < 1:
            raise InputError(f"simulate: {name} = {value!r}; expected a whole number, at least 1")
    if every >= samples:
        raise InputError(f"simulate: every = {every}, but there are {samples} samples")
    if method not in get_args(Method):
        raise InputError(f"simulate: method = {method!r}; expected 'exact' or 'newmark'")
    unknown = [name for name in keep if name not in get_args(Quantity)]
    if unknown or isinstance(keep, str):
        raise InputError(
            f"simulate: keep = {keep!r}; expected a list of {', '.join(get_args(Quantity))}"
        )
