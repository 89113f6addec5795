"""Updating: fits and posteriors of joints and linear parameters from measured curves and modes.

:func:`~iwanjax.updating.sampling.sample_posterior` stays in its module: emcee takes a second to
import, which a fit does not need.
"""

from iwanjax.updating.estimate import fit
from iwanjax.updating.joint_groups import structural_parameters
from iwanjax.updating.linear import positive_parameter, update_linear
from iwanjax.updating.linear_problem import MeasuredModes
from iwanjax.updating.linear_solution import LinearSolution
from iwanjax.updating.modal import modal_parameters
from iwanjax.updating.pareto import ParetoFront, pareto_front
from iwanjax.updating.posterior import Band, Posterior
from iwanjax.updating.power_law import Exponents, free_exponents
from iwanjax.updating.sampled import SampledFits, sample_fits
from iwanjax.updating.solution import Direction, FitSolution

__all__ = [
    "Band",
    "Direction",
    "Exponents",
    "FitSolution",
    "LinearSolution",
    "MeasuredModes",
    "ParetoFront",
    "Posterior",
    "SampledFits",
    "fit",
    "free_exponents",
    "modal_parameters",
    "pareto_front",
    "positive_parameter",
    "sample_fits",
    "structural_parameters",
    "update_linear",
]
