"""A fitted parameter with its deviation."""

from typing import NamedTuple

from iwanjax.joints import ParameterInfo


class Estimate(NamedTuple):
    """A parameter's value, and its deviation; NaN where it was not fitted."""

    info: ParameterInfo
    value: float
    std: float
