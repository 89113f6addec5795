"""A simulation in time: responses, joint forces against deflection, energies."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iwanjax.dynamics import Energies, SimulatedResponse
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.joints.hysteresis import last_amplitude, turning_points
from iwanjax.plotting.style import (
    DOUBLE_COLUMN,
    PALETTE,
    SINGLE_COLUMN,
    paper_style,
    set_up,
    single_panel,
    with_unit,
)
from iwanjax.types import ArrayLike, as_real

if TYPE_CHECKING:
    from iwanjax.studies.simulations import DrivenJoint

_RESPONSES = ("displacement", "velocity", "acceleration")
_RATES = {"displacement": "", "velocity": "/s", "acceleration": "/s²"}
_LIGHT = "0.7"
_MOST_SENSORS, _MOST_JOINTS = 4, 3
# Of a line over time: columns that a figure of this width has pixels for.
_COLUMNS = 1200
# Of a path that goes round more often: turning points of a stretch that is drawn as a line, its
# points, and points that show where the rest has been.
_TURNS, _STRETCH, _POINTS = 6, 3000, 12_000


@paper_style()
def plot_transient(
    transient: SimulatedResponse,
    sensors: Sequence[int] | None = None,
    *,
    labels: Sequence[str] | None = None,
    quantity: str | None = None,
    length_unit: str = "",
    force_unit: str = "",
) -> Figure:
    """Response over time, energies where they were kept, and joint forces against deflection.

    Of histories with more samples than the figure has pixels each column of pixels shows its
    lowest and its highest, so that no peak is lost. Of long hysteresis the stretches about the
    largest deflection and at the end are lines; points show where the rest has been.

    Parameters
    ----------
    transient : SimulatedResponse
        Result of :func:`iwanjax.simulate`, for one case.
    sensors : sequence of int, optional
        Columns of the response; by default the four that move most.
    labels : sequence of str, optional
        What all columns are called.
    quantity : {"displacement", "velocity", "acceleration"}, optional
        By default the first of them that was kept.
    length_unit, force_unit : str
        For the labels, for instance ``"mm"`` and ``"N"``.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For something that is not a SimulatedResponse, a batch of cases, a quantity that was not
        kept, and sensors that there are not.
    """
    if not isinstance(transient, SimulatedResponse):
        raise InputError(
            f"plot_transient expects a SimulatedResponse, got {type(transient).__name__}"
        )
    if np.ndim(transient.balanced):
        raise InputError(
            f"plot_transient draws one case; this is a batch of {np.size(transient.balanced)}"
        )
    time = np.asarray(transient.time)
    kind, responses = _responses(transient, quantity, sensors, labels)
    loops = _loops(transient)
    rows = len(responses) + (transient.energy is not None)
    if not rows and not loops:
        raise InputError("plot_transient: nothing was kept that it could draw")
    figure = plt.figure(
        figsize=(
            DOUBLE_COLUMN if rows and loops else SINGLE_COLUMN,
            max(2.6, 1.15 * rows + 0.5, 1.9 * len(loops) + 0.3),
        ),
        layout="constrained",
    )
    columns = bool(rows) + bool(loops)
    grid = figure.add_gridspec(1, columns, width_ratios=(1.5, 1.0)[:columns])
    if rows:
        left = grid[0, 0].subgridspec(rows, 1).subplots(sharex=True, squeeze=False)[:, 0]
        set_up(*left)
        unit = f"{length_unit}{_RATES[kind]}" if length_unit else ""
        for ax, (label, response) in zip(left, responses.items(), strict=False):
            _draw_history(ax, time, response, PALETTE[0])
            ax.set_ylabel(with_unit(f"{kind.capitalize()}\n{label}", unit))
        if transient.energy is not None:
            _draw_energies(left[-1], time, transient.energy)
            unit = f"{force_unit} {length_unit}" if force_unit and length_unit else ""
            left[-1].set_ylabel(with_unit("Energy", unit))
        left[-1].set_xlabel("Time $t$ (s)")
        left[-1].set_xlim(time[0], time[-1])
        figure.align_ylabels(list(left))
    if loops:
        right = grid[0, -1].subgridspec(len(loops), 1).subplots(squeeze=False)[:, 0]
        set_up(*right)
        for ax, (label, path) in zip(right, loops.items(), strict=True):
            _draw_path(ax, *path)
            ax.set_title(label, loc="left")
            _label_path(ax, length_unit, force_unit)
        figure.align_ylabels(list(right))
    return figure


@paper_style()
def plot_hysteresis(
    d: ArrayLike,
    force: ArrayLike,
    joint: AbstractJoint | None = None,
    *,
    amplitude: float | None = None,
    length_unit: str = "",
    force_unit: str = "",
) -> Figure:
    """Force of an element along a history of deflections.

    Parameters
    ----------
    d, force : (N,) array_like
        Deflection, length, and force.
    joint : joint, optional
        The element, for its virgin curve and its steady loop beside the path.
    amplitude : float, optional
        Of the steady loop, length; the last one by default, no loop at 0.
    length_unit, force_unit : str
        For the labels.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For histories that are not finite or of one length.
    """
    x, y = (np.asarray(as_real(each, name)) for each, name in ((d, "d"), (force, "force")))
    if x.ndim != 1 or x.shape != y.shape or not x.size:
        raise InputError(
            f"plot_hysteresis: d has shape {x.shape}, force {y.shape}; expected (N,) both"
        )
    figure, ax = single_panel(3.0)
    ax.locator_params(axis="x", nbins=6)
    _draw_path(ax, x, y, label="path")
    if joint is not None:
        tip = last_amplitude(x) if amplitude is None else amplitude
        reach = np.linspace(np.min(x), np.max(x), 801)
        virgin, loop = _closed_forms(joint, reach, tip)
        look = {"color": "black", "linestyle": "--", "linewidth": 0.8}
        ax.plot(reach, virgin, **look, label="virgin curve")
        if tip:
            told = f"{tip:.3g} {length_unit}".strip()
            ax.plot(*loop, color=PALETTE[1], linewidth=0.9, label=f"steady loop, $d_0 =$ {told}")
        figure.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    _label_path(ax, length_unit, force_unit)
    return figure


@eqx.filter_jit
def _closed_forms(
    joint: AbstractJoint, d: np.ndarray, amplitude: float
) -> tuple[Array, tuple[Array, Array]]:
    """Virgin curve and steady loop."""
    return joint.backbone(d), joint.loop(amplitude)


def _responses(
    transient: SimulatedResponse,
    quantity: str | None,
    sensors: Sequence[int] | None,
    labels: Sequence[str] | None,
) -> tuple[str, dict[str, np.ndarray]]:
    """What is drawn over time, and of what: the histories by label."""
    kept = [kind for kind in _RESPONSES if getattr(transient, kind) is not None]
    if quantity is not None and quantity not in kept:
        raise InputError(
            f"plot_transient: quantity = {quantity!r}; expected one of {', '.join(kept) or 'none'}"
        )
    if not kept:
        return "displacement", {}
    kind = quantity or kept[0]
    values = np.asarray(getattr(transient, kind))
    count = values.shape[1]
    names = [f"sensor {i}" for i in range(count)] if labels is None else list(labels)
    if len(names) != count:
        raise InputError(f"plot_transient: {len(names)} labels; expected {count}, one a sensor")
    for i in () if sensors is None else sensors:
        if not 0 <= i < count:
            raise InputError(f"plot_transient: sensor {i}; expected 0 to {count - 1}")
    chosen = _largest(values, _MOST_SENSORS) if sensors is None else sensors
    return kind, {names[i]: values[:, i] for i in chosen}


def _largest(values: np.ndarray, most: int) -> list[int]:
    """The columns that reach furthest; NaN, where joints found no balance, does not count."""
    reach = np.max(np.nan_to_num(np.abs(values)), axis=0)
    return sorted(np.argsort(-reach, kind="stable")[:most].tolist())


def _loops(transient: SimulatedResponse) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Deflection and force of the joints that deflect most."""
    if transient.joint_force is None or transient.joint_deflection is None:
        return {}
    d, force = np.asarray(transient.joint_deflection), np.asarray(transient.joint_force)
    return {transient.labels[j]: (d[:, j], force[:, j]) for j in _largest(d, _MOST_JOINTS)}


