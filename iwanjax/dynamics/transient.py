"""The response of a jointed structure in time."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.compiler import warn_of_slow_loops
from iwanjax.dynamics.coordinates import force_of, modal_coordinates, rows_of, vector_of
from iwanjax.dynamics.energy import Energies, accounts
from iwanjax.dynamics.error_estimate import group_size, relative_error
from iwanjax.dynamics.integration import Options, Quantity, Run, run
from iwanjax.dynamics.propagator import Method
from iwanjax.dynamics.stepping import has_fast_modes, stepper
from iwanjax.errors import AccuracyError, InputError
from iwanjax.joints.sliders import SLIDERS
from iwanjax.results import AbstractResult
from iwanjax.structures import JointedStructure
from iwanjax.types import ArrayLike, as_real, is_traced, require_double_precision

QUANTITIES: tuple[Quantity, ...] = ("displacement", "velocity", "acceleration", "joint_force")
"""What it keeps unless told otherwise."""

ACCURACY = 0.01
"""Error that a simulation may have unless told otherwise: rms, relative to the motion's."""

BALANCE = 0.01
"""Energy that may be missing, over the largest that went in."""

# What an estimated error may be short of the true one. Over 304 runs from a fiftieth of the fastest
# joint mode's period to six of them the true one was up to 1.72 times as large (19 of 20: 1.25);
# none of those that this margin lets pass was above 0.8 % where 1 % is allowed.
_MARGIN = 1.5
# Relaxation times x in a step up to which the estimate knows of a force that relaxes. With
# e = exp(-x) the straight lines of all steps enclose (1 + e)/(1 - e)/2 - 1/x too much; the second
# differences say (1 - e)(2 - e)/12: 5 % less here, and less by the margin from x = 3.3 on.
_RESOLVED = 1.5
# Steps that a simulation takes by itself for one that it was asked for.
_MOST_REFINED = 64


