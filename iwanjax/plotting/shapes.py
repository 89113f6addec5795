"""Mode shapes of a finite element model, how alike shapes are, and how far joints move in them."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from iwanjax.errors import InputError
from iwanjax.plotting.style import DOUBLE_COLUMN, PALETTE, SINGLE_COLUMN, paper_style
from iwanjax.structures.checks import finite_array
from iwanjax.structures.reduced_model import ReducedModel, SurfaceShape
from iwanjax.types import ArrayLike

# Directions of view: right and up on paper, and out of it, in the model's coordinates.
_TURN, _TILT = np.radians(12.0), np.radians(25.0)
# Largest displacement on paper as share of the structure's length.
_SIZE = 0.06
# Strokes below this share of the largest are all drawn alike.
_LEAST = 1e-4
# Values below this lie on a dark ground.
_DARK = 0.6
_GHOST, _BODY = "0.85", "#BBD5E8"


@paper_style()
def plot_shapes(
    model: ReducedModel,
    shapes: ArrayLike,
    *,
    frequency: ArrayLike | None = None,
    names: Sequence[str] = (),
) -> Figure:
    """Mode shapes in space, one below the other, over the structure at rest.

    The structure at rest is grey; contact patches have a colour for each joint. Each shape is
    drawn at a size that can be seen; sizes of different shapes cannot be compared.

    Parameters
    ----------
    model : ReducedModel
        With a surface to draw.
    shapes : (n, k) array_like
        Columns of the reduced coordinates.
    frequency : (k,) array_like, optional
        Hz, for the titles.
    names : sequence of str, optional
        Of the modes, for the titles.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For a model without surface, and shapes of another size.
    """
    if model.shape is None:
        raise InputError("plot_shapes: this model has no surface to draw")
    columns = finite_array(shapes, "shapes")
    columns = columns[:, None] if columns.ndim == 1 else columns
    if columns.shape[0] != model.M.shape[0]:
        raise InputError(
            f"plot_shapes: shapes have shape {columns.shape}; expected ({model.M.shape[0]}, k)"
        )
    f = None if frequency is None else np.atleast_1d(finite_array(frequency, "frequency"))
    k = columns.shape[1]
    figure, panels = plt.subplots(
        k, 1, squeeze=False, figsize=(DOUBLE_COLUMN, 0.3 + 1.4 * k), layout="constrained"
    )
    flat, _ = _projected(model.shape.points)
    for i, ax in enumerate(panels[:, 0]):
        _draw(ax, model.shape, columns[:, i])
        # All at one scale, and their titles above one another.
        ax.set_xlim(*_padded(flat[:, 0]))
        words = [names[i]] if i < len(names) else []
        words += [] if f is None else [f"{f[i]:.4g} Hz"]
        ax.set_title(", ".join(words), loc="left")
    joints = sorted({int(p) for p in model.shape.patch if p >= 0})
    patches = [Patch(color=_colour(j), label=f"J{j + 1}") for j in joints]
    if patches:
        figure.legend(handles=patches, loc="outside lower center", ncols=len(patches))
    return figure


def _padded(x: np.ndarray) -> tuple[float, float]:
    """Ends of an axis with room for what moves beyond."""
    margin = _SIZE * np.ptp(x)
    return float(x.min() - margin), float(x.max() + margin)


def _draw(ax: Axes, surface: SurfaceShape, shape: np.ndarray) -> None:
    """One shape over the structure at rest."""
    moved = surface.recovery @ shape
    length = np.max(np.ptp(surface.points, axis=0))
    largest = np.max(np.linalg.norm(moved, axis=1))
    scale = _SIZE * length / largest if largest > 0 else 0.0
    for points, ghost in ((surface.points, True), (surface.points + scale * moved, False)):
        flat, depth = _projected(points)
        # Patches lie between the bodies: they shine through, on top of all that hides them.
        order = np.lexsort((np.mean(depth[surface.quads], axis=1), surface.patch >= 0))
        quads, patch = surface.quads[order], surface.patch[order]
        colours = [_GHOST if ghost else _BODY if p < 0 else _colour(p) for p in patch]
        ax.add_collection(
            PolyCollection(
                list(flat[quads]),
                facecolors="none" if ghost else colours,
                edgecolors=_GHOST if ghost else "0.35",
                linewidths=0.2,
                zorder=1 if ghost else 2,
            )
        )
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.set_axis_off()


def _projected(points: Float[np.ndarray, "p 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Points on paper (p, 2), and how far they stand out of it (p,)."""
    x, y, z = points.T
    right = x * np.cos(_TURN) + z * np.sin(_TURN)
    away = -x * np.sin(_TURN) + z * np.cos(_TURN)
    up = y * np.cos(_TILT) - away * np.sin(_TILT)
    return np.stack([right, up], axis=1), y * np.sin(_TILT) + away * np.cos(_TILT)


