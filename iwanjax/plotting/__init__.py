"""Figures of joints, curves and analyses; matplotlib is loaded with this package only."""

from functools import singledispatch
from typing import Any

from matplotlib.figure import Figure

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy import Diagnosis
from iwanjax.dynamics import ModalDecays, SimulatedResponse
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.plotting.curves import plot_curves
from iwanjax.plotting.detectability import plot_detectability
from iwanjax.plotting.diagnosis import (
    plot_diagnosis,
    plot_places,
    plot_prediction,
    plot_restoring,
    plot_unnamed,
)
from iwanjax.plotting.explained import plot_explained
from iwanjax.plotting.fit import plot_fit, plot_study_fit
from iwanjax.plotting.joints import plot_joint
from iwanjax.plotting.linear import plot_linear
from iwanjax.plotting.loops import plot_loops
from iwanjax.plotting.modal_test import plot_modal_test
from iwanjax.plotting.posterior import plot_bands, plot_posterior
from iwanjax.plotting.predicted import plot_predicted
from iwanjax.plotting.quasistatic import plot_qsma
from iwanjax.plotting.ringdown import (
    plot_contents,
    plot_measured,
    plot_merged,
    plot_ringdown,
)
from iwanjax.plotting.shapes import plot_assurance, plot_shapes, plot_strokes
from iwanjax.plotting.single_mode import plot_decays, plot_modes
from iwanjax.plotting.trade_off import plot_front, plot_sampled
from iwanjax.plotting.transient import plot_driven, plot_hysteresis, plot_transient
from iwanjax.plotting.trial import plot_trial
from iwanjax.quasistatic import QsmaSolution
from iwanjax.signals import FileContents
from iwanjax.signals.hilbert import RingDown
from iwanjax.signals.merge import MergedCurves
from iwanjax.studies import MeasuredMode, StudyResults

__all__ = [
    "plot",
    "plot_assurance",
    "plot_bands",
    "plot_contents",
    "plot_curves",
    "plot_decays",
    "plot_detectability",
    "plot_diagnosis",
    "plot_explained",
    "plot_fit",
    "plot_front",
    "plot_hysteresis",
    "plot_joint",
    "plot_linear",
    "plot_loops",
    "plot_merged",
    "plot_modal_test",
    "plot_modes",
    "plot_places",
    "plot_posterior",
    "plot_predicted",
    "plot_prediction",
    "plot_qsma",
    "plot_restoring",
    "plot_ringdown",
    "plot_sampled",
    "plot_shapes",
    "plot_strokes",
    "plot_transient",
    "plot_trial",
    "plot_unnamed",
]

# By name: their modules load the optimisers and emcee, which other figures do not need.
_BY_NAME = {
    "iwanjax.modal_analysis.result.ModalTest": plot_modal_test,
    "iwanjax.planning.result.Detectability": plot_detectability,
    "iwanjax.trial.outcome.TrialResult": plot_trial,
    "iwanjax.updating.solution.FitSolution": plot_fit,
    "iwanjax.updating.linear_solution.LinearSolution": plot_linear,
    "iwanjax.updating.pareto.ParetoFront": plot_front,
    "iwanjax.updating.posterior.Posterior": plot_posterior,
    "iwanjax.updating.sampled.SampledFits": plot_sampled,
    "iwanjax.studies.fits.StudyFit": plot_study_fit,
    "iwanjax.studies.predicted.PredictedRecording": plot_predicted,
    "iwanjax.studies.simulations.DrivenJoint": plot_driven,
}


@singledispatch
def plot(obj: Any, **options: Any) -> Figure:
    """The figure that suits an object.

    Parameters
    ----------
    obj : object
        A joint, ModalCurves, QsmaSolution, RingDown, MergedCurves, SimulatedResponse, ModalDecays,
        Diagnosis, Detectability, FitSolution, LinearSolution, ModalTest, SampledFits, ParetoFront
        or Posterior, or what a study returns.
    **options
        Passed to :func:`plot_joint`, :func:`plot_curves`, :func:`plot_qsma`,
        :func:`plot_ringdown`, :func:`plot_merged`, :func:`plot_transient`, :func:`plot_fit` or
        :func:`plot_posterior`.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For an object that has no figure.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> figure = ij.plot(ij.qsma(ij.three_mass(), 0, np.geomspace(1e-2, 1.0, 5), 1e-4))
    >>> len(figure.axes)
    3
    """
    if isinstance(obj, StudyResults):
        return plot(obj.only, **options)
    for kind in type(obj).__mro__:
        draw = _BY_NAME.get(f"{kind.__module__}.{kind.__qualname__}")
        if draw is not None:
            return draw(obj, **options)
    raise InputError(
        f"plot: no figure for a {type(obj).__name__}; expected a joint, ModalCurves, QsmaSolution, "
        "RingDown, MergedCurves, SimulatedResponse, ModalDecays, "
        "Diagnosis, Detectability, FitSolution, LinearSolution, ModalTest, SampledFits, "
        "ParetoFront or Posterior, or what a study returns"
    )


plot.register(AbstractJoint, plot_joint)
plot.register(ModalCurves, plot_curves)
plot.register(QsmaSolution, plot_qsma)
plot.register(FileContents, plot_contents)
plot.register(RingDown, plot_ringdown)
plot.register(MergedCurves, plot_merged)
plot.register(SimulatedResponse, plot_transient)
plot.register(ModalDecays, plot_decays)
plot.register(Diagnosis, plot_diagnosis)
plot.register(MeasuredMode, plot_measured)
