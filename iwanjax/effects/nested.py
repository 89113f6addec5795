"""Simpler kinds that a kind becomes at an end of its range: the way there, and the way back."""

from collections.abc import Callable
from typing import Any, NamedTuple

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
    within : bool
        Whether the simpler kind is that with its stiffness in K already.
    """

    name: str
    narrowed: Callable[[Values], tuple[Values, ...]]
    widened: Callable[[Values, Scales, float], Values]
    within: bool = False

    def means(self, kind: Any) -> bool:
        """Whether a kind is the simpler one."""
        return kind.name == self.name and getattr(kind, "within", False) == self.within

    def same_as(self, other: "Nested") -> bool:
        """Whether another kind becomes the same simpler one."""
        return (self.name, self.within) == (other.name, other.within)


def softened(slips: Callable[[Scales], float]) -> Nested:
    """A law that gives way at once, with its stiffness in K already: so much less stiffness.

    Parameters
    ----------
    slips : function
        What the place has seen -> shape at which the law gives way at full deflection.
    """
    return Nested(
        "stiffness_error",
        lambda values: ((-values[0],),),
        lambda spring, seen, share: (-spring[0], share * slips(seen)),
    )