def _colour(joint: int) -> str:
    # The first is the blue of the bodies.
    return PALETTE[1 + joint % (len(PALETTE) - 1)]


@paper_style()
def plot_assurance(
    assurance: ArrayLike,
    rows: Sequence[str] = (),
    columns: Sequence[str] = (),
    *,
    of: tuple[str, str] = ("", ""),
) -> Figure:
    """A matrix of modal assurances, each with its number.

    Parameters
    ----------
    assurance : (k, m) array_like
        From :func:`iwanjax.modal_assurance`.
    rows, columns : sequence of str, optional
        Names of the modes; numbers where there are none.
    of : (str, str)
        What rows and columns are modes of, for instance the test and the model.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For what is no matrix, or values outside 0 to 1.
    """
    values = finite_array(assurance, "assurance")
    if values.ndim != 2 or np.any(values < 0) or np.any(values > 1 + 1e-9):
        raise InputError(
            f"plot_assurance: got shape {values.shape} between {values.min():.3g} and "
            f"{values.max():.3g}; expected a matrix of values from 0 to 1"
        )
    k, m = values.shape
    figure, ax = plt.subplots(figsize=(1.2 + 0.42 * m, 0.8 + 0.42 * k), layout="constrained")
    image = ax.imshow(values, cmap="cividis", vmin=0.0, vmax=1.0)
    _grid(ax, rows or _numbers(k), columns or _numbers(m))
    ax.set_ylabel(of[0])
    ax.set_xlabel(of[1])
    for (i, j), value in np.ndenumerate(values):
        ax.text(
            j,
            i,
            f"{value:.2f}",
            ha="center",
            va="center",
            color="w" if value < 0.6 else "k",
            size=6,
        )
    figure.colorbar(image, ax=ax, label="MAC", shrink=0.8)
    return figure


@paper_style()
def plot_strokes(
    model: ReducedModel,
    shapes: ArrayLike,
    *,
    rows: Sequence[str] = (),
    names: Sequence[str] = (),
) -> Figure:
    """How far each joint moves in each mode, per unit of the largest stroke.

    Parameters
    ----------
    model : ReducedModel
        With named rows across its joints.
    shapes : (n, k) array_like
        Mass-normalised, columns of the reduced coordinates.
    rows : sequence of str, optional
        Those to show; by default all translations.
    names : sequence of str, optional
        Of the modes.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For rows that the model does not have, and shapes of another size.
    """
    chosen = list(rows) or [name for name in model.rows if name[-2:] in (".x", ".y", ".z")]
    for name in chosen:
        if name not in model.rows:
            raise InputError(f"plot_strokes: no row {name!r}; there are {', '.join(model.rows)}")
    columns = finite_array(shapes, "shapes")
    if columns.ndim != 2 or columns.shape[0] != model.M.shape[0]:
        raise InputError(
            f"plot_strokes: shapes have shape {columns.shape}; expected ({model.M.shape[0]}, k)"
        )
    strokes = np.abs(np.stack([model.rows[name] for name in chosen]) @ columns)
    share = np.maximum(strokes / np.max(strokes), _LEAST)
    k = columns.shape[1]
    figure, ax = plt.subplots(
        figsize=(SINGLE_COLUMN, 0.8 + 0.17 * len(chosen)), layout="constrained"
    )
    image = ax.imshow(share, cmap="cividis", norm=LogNorm(_LEAST, 1.0), aspect="auto")
    _grid(ax, chosen, names or _numbers(k))
    ax.set_xlabel("Mode")
    figure.colorbar(image, ax=ax, label="Stroke (share of the largest)")
    return figure


def _numbers(count: int) -> list[str]:
    return [str(i + 1) for i in range(count)]


def _grid(ax: Axes, rows: Sequence[str], columns: Sequence[str]) -> None:
    ax.set_xticks(range(len(columns)), columns, rotation=45 if max(map(len, columns)) > 3 else 0)
    ax.set_yticks(range(len(rows)), rows)
    ax.tick_params(length=0.0, labelsize=7.0)
