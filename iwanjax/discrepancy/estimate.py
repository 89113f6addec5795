"""A parameter with its deviation."""

from typing import NamedTuple

from iwanjax.joints import ParameterInfo

SURE = 2.0
"""Deviations from none at all that a size has to be known by: one in twenty is not, by chance."""


class Estimate(NamedTuple):
    """A parameter's value, and its deviation; NaN where it was not fitted."""

    info: ParameterInfo
    value: float
    std: float


class Refitted(NamedTuple):
    """A joint, or a mode with its joint, as refitted.

    Attributes
    ----------
    name : str
        Its label in the study, or the mode's name.
    parameters : tuple of Estimate
        With deviations; NaN for what was not fitted.
    """

    name: str
    parameters: tuple[Estimate, ...]
