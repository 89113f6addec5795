"""What may be wrong with a channel: a sensor's, or that of a measured force."""

import abc
import math
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from jaxtyping import Array, Float

from iwanjax.effects.nested import Nested
from iwanjax.joints import ParameterInfo

TURNED = -2.0
"""Error of the gain of a channel with the opposite sign."""


@dataclass(frozen=True)
class AbstractFault(abc.ABC):
    """One kind of fault of a channel, with one size; of size zero it does nothing.

    Parameters
    ----------
    name : str
        As in ``diagnosis.json``.
    usual : str
        What the field calls it.
    size : ParameterInfo
        What is fitted.
    signs : str
        What betrays it, in words.
    noun, sentence : str
        With its article, and what a verdict says of it: ``{where}`` is the channel's label.
    fixed : float, optional
        The size, where there is nothing to fit.
    turned : str
        The kind of a channel of the opposite sign, with nothing to fit, which one with a wrong gain
        becomes.

    Attributes
    ----------
    positive : bool
        Whether a size that is not positive means nothing; its logarithm is fitted then.
    none_at_infinity : bool
        Whether an infinite size does nothing, instead of zero.
    most : float
        Largest size to begin a search with, in its unit.
    """

    name: str
    usual: str
    size: ParameterInfo
    signs: str
    noun: str
    sentence: str
    fixed: float | None = None
    turned: str = ""
    positive: ClassVar[bool] = False
    none_at_infinity: ClassVar[bool] = False
    most: ClassVar[float] = math.inf

    @property
    def limits(self) -> tuple[Nested, ...]:
        """Simpler kinds that it becomes at one size."""
        opposite = Nested(self.turned, lambda _: ((TURNED,),), lambda values, *_: values)
        return (opposite,) if self.turned else ()

    def unit(self, dt: float) -> float:
        """What a size of 1 is where samples are dt apart, s."""
        return 1.0

    def tried(self, largest: float) -> tuple[float, ...]:
        """Sizes to be tried as they are, beside what the slope at zero asks for.

        Parameters
        ----------
        largest : float
            Value that the channel showed, but for noise.
        """
        return () if self.fixed is None else (self.fixed,)


class AbstractSensorFault(AbstractFault):
    """A fault of a sensor: a step of its measurement chain.

    It acts on what is predicted, not on the data. All sensors are taken at once, the size zero
    (or the limit of none) for those without the fault.

    Attributes
    ----------
    scales : bool
        Whether it is a factor 1 + size at all frequencies, which an observer is designed for.
    """

    scales: ClassVar[bool] = False

    def slope(
        self, shown: Float[np.ndarray, "recordings N sensors"]
    ) -> Float[np.ndarray, "recordings N sensors"] | None:
        """Derivative of what sensors show by the size, at none; None where there is none."""
        return None

    @abc.abstractmethod
    def set_up(self, size: Float[Array, " sensors"]) -> Any:
        """Everything of the sensors that does not change from sample to sample."""

    @abc.abstractmethod
    def rest(self, sensors: int) -> Any:
        """What the sensors remember before the first sample."""

    @abc.abstractmethod
    def show(
        self, seen: Float[Array, " sensors"], set_up: Any, memory: Any
    ) -> tuple[Float[Array, " sensors"], Any]:
        """One sample: what the sensors show, and what they remember then."""


class AbstractForceFault(AbstractFault):
    """A fault of the channel of a measured force: another force than the measured one acted.

    Attributes
    ----------
    last : bool
        Whether it comes after all others on the way from the force to its record.
    """

    last: ClassVar[bool] = False

    @abc.abstractmethod
    def acted(
        self,
        measured: Float[np.ndarray, " N"],
        size: float,
        lost: Float[np.ndarray, " N"],
    ) -> Float[np.ndarray, " N"]:
        """The force that acted, of one recording.

        Parameters
        ----------
        measured : (N,) array
            Zero outside its pulses.
        size : float
            In its unit, see :meth:`unit`.
        lost : (N,) array
            What was cut off its peaks, at a guess; zero where it is not clipped.
        """


class AbstractAddedFault(AbstractFault):
    """Something in the channel of a sensor that is added to what it shows, whatever it shows.

    Its columns, each of any size in each recording, are taken out of the residuals.

    Attributes
    ----------
    over_rms : float
        The reported size over the root mean square of what is added.
    told : ParameterInfo, optional
        A value that the columns depend on, and that is fitted.
    """

    over_rms: ClassVar[float] = 1.0
    told: ClassVar[ParameterInfo | None] = None

    def tuned(self, left: Float[np.ndarray, "recordings N"], dt: float) -> "Self | None":
        """The fault that what is left of a sensor's data asks for; None for none."""
        return self

    @property
    @abc.abstractmethod
    def count(self) -> int:
        """Number of columns."""

    @abc.abstractmethod
    def columns(self, count: int, dt: float) -> Float[np.ndarray, "N columns"]:
        """What may be added at so many samples, dt apart."""

    def moved(self, by: float, span: float) -> Self:
        """With another value of ``told``, by a number of its unit in recordings of span, s."""
        return self

    def value(self, span: float) -> tuple[float, float]:
        """What is told, and its unit."""
        return math.nan, math.nan