@dataclass(frozen=True, eq=False)
class SimulatedResponse(AbstractResult):
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
    error : (...) array
        Estimated distance from the converged response: rms over the record of all elastic modes'
        displacements, or velocities where it is larger, over that of the response itself. NaN by
        the method "newmark", whose error is (omega dt)^2/12 of each frequency.
    imbalance : (...) array
        Largest amount of energy that is not accounted for, over the largest that went in. NaN
        where a joint does not know its energy (``sliders=None``), and both where nobody asked.
    substeps : int
        Steps from one sample to the next, more than asked for where the response was refined.
    labels : tuple of str
        Of the joints.
    method : {"exact", "newmark"}
        Of integration.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> push = np.zeros(200)
    >>> push[:20] = 1.0  # N, on the third mass for 1 s
    >>> response = ij.simulate(ij.three_mass(), push, 0.05, inputs=[0, 0, 1])
    >>> response.time.shape, response.joint_force.shape  # samples, joints
    ((200,), (200, 1))
    >>> float(response.error) < 0.01, float(response.imbalance) < 0.01
    (True, True)
    """

    time: Array
    displacement: Array | None = field(repr=False)
    velocity: Array | None = field(repr=False)
    acceleration: Array | None = field(repr=False)
    joint_force: Array | None = field(repr=False)
    joint_deflection: Array | None = field(repr=False)
    energy: Energies | None = field(repr=False)
    balanced: Array
    error: Array
    imbalance: Array
    substeps: int
    labels: tuple[str, ...]
    method: Method

    # Lengths, masses and forces are in the units of the matrices, whatever these are.
    _shown = (
        "time",
        "displacement",
        "velocity",
        "acceleration",
        "joint_force",
        "joint_deflection",
        "balanced",
        "error",
        "imbalance",
        "substeps",
        "labels",
        "method",
    )


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
    accuracy: float | None = ACCURACY,
) -> SimulatedResponse:
    r"""Integrate :math:`M\ddot u + C\dot u + Ku + \sum_j b_jF_j(b_j^Tu) = f(t)` in time.

    The structure moves in its modes about the joints' reference stiffness; what the joints
    differ from that acts as pseudo-forces on it. At each step only these few are solved for,
    by a safeguarded Newton method. Between samples forces are linear in time: "exact" then
    takes the modes from one to the next without error, "newmark" is the average
    acceleration of the thesis (Sec. 2.3.1), which lowers every frequency by
    :math:`(\omega\Delta t)^2/12`. Both are stable whatever the step
    (``iwanjax/dynamics/stepping.py``).

    A run estimates its own error and accounts for its energy. Where either is more than
    allowed the steps are shortened, up to 64 times, until it is not; where that does not
    help, an error names the step to take. Where a force relaxes within a step (a stiff Maxwell
    element, an overdamped dashpot) the error is what a run with shorter steps does otherwise; and
    modes that joints move have to be resolved if they ring.
    Under a JAX transformation nothing can be shortened, compared or raised: a response that is
    not good enough, or not known to be, is NaN.

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
    accuracy : float or None
        Error allowed, rms relative to the response's (1 = 100 %). None takes the response as
        it comes, unjudged.

    Returns
    -------
    SimulatedResponse

    Raises
    ------
    InputError
        For arrays of wrong shape or with NaN, steps that are not positive, and the energy of
        a structure whose modes are not all kept.
    AccuracyError
        Where no step that was tried brings the error below ``accuracy`` and what is missing of
        the energy below 1 % of what went in.
    PrecisionError
        When JAX computes in float32.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> push = np.zeros(200)
    >>> push[:20] = 1.0  # N, on the third mass for 1 s
    >>> response = ij.simulate(ij.three_mass(), push, 0.05, inputs=[0, 0, 1])
    >>> response.displacement.shape, bool(response.balanced)
    ((200, 3), True)
    """
    require_double_precision("simulate")
    if not isinstance(structure, JointedStructure):
        raise InputError(
            f"simulate: structure is a {type(structure).__name__}; expected a JointedStructure; "
            "a linear one is JointedStructure(linear, {})"
        )
    warn_of_slow_loops()
    n = structure.structure.size
    rows_in = jnp.eye(n) if inputs is None else rows_of(inputs, "inputs", n)
    rows_out = jnp.eye(n) if sensors is None else rows_of(sensors, "sensors", n)
    f = force_of(force, rows_in.shape[0])
    _check_numbers(dt, every, substeps, method, keep, f.shape[-2])
    if accuracy is not None and not 0.0 < accuracy < math.inf:
        raise InputError(f"simulate: accuracy = {accuracy!r}; expected a positive number or None")
    initial = [
        jnp.zeros(n) if given is None else vector_of(given, name, n)
        for given, name in ((displacement, "displacement"), (velocity, "velocity"))
    ]
    if "energy" in keep and modes is not None:
        raise InputError("simulate: the energy needs all modes; leave modes= out")
    modal = modal_coordinates(structure, rows_in, rows_out, modes)
    start = [modal.Phi.T @ (structure.structure.M @ given) for given in initial]
    elements = structure.elements
    by_rate = any(element.discrete(sliders).rate_dependent for element in elements)
    batch = {jnp.shape(x) for x in jax.tree.leaves(elements)} - {()}
    sizes = {shape[0] for shape in batch} | ({f.shape[0]} if f.ndim == 3 else set())
    if any(len(shape) > 1 for shape in batch) or len(sizes) > 1:
        raise InputError(
            f"simulate: batches of different sizes: joints {sorted(batch)}, force {f.shape[:-2]}"
        )
    axes = (
        jax.tree.map(lambda leaf: 0 if jnp.ndim(leaf) else None, elements),
        0 if f.ndim == 3 else None,
    )

    traced = is_traced(elements, f, modal, start)

    def attempt(substeps: int) -> Run:
        step = dt / substeps
        group = group_size(modal, step, substeps * (f.shape[-2] - 1))
        options = Options(
            keep=tuple(keep),
            every=every,
            substeps=substeps if substeps == 1 or traced else None,
            sliders=sliders,
            group=group,
            judge=accuracy is not None,
            compare=by_rate and accuracy is not None and method == "exact",
        )
        by = stepper(modal, jnp.asarray(step, f.dtype), method, has_fast_modes(modal, step, method))
        grouped, long = None, group * step
        if options.judge and method == "exact":
            split = has_fast_modes(modal, long, method)
            grouped = stepper(modal, jnp.asarray(long, f.dtype), method, split)
        steps = jnp.asarray(substeps)
        return run(elements, f, by, grouped, start, steps, options, axes if sizes else None)

    found, substeps = _refined(attempt, substeps, float(dt), method, accuracy)
    kept = dict(found.kept)
    energy = kept.pop("energy", None)
    return SimulatedResponse(
        time=dt * every * jnp.arange(1 + (f.shape[-2] - 1) // every),
        **{name: kept.get(name) for name in (*QUANTITIES, "joint_deflection")},
        energy=None if energy is None else accounts(energy),
        balanced=found.balanced,
        error=found.error,
        imbalance=found.imbalance,
        substeps=substeps,
        labels=structure.labels,
        method=method,
    )


def _refined(
    attempt: Callable[[int], Run],
    substeps: int,
    dt: float,
    method: Method,
    accuracy: float | None,
) -> tuple[Run, int]:
    """The first run that is good enough, and the steps it took from one sample to the next."""
    asked, factor, coarser = substeps, 2, None
    while True:
        found = attempt(substeps)
        if accuracy is None:
            return found, substeps
        if found.modes is not None:
            hasty = found.haste > _RESOLVED
            if coarser is None and not is_traced(hasty) and bool(jnp.any(hasty)):
                coarser, substeps = found, factor * substeps
                continue
            off = _off(found, coarser, factor)
            found = found._replace(error=jnp.where(hasty, off, found.error))
        # Fast modes may be wrong by twice what they are, in opposite phase: if they are that much
        # of the motion, steps have to resolve them.
        opposite = 2.0 * found.fast
        unseen = opposite > accuracy
        found = found._replace(
            error=jnp.where(unseen, jnp.maximum(found.error, opposite), found.error)
        )
        excess = _excess(found, method, accuracy)
        if is_traced(excess):
            good = excess <= 1.0
            kept = {name: _only(good, rows) for name, rows in found.kept.items()}
            return found._replace(kept=kept), substeps
        worst = float(jnp.max(excess))
        if worst <= 1.0:
            return found, substeps
        # Both fall with the square of the step, as soon as it resolves what happens.
        factor = min(max(2, math.ceil(math.sqrt(worst))), 8) if worst < 1e6 else 8
        if substeps * factor > _MOST_REFINED * asked:
            raise AccuracyError(_too_long(found, excess, dt, substeps, factor, accuracy))
        coarser, substeps = found, factor * substeps


def _off(found: Run, coarser: Run | None, factor: int) -> Array:
    """Error of a run by one with steps ``factor`` times as long, whose errors fall with the step.

    They fall faster as soon as the steps resolve what happens. Endless without such a run.
    """
    if coarser is None or found.modes is None or coarser.modes is None:
        return jnp.full_like(found.error, jnp.inf)
    off, size = (
        jnp.sum(each**2, axis=(-3, -1)) for each in (found.modes - coarser.modes, found.modes)
    )
    return relative_error(jnp.stack([off, size], -1).reshape(*off.shape[:-1], -1)) / (factor - 1)


def _excess(found: Run, method: Method, accuracy: float) -> Array:
    """Error and imbalance over what is allowed, the larger of both; a run may not exceed 1."""
    missing = jnp.where(jnp.isnan(found.imbalance), 0.0, found.imbalance)
    worst = missing / BALANCE
    if method == "exact":
        worst = jnp.maximum(worst, _MARGIN * found.error / accuracy)
    return jnp.where(found.balanced & ~jnp.isnan(worst), worst, jnp.inf)


def _only(good: Array, rows: Array) -> Array:
    """Rows of the good cases; NaN for the others."""
    return jnp.where(good.reshape(good.shape + (1,) * (rows.ndim - good.ndim)), rows, jnp.nan)


def _too_long(
    found: Run, excess: Array, dt: float, substeps: int, factor: int, accuracy: float
) -> str:
    """What is wrong with the worst case, and what to do about it."""
    at = jnp.unravel_index(jnp.argmax(excess), excess.shape)
    case = f" in case {int(at[0])}" if excess.ndim else ""
    step = dt / substeps
    if not found.balanced[at]:
        what = f"joints find no balance{case} with steps of {step:.3g} s"
    else:
        what = (
            f"with steps of {step:.3g} s the response{case} is {float(found.error[at]):.2%} (rms) "
            f"off what shorter ones would give, and {float(found.imbalance[at]):.2%} of the "
            f"energy is missing; {accuracy:.2%} and {BALANCE:.0%} are allowed"
        )
    return (
        f"simulate: {what}; try steps of {step / factor:.2g} s, or take the response as it is "
        "with accuracy=None"
    )


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
