"""What a quasi-static modal analysis found, mode by mode."""

import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from iwanjax.errors import InputError
from iwanjax.plotting.curves import (
    DAMPING_LABEL,
    amplitude_label,
    draw_curves,
    frequency_label,
)
from iwanjax.plotting.joints import landmark
from iwanjax.plotting.style import (
    DOUBLE_COLUMN,
    GREY,
    PALETTE,
    SINGLE_COLUMN,
    mark_amplitude,
    paper_style,
    set_up,
)
from iwanjax.quasistatic import QsmaSolution

_MOST_SHARES = 6
# Below the rule of thumb another mode hardly changes the shape, and shares this far below
# it only stretch the axis.
_RULE_OF_THUMB, _LOWEST_SHARE = 1e-2, 1e-6
# Events closer than this share of the amplitudes' range get one mark.
_SAME_PLACE = 0.04


@paper_style()
def plot_qsma(solution: QsmaSolution) -> Figure:
    r"""Frequency, damping and the other modes' shares against amplitude, a column for each mode.

    Dotted lines mark where joints reach macroslip (or gaps close). The lowest panels show
    :math:`|q_k/q_r|` of the six other modes with the largest shares; above the thin line at
    1e-2 the mode shape changes noticeably with amplitude. These panels are left out where
    the shares are not known: without deflections, for joints whose stiffness differs from
    the structure's reference, and for a structure with one mode.

    Parameters
    ----------
    solution : QsmaSolution
        For one parameter set and one or several modes.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For a batch of parameter sets: ``plot_curves(solution.curves)`` draws that.
    """
    if solution.q.ndim > solution.alpha.ndim:
        raise InputError(
            "plot_qsma draws one parameter set; for a batch use plot_curves(solution.curves)"
        )
    columns = len(solution.modes)
    shares = _shares(solution)
    rows = 2 if shares is None else 3
    figure, axes = plt.subplots(
        rows,
        columns,
        sharex="col",
        squeeze=False,
        figsize=(SINGLE_COLUMN if columns == 1 else DOUBLE_COLUMN, 1.5 * rows + 0.6),
        layout="constrained",
    )
    set_up(*axes.flat)
    for i, (r, column) in enumerate(zip(solution.modes, axes.T, strict=True)):
        curves = jax.tree.map(lambda leaf, i=i: leaf.reshape(columns, -1)[i], solution.curves)
        draw_curves(column[0], column[1], curves, color="black")
        column[-1].set_xlabel(amplitude_label(curves))
        if columns > 1:
            column[0].set_title(f"Mode {r}")
        frequency = np.asarray(curves.frequency)[np.isfinite(curves.frequency)]
        rising = bool(frequency.size and frequency[-1] > frequency[0])
        for amplitude, text in _events(solution, i, np.asarray(curves.amplitude)):
            mark_amplitude(column[0], amplitude, text, rising=rising)
            for ax in column[1:]:
                mark_amplitude(ax, amplitude)
    axes[0, 0].set_ylabel(frequency_label(shift=False))
    axes[1, 0].set_ylabel(DAMPING_LABEL)
    if shares is not None:
        _draw_shares(figure, axes[2], solution, shares)
    figure.align_ylabels(axes[:, 0])
    return figure


def _shares(solution: QsmaSolution) -> np.ndarray | None:
    """|q_k/q_r|, (columns, levels, modes), NaN for the loaded mode; None where not known."""
    try:
        shares = np.abs(np.asarray(solution.participation))
    except InputError:
        return None
    shares = shares.reshape(len(solution.modes), -1, shares.shape[-1])
    if shares.shape[-1] == 1:
        return None
    for of_mode, r in zip(shares, solution.modes, strict=True):
        of_mode[:, r] = np.nan
    return shares


def _draw_shares(
    figure: Figure, row: np.ndarray, solution: QsmaSolution, shares: np.ndarray
) -> None:
    """The lowest panels, in which a mode has one colour throughout."""
    q = np.asarray(solution.q).reshape(len(row), -1)
    largest = np.max(np.nan_to_num(shares), axis=1)
    largest[np.arange(len(row)), list(solution.modes)] = -1.0
    chosen = np.argsort(-largest, axis=1)[:, : min(_MOST_SHARES, shares.shape[-1] - 1)]
    drawn = sorted(set(chosen.ravel().tolist()))
    lines = {
        k: Line2D(
            [],
            [],
            color=PALETTE[k % len(PALETTE)],
            linestyle=("-", "--", ":")[k // len(PALETTE) % 3],
            label=f"$k = {k}$",
        )
        for k in drawn
    }
    top = max(1.0, 1.5 * float(np.max(largest)))
    for ax, x, of_mode, ks in zip(row, q, shares, chosen, strict=True):
        for k in ks:
            share = np.where(of_mode[:, k] > 0, of_mode[:, k], np.nan)
            look = lines[int(k)]
            ax.loglog(x, share, color=look.get_color(), linestyle=look.get_linestyle())
        ax.axhline(_RULE_OF_THUMB, color=GREY, linewidth=0.6)
        ax.set_ylim(_LOWEST_SHARE, top)
    row[0].set_ylabel(r"Share $|q_k/q_r|$ (–)")
    figure.legend(
        handles=list(lines.values()),
        loc="outside lower center",
        ncols=min(len(drawn), 4 if len(row) == 1 else 8),
    )


def _events(solution: QsmaSolution, i: int, q: np.ndarray) -> list[tuple[float, str]]:
    """Modal amplitudes at which joints reach their landmarks, and which joints do.

    Parameters
    ----------
    solution : QsmaSolution
        For one parameter set.
    i : int
        Column: which of the modes that were analysed.
    q : (levels,) array
        Modal amplitudes of this mode.
    """
    if solution.deflection is None:
        return []
    joints = solution.structure.joints
    joints = solution.structure.joints
    deflection = np.asarray(solution.deflection).reshape(-1, len(q), len(joints))[i]
    found: list[tuple[float, str, str]] = []
    for (label, joint), d in zip(joints.items(), np.abs(deflection).T, strict=True):
        mark = landmark(joint)
        where = None if mark is None else _crossing(q, d, mark.deflection)
        if mark is not None and where is not None:
            found.append((where, mark.event, label))
    if not found:
        return []
    near = (np.nanmax(q) / np.nanmin(q)) ** _SAME_PLACE
    groups: list[tuple[float, str, list[str]]] = []
    for where, event, label in sorted(found):
        if groups and groups[-1][1] == event and where < near * groups[-1][0]:
            groups[-1][2].append(label)
        else:
            groups.append((where, event, [label]))
    return [(where, f"{event} {', '.join(labels)}") for where, event, labels in groups]


def _crossing(q: np.ndarray, d: np.ndarray, level: float) -> float | None:
    """Modal amplitude at which a deflection first reaches a level, if within the range."""
    solved = np.isfinite(q)
    q, d = q[solved], d[solved]
    beyond = d >= level
    if not np.any(beyond) or beyond[0]:
        return None
    pair = slice(int(np.argmax(beyond)) - 1, int(np.argmax(beyond)) + 1)
    return float(np.exp(np.interp(np.log(level), np.log(d[pair]), np.log(q[pair]))))
