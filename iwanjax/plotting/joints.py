"""One joint element: its loops, what a cycle dissipates, and how it softens."""

from typing import NamedTuple

import equinox as eqx
import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint, Gap, Iwan4, Iwan5, Jenkins
from iwanjax.plotting.style import (
    DOUBLE_COLUMN,
    GREY,
    PALETTE,
    mark_amplitude,
    paper_style,
    set_up,
    with_unit,
)
from iwanjax.types import ArrayLike, as_real

# Loops below, at and above the landmark.
_LOOPS = (0.5, 1.0, 1.5)
_LEVELS = 300


class Landmark(NamedTuple):
    """The deflection at which an element changes its character.

    Attributes
    ----------
    deflection : float
        Length.
    symbol : str
        How a formula calls it.
    event : str
        What happens there.
    """

    deflection: float
    symbol: str
    event: str


def landmark(joint: AbstractJoint) -> Landmark | None:
    """Macroslip of an element with ``phi_max`` or of a Jenkins element, contact of a gap.

    Parameters
    ----------
    joint : joint
        One parameter set.

    Returns
    -------
    Landmark or None
        None for elements that behave alike at all amplitudes.
    """
    phi_max = getattr(joint, "phi_max", None)
    if phi_max is not None:
        return Landmark(float(phi_max), r"\phi_\mathrm{max}", "macroslip")
    if isinstance(joint, Jenkins):
        return Landmark(float(joint.F_S / joint.K_T), "F_S/K_T", "macroslip")
    if isinstance(joint, Gap) and joint.gap > 0:
        return Landmark(float(joint.gap), r"\mathrm{gap}", "contact")
    return None


@paper_style()
def plot_joint(
    joint: AbstractJoint,
    amplitudes: ArrayLike | None = None,
    *,
    length_unit: str = "",
    force_unit: str = "",
) -> Figure:
    r"""Backbone and steady loops, dissipation per cycle and secant stiffness of one element.

    Loops are drawn at 0.5, 1 and 1.5 times the deflection at macroslip (or at which a gap
    closes), or at these fractions of what ``amplitudes`` allow where that is less. In
    microslip an Iwan element dissipates in proportion to :math:`d^{\chi+3}`, which a
    dashed line shows. Elastic elements have neither loops nor a panel for dissipation.

    Parameters
    ----------
    joint : joint
        An element with one parameter set.
    amplitudes : (levels,) array_like, optional
        Amplitudes of dissipation and secant, length. By default from 1/1000 of the
        deflection at macroslip to three times it; of 1 for elements without a scale of
        their own, such as springs.
    length_unit, force_unit : str
        For the labels, for instance ``"mm"`` and ``"N"``.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For a batch of parameter sets, amplitudes that are not positive, and elements
        whose force depends on rate (a dashpot): they have no loop without a frequency.
    """
    if any(np.ndim(leaf) for leaf in jax.tree.leaves(joint)):
        raise InputError(f"plot_joint draws one parameter set; {joint!r} carries a batch")
    special = landmark(joint)
    levels = _levels(amplitudes, 1.0 if special is None else special.deflection)
    if special is not None and levels[0] < special.deflection < levels[-1]:
        levels = np.union1d(levels, _around(special))
    else:
        special = None
    try:
        dissipation = np.asarray(_dissipation(joint, levels))
    except InputError as error:
        raise InputError(f"plot_joint: this element has no quasi-static loop: {error}") from error

    lossy = bool(np.any(dissipation > 0))
    figure = plt.figure(figsize=(0.75 * DOUBLE_COLUMN, 3.6 if lossy else 2.3), layout="constrained")
    grid = figure.add_gridspec(1 + lossy, 2)
    loops, secant = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[-1, 1])
    panels = [loops, secant]
    both = bool(length_unit and force_unit)
    _draw_force(loops, joint, levels[-1] / _LOOPS[-1], special, lossy, length_unit)
    loops.set_xlabel(with_unit("Deflection $d$", length_unit))
    loops.set_ylabel(with_unit("Force $F$", force_unit))
    _draw_secant(secant, joint, levels, special)
    secant.set_xlabel(with_unit("Amplitude $d_0$", length_unit))
    secant.set_ylabel(
        with_unit("Secant stiffness $K$", f"{force_unit}/{length_unit}" if both else "")
    )
    if lossy:
        losses = figure.add_subplot(grid[0, 1], sharex=secant)
        panels.append(losses)
        _draw_dissipation(losses, joint, levels, dissipation, special)
        losses.set_ylabel(
            with_unit("Dissipation $D$", f"{force_unit} {length_unit}" if both else "")
        )
    set_up(*panels)
    figure.align_ylabels(panels[1:])
    return figure