def _draw_history(
    ax: Axes, time: np.ndarray, value: np.ndarray, color: str, label: str = ""
) -> None:
    ax.plot(*_thinned(time, value), color=color, linewidth=0.6, label=label)


def _thinned(time: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest sample of each column of pixels, in their order."""
    if value.size <= 4 * _COLUMNS:
        return time, value
    length = -(-value.size // _COLUMNS)
    # The last value fills the last column up; NaN stands for nothing to draw.
    padded = np.append(value, np.full(-value.size % length, value[-1])).reshape(-1, length)
    found = np.isfinite(padded)
    low = np.argmin(np.where(found, padded, np.inf), axis=1)
    high = np.argmax(np.where(found, padded, -np.inf), axis=1)
    starts = length * np.arange(len(padded))[:, None]
    at = starts + np.sort(np.stack([low, high], axis=1), axis=1)
    at = np.minimum(at.ravel(), value.size - 1)
    return time[at], value[at]


def _draw_path(ax: Axes, d: np.ndarray, force: np.ndarray, label: str = "path") -> None:
    """A path that may go round many times."""
    if d.size <= 4 * _STRETCH:
        ax.plot(d, force, color=PALETTE[0], linewidth=0.7, label=label)
        return
    # At random, as any regular choice makes patterns with the period.
    at = np.random.default_rng(0).integers(d.size, size=_POINTS)
    ax.plot(d[at], force[at], ".", color=_LIGHT, markersize=0.8, rasterized=True)
    turns = np.concatenate([[0], turning_points(d), [d.size - 1]])
    largest = int(np.searchsorted(turns, np.argmax(np.nan_to_num(np.abs(d)))))
    stretches = (("largest", largest + _TURNS // 2), ("last", turns.size - 1))
    for color, (told, end) in zip(PALETTE, stretches, strict=False):
        last = min(end, turns.size - 1)
        first = turns[max(0, last - _TURNS)]
        count = min(_STRETCH, turns[last] - first + 1)
        at = np.linspace(first, turns[last], count).astype(int)
        ax.plot(d[at], force[at], color=color, linewidth=0.7, label=told)
    _legend_above(ax, 2)


def _label_path(ax: Axes, length_unit: str, force_unit: str) -> None:
    ax.set_xlabel(with_unit("Deflection $d$", length_unit))
    ax.set_ylabel(with_unit("Force $F$", force_unit))


def _legend_above(ax: Axes, columns: int) -> None:
    """To the right, as the power of ten of an axis stands at its left end."""
    ax.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.0,
        columnspacing=0.8,
    )


def _draw_energies(ax: Axes, time: np.ndarray, energy: Energies) -> None:
    """What is in motion and in springs, what was lost, and what came in."""
    held = np.asarray(energy.kinetic + energy.elastic + energy.stored)
    rows = (
        ("work", energy.work, "black"),
        ("held", held, PALETTE[0]),
        ("lost in joints", energy.joints, PALETTE[1]),
        ("in damping", energy.viscous, PALETTE[2]),
    )
    for label, value, color in rows:
        if np.any(value):
            _draw_history(ax, time, np.asarray(value), color, label)
    _legend_above(ax, len(rows))


def plot_driven(driven: "DrivenJoint", **options: Any) -> Figure:
    """A joint's loops; options of :func:`plot_hysteresis`."""
    # Virgin curve and steady loop are quasi-static.
    joint = None if driven.joint.discrete().rate_dependent else driven.joint
    return plot_hysteresis(driven.d, driven.force, joint, amplitude=driven.amplitude, **options)
