"""Estimation: parameters, priors, least squares and evidence, whatever they are of.

It knows no physics: residuals are handed to it. :mod:`least_squares` stays in its module, since
optimistix and JAX's compiler take a second to import, which a file of parameters does not need.
"""

from iwanjax.estimation.parameters import Parameter
from iwanjax.estimation.priors import (
    PRIORS,
    AbstractPrior,
    LogNormal,
    LogUniform,
    Normal,
    Uniform,
)

__all__ = [
    "PRIORS",
    "AbstractPrior",
    "LogNormal",
    "LogUniform",
    "Normal",
    "Parameter",
    "Uniform",
]