# Compiled as wholes: operation by operation they would take seconds on first use.
_secant = eqx.filter_jit(lambda joint, d: joint.secant(d))
_dissipation = eqx.filter_jit(lambda joint, d: joint.dissipation(d))
_backbone = eqx.filter_jit(lambda joint, d: joint.backbone(d))
_loops = eqx.filter_jit(
    lambda joint, amplitudes: jax.vmap(lambda a: joint.loop(a, points=4 * _LEVELS))(amplitudes)
)


def _levels(amplitudes: ArrayLike | None, scale: float) -> np.ndarray:
    """Checked amplitudes, increasing."""
    if amplitudes is None:
        return scale * np.geomspace(1e-3, 3.0, _LEVELS)
    levels = np.unique(np.asarray(as_real(amplitudes, "amplitudes")))
    if levels.size < 2 or levels[0] <= 0:
        raise InputError("plot_joint: amplitudes must be two or more different positive numbers")
    return levels


def _around(special: Landmark) -> np.ndarray:
    """Both sides of the kink or drop at a landmark, which levels may straddle."""
    return special.deflection * np.array([1.0 - 1e-9, 1.0])


def _draw_force(
    ax: Axes,
    joint: AbstractJoint,
    largest: float,
    special: Landmark | None,
    lossy: bool,
    unit: str,
) -> None:
    """Backbone, and steady loops at the landmark and about it, or up to 1.5 ``largest``."""
    ax.locator_params(axis="x", nbins=5)
    if special is not None and special.deflection > largest:
        special = None
    middle = largest if special is None else special.deflection
    d = middle * np.append(0.0, np.geomspace(1e-3, 1.1 * _LOOPS[-1], _LEVELS))
    if special is not None:
        d = np.union1d(d, _around(special))
        mark_amplitude(ax, special.deflection)
    if not lossy:
        d = np.union1d(-d, d)
        ax.plot(d, _backbone(joint, d), color=PALETTE[0])
        return
    # Small loops lie on top: they may be no more than a part of the larger ones' flanks.
    # The loop at a landmark ends just before it: rounding must not decide on which side.
    tips = np.array(_LOOPS) * (middle if special is None else _around(special)[0])
    curves = zip(*map(np.asarray, _loops(joint, tips)), strict=True)
    for i, (factor, curve) in enumerate(zip(_LOOPS, curves, strict=True)):
        amplitude = (
            f"{factor * middle:.3g} {unit}".strip()
            if special is None
            else f"${factor:g}\\,{special.symbol}$"
        )
        ax.plot(
            *curve,
            color=PALETTE[i],
            label=f"$d_0 =${amplitude}",
            zorder=3.0 - 0.1 * i,
        )
    ax.plot(
        d,
        _backbone(joint, d),
        color="black",
        linewidth=0.8,
        linestyle="--",
        label="backbone",
        zorder=4.0,
    )
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _draw_secant(
    ax: Axes, joint: AbstractJoint, levels: np.ndarray, special: Landmark | None
) -> None:
    """Secant stiffness of the steady cycle."""
    stiffness = np.asarray(_secant(joint, levels))
    ax.semilogx(levels, stiffness, color=PALETTE[0])
    if special is not None:
        rising = bool(stiffness[-1] > stiffness[0])
        mark_amplitude(ax, special.deflection, f"${special.symbol}$", rising=rising)


def _draw_dissipation(
    ax: Axes,
    joint: AbstractJoint,
    levels: np.ndarray,
    dissipation: np.ndarray,
    special: Landmark | None,
) -> None:
    """Energy per cycle, and for Iwan elements the power law of microslip beside it."""
    ax.loglog(levels, np.where(dissipation > 0, dissipation, np.nan), color=PALETTE[0])
    ax.tick_params(labelbottom=False)
    if special is not None:
        mark_amplitude(ax, special.deflection)
    if not isinstance(joint, Iwan4 | Iwan5):
        return
    low = levels[(levels < joint.phi_max) & (levels <= 0.1 * levels[-1])]
    if low.size < 2:
        return
    slope = float(joint.chi) + 3.0
    line = 0.25 * dissipation[0] * (low / low[0]) ** slope
    ax.plot(low, line, color=GREY, linestyle="--", linewidth=0.9)
    ax.annotate(
        rf"slope $\chi+3 = {slope:.3g}$",
        (float(low[low.size // 2]), float(line[low.size // 2])),
        xytext=(4, -2),
        textcoords="offset points",
        ha="left",
        va="top",
        color=GREY,
        fontsize=7.0,
    )
