"""How the values of a parameter are laid along an axis, and what the axis is called."""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axis import Axis
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator

if TYPE_CHECKING:
    from iwanjax.estimation.parameters import Parameter

# Bins of a histogram.
_BINS = 36
# Share of the draws beyond each end of an axis.
_TAIL = 1e-3
# Share of the range that is left free beyond them.
_MARGIN = 0.06
# An estimate outside the draws may stretch the axis by this share of it.
_STRETCH = 0.5
# A positive parameter whose central 95 per cent span this factor or more has a logarithmic axis.
_LOGARITHMIC = 5.0
# Labels on an axis of the corner, about.
_TICKS = 3
# Draws this close together, relative to their value, are told by their distance from a number.
_CLOSE = 0.02
# Numbers of this size are told without a power of ten.
_USUAL = (0.05, 1000.0)
# A unit longer than this gets a line of its own.
_LONG = 6

_SYMBOLS = {
    "f_0": "f_0",
    "zeta_0": r"\zeta_0",
    "chi": r"\chi",
    "beta": r"\beta",
    "theta": r"\theta",
    "gap": r"\mathrm{gap}",
    "noise_scale_frequency": "s_f",
    "noise_scale_damping": r"s_\zeta",
}


def symbol(name: str) -> str:
    """A parameter's name as a formula calls it, for instance ``J1 $F_S$`` for J1.F_S."""
    owner, _, own = name.rpartition(".")
    if own in _SYMBOLS:
        own = _SYMBOLS[own]
    elif "_" in own:
        head, tail = own.split("_", 1)
        own = f"{head}_{{\\mathrm{{{tail}}}}}"
    return f"{owner} ${own}$".strip()


@dataclass(frozen=True)
class Scale:
    """How the values x of a parameter are laid along an axis: (x - origin)/10^power.

    Attributes
    ----------
    name, label : str
        Of the parameter, and what the axis is called.
    origin : float
        Near the values where they differ in their last digits only, else zero.
    power : int
        Power of ten that is in the label.
    logarithmic : bool
        Whether the axis counts decades; the origin then is zero.
    low, high : float
        Ends of the histograms, along the axis.
    estimate : float or None
        Of the fit, along the axis.
    """

    name: str
    label: str
    origin: float
    power: int
    logarithmic: bool
    low: float = 0.0
    high: float = 1.0
    estimate: float | None = None

    @classmethod
    def of(cls, name: str, values: np.ndarray, parameter: "Parameter | None") -> "Scale":
        """The scale that suits draws of a parameter (None for a noise scale)."""
        low, first, middle, last, high = np.quantile(values, [_TAIL, 0.025, 0.5, 0.975, 1 - _TAIL])
        positive = low > 0 and (parameter is None or parameter.transform == "log")
        logarithmic = bool(positive and last > _LOGARITHMIC * first)
        origin, span = 0.0, high - low
        if not logarithmic and 0.0 < span < _CLOSE * abs(middle):
            # Rounded so that the label stays short and the ticks begin near zero.
            origin = round(float(middle), -math.floor(math.log10(span)))
        largest = max(abs(low - origin), abs(high - origin))
        usual = _USUAL[0] <= largest < _USUAL[1] or largest == 0.0
        power = 0 if usual else 3 * math.floor(math.log10(largest) / 3)
        label = _label(name, origin, power, "" if parameter is None else parameter.unit)
        scale = cls(name, label, origin, power, logarithmic)
        return scale._reaching(low, high, parameter)

    def _reaching(self, low: float, high: float, parameter: "Parameter | None") -> "Scale":
        """The same with ends a little beyond two values, never beyond the parameter's bounds."""
        ends = self.of_values(np.array([low, high]))
        span = float(ends[1] - ends[0]) or 1.0
        left, right = float(ends[0]) - _MARGIN * span, float(ends[1]) + _MARGIN * span
        if parameter is None:
            return replace(self, low=left, high=right)
        estimate = float(self.of_values(np.array(parameter.value)))
        if -_STRETCH * span < estimate - left and estimate - right < _STRETCH * span:
            left = min(left, estimate - _MARGIN * span)
            right = max(right, estimate + _MARGIN * span)
        bounds = self.of_values(np.array([parameter.lower, parameter.upper]))
        return replace(
            self,
            low=max(left, float(bounds[0])),
            high=min(right, float(bounds[1])),
            estimate=estimate,
        )

    def of_values(self, values: np.ndarray) -> np.ndarray:
        """Along the axis, where a logarithmic one counts decades."""
        scaled = (values - self.origin) / 10.0**self.power
        if not self.logarithmic:
            return scaled
        return np.log10(np.maximum(scaled, np.finfo(float).tiny))

    def to_values(self, shown: np.ndarray) -> np.ndarray:
        """The inverse of :meth:`of_values`."""
        return self.origin + 10.0**self.power * (10.0**shown if self.logarithmic else shown)

    @property
    def edges(self) -> np.ndarray:
        """Of the histograms' bins."""
        return np.linspace(self.low, self.high, _BINS + 1)

    @property
    def ends(self) -> tuple[float, float]:
        """Of the axis, where a bound can still be seen."""
        margin = 0.02 * (self.high - self.low)
        return self.low - margin, self.high + margin

    def place_ticks(self, axis: Axis) -> None:
        """A few labels, none at the very ends, where they would run into the next panel's."""
        edge = 0.05 * (self.high - self.low)
        places, words = self._ticks(self.low + edge, self.high - edge)
        axis.set_major_locator(FixedLocator(places))
        axis.set_major_formatter(FixedFormatter(words))

    def _ticks(self, low: float, high: float) -> tuple[list[float], list[str]]:
        """Places and words between two ends."""
        places: list[float] = []
        if not self.logarithmic:
            for count in range(_TICKS, 2 * _TICKS):
                at = np.asarray(MaxNLocator(count, steps=[1, 2, 5, 10]).tick_values(low, high))
                places = at[(at >= low) & (at <= high)].tolist()
                if len(places) > 1:
                    break
            return places, [f"{place:.6g}".replace("-", "\N{MINUS SIGN}") for place in places]
        decades = range(math.floor(low), math.ceil(high) + 1)
        for steps in ((1.0, 2.0, 5.0), (1.0, 3.0), (1.0,)):
            every = (math.log10(step) + k for k in decades for step in steps)
            places = [place for place in every if low <= place <= high]
            if len(places) <= _TICKS + 1:
                break
        places = places[:: -(-len(places) // (_TICKS + 1)) or 1]
        return places, [f"{10.0**place:g}" for place in places]


def _label(name: str, origin: float, power: int, unit: str) -> str:
    """Symbol and origin above, power of ten and unit beneath."""
    first = symbol(name)
    if origin:
        sign = "-" if origin > 0 else "+"
        first = f"{first} ${sign}$ {abs(origin):.15g}"
    second = ("\n" if len(unit) > _LONG else " ").join(
        filter(None, [f"$10^{{{power}}}$" if power else "", unit])
    )
    return f"{first}\n({second})" if second else first
