"""Simpler laws that a law becomes at an end of its range: the way there, and the way back."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from iwanjax.joints import Iwan4

# Exponent of the power-law part of a joint that is nearly a spring or a slider, where it matters
# least: the middle of what bolted joints show (Segalman 2005).
_CHI = -0.5


class Scales(NamedTuple):
    """What a place has seen, to choose shapes by: largest deflection, and longest period (s)."""

    deflection: float
    period: float


Values: TypeAlias = tuple[float, ...]
"""Values of a law, in the order in which its kind declares them."""


class Nested(NamedTuple):
    """A simpler law that a law becomes at an end of its range.

    Attributes
    ----------
    name : str
        Kind of the simpler law.
    narrowed : function
        Values of the law -> those of the simpler one that does most nearly the same; several
        where it may be either.
    widened : function
        (values of the simpler law, what the place has seen, share) -> values at which the law
        does the same, the more nearly the smaller the share.
    """

    name: str
    narrowed: Callable[[Values], tuple[Values, ...]]
    widened: Callable[[Values, Scales, float], Values]


def _first(values: Values) -> tuple[Values, ...]:
    """The stiffness alone."""
    return (values[:1],)


def _sliders(values: Values) -> tuple[Values, ...]:
    """With a joint's stiffness, and its strength or the largest slip of its sliders."""
    F_S, K_T, *_ = values
    return (K_T, F_S / K_T), (K_T, float(Iwan4(*values).phi_max))


def closed_gap(name: str) -> Nested:
    """A gap of no width: a spring, or one on one side."""
    return Nested(name, _first, lambda spring, seen, share: (*spring, share * seen.deflection))


STUCK_SLIDER = Nested(
    "stiffness_error", _first, lambda spring, seen, share: (*spring, seen.deflection / share)
)
"""A slider that never slips."""
MAXWELL = (
    Nested("stiffness_error", _first, lambda spring, seen, share: (*spring, seen.period / share)),
    Nested(
        "viscous_damping",
        lambda values: ((values[0] * values[1],),),
        lambda damper, seen, share: (damper[0] / (share * seen.period), share * seen.period),
    ),
)
"""A spring and damper in series that hardly relaxes is a spring; one that does, a damper."""
TURNED = -2.0
"""Error of the gain of a sensor with the opposite sign."""
WRONG_SIGN = Nested("sensor_polarity", lambda _: ((TURNED,),), lambda turned, *_: turned)
"""A sensor with the opposite sign."""
SLIDING_JOINT = Nested(
    "coulomb_friction",
    _sliders,
    lambda slider, seen, share: (slider[0] * slider[1], slider[0], _CHI, 1.0 / share),
)
"""A joint all of whose sliders slip at once."""
STUCK_JOINT = Nested(
    "stiffness_error",
    lambda values: (values[1:2],),
    lambda spring, seen, share: (spring[0] * seen.deflection / share, *spring, _CHI, 1.0 / share),
)
"""A joint that never slips."""
