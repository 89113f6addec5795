"""Figures of what a study returns, by those of what it is made of."""

from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from iwanjax.plotting.curves import plot_curves
from iwanjax.plotting.fit import plot_fit
from iwanjax.plotting.ringdown import plot_merged
from iwanjax.plotting.transient import plot_hysteresis
from iwanjax.studies import MeasuredMode

if TYPE_CHECKING:
    from iwanjax.studies.fits import StudyFit
    from iwanjax.studies.simulations import DrivenJoint


def plot_measured(mode: MeasuredMode, **options: Any) -> Figure:
    """A mode's recordings and their common curve; options of :func:`plot_merged`, or of curves."""
    if mode.merged is not None:
        return plot_merged(mode.merged, **options)
    return plot_curves([hit.curves for hit in (*mode.hits, *mode.held_out)], **options)


def plot_study_fit(fit: "StudyFit", **options: Any) -> Figure:
    """A fit with the curves that it has not seen; options of :func:`plot_fit`."""
    held_out = [row.curves for row in fit.held_out if row.curves is not None]
    return plot_fit(fit.solution, held_out, **options)


def plot_driven(driven: "DrivenJoint", **options: Any) -> Figure:
    """A joint's loops; options of :func:`plot_hysteresis`."""
    # Virgin curve and steady loop are quasi-static.
    joint = None if driven.joint.discrete().rate_dependent else driven.joint
    return plot_hysteresis(driven.d, driven.force, joint, amplitude=driven.amplitude, **options)
