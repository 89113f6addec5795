"""Simpler kinds that a kind becomes at an end of its range: the way there, and the way back."""

from collections.abc import Callable
from typing import NamedTuple

from iwanjax.joints.force_law import Scales, Values


class Nested(NamedTuple):
    """A simpler kind that a kind becomes at an end of its range.

    Attributes
    ----------
    name : str
        Of the simpler kind.
    narrowed : function
        Values of the kind -> those of the simpler one that does most nearly the same; several
        where it may be either.
    widened : function
        (values of the simpler kind, what the place has seen, share) -> values at which the kind
        does the same, the more nearly the smaller the share.
    """

    name: str
    narrowed: Callable[[Values], tuple[Values, ...]]
    widened: Callable[[Values, Scales, float], Values]
