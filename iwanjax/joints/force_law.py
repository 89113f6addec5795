"""What a search needs of a law: its step, its factor and shape, starting values, nested laws."""

import abc
import math
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol, Self, TypeAlias

from jaxtyping import Array

from iwanjax.joints.abstract import AbstractJoint, ParameterInfo
from iwanjax.types import ArrayLike

Values: TypeAlias = tuple[float, ...]
"""A law's size and, where it has one, its shape."""


class PlaceMotion(NamedTuple):
    """What a place of the structure does over one step.

    Attributes
    ----------
    d, v, a : array
        Deflection, rate and acceleration of the place at the end of the step.
    moved : array
        Change of the deflection over the step.
    dt : array
        Length of the step, s.
    """

    d: Array
    v: Array
    a: Array
    moved: Array
    dt: Array


class Scales(NamedTuple):
    """What a place has seen, to choose starting values by.

    Attributes
    ----------
    deflection : float
        The largest.
    period : float
        The longest, s.
    duration : float
        Of the longest recording, s; a steady cycle has no end.
    stiffness, mass : float
        What holds the place, and what moves with it; known of a structure only.
    lowest, highest : float
        Circular frequencies of its modes, rad/s.
    """

    deflection: float
    period: float
    duration: float = math.inf
    stiffness: float = math.nan
    mass: float = math.nan
    lowest: float = math.nan
    highest: float = math.nan


class EffectName(NamedTuple):
    """What a diagnosis calls a law that a model is missing.

    Attributes
    ----------
    name : str
        As in ``diagnosis.json``.
    usual : str
        What the field calls it.
    signs : str
        What betrays it, in words.
    noun : str
        With its article, as a verdict has it: "A cubic spring is missing between m5 and m6". What
        the field calls it where there is none.
    """

    name: str
    usual: str
    signs: str = ""
    noun: str = ""


class Variant(NamedTuple):
    """One of several forms of a law that a search tries side by side.

    Attributes
    ----------
    words : str
        Which; empty for the first.
    held : tuple of (str, value)
        Arguments of the law that the search leaves as they are.
    within : bool
        Whether K holds the stiffness that the law has at rest already, as that of a linear model
        from a test or from low levels does.
    """

    words: str = ""
    held: tuple[tuple[str, Any], ...] = ()
    within: bool = False


STRENGTHS = (0.01, 0.1, 1.0)
"""Forces at the largest deflection, over what holds the place there, of elements to begin with."""

WITHIN_K = Variant("with its stiffness at rest in K already", within=True)
"""Of laws that give way from a stiffness at rest."""


class HasLimits(Protocol):
    """An element that knows what it becomes at the ends of its parameters' ranges."""

    @classmethod
    def nested_whole(cls, **held: Any) -> "tuple[NestedLaw, ...]":
        """Simpler laws, by all of the element's parameters in their order."""
        ...


class CanBegin(HasLimits, Protocol):
    """An element that knows where a search of all its parameters may begin."""

    @classmethod
    def begun(cls, seen: Scales, **held: Any) -> tuple[AbstractJoint, ...]:
        """Elements, from weak to strong ones."""
        ...


class AbstractForceLaw(AbstractJoint):
    """An element whose force is a size times a function of the motion and one shape at most.

    That is what a diagnosis takes for a hypothesis, whatever else the element has in closed form.

    Attributes
    ----------
    effect : EffectName or None
        Its name as a hypothesis; by default the name that it is registered by.
    either_sign : bool
        Whether a search may find less than nothing of it: what a model has too much of.
    variants : tuple of Variant
        Forms to try.
    inertial : bool
        Whether the force is in proportion to the acceleration.
    viscous, elastic : bool
        Whether it is in proportion to the rate, or to the deflection.
    tried : bool
        Whether a diagnosis tries the law from the beginning. Each law is another rival that every
        verdict has to exclude, and costs time wherever it acts or not: of a diagnosis of two small
        structures, in CPU time, a softening spring 2 %, a slider with a dead band 14 and 20 %,
        Bouc-Wen 71 and 77 %, all three 87 and 95 %. Others come in where those leave more than
        noise, with all of their parameters; of curves, when asked for by name.
    taken_for : tuple of str
        Names that explain recordings of the law nearly as well: where one of them is found a law
        that is not tried from the beginning comes in at its place, for data that were never asked
        cannot say which.
    """

    effect: ClassVar[EffectName | None] = None
    either_sign: ClassVar[bool] = False
    variants: ClassVar[tuple[Variant, ...]] = (Variant(),)
    inertial: ClassVar[bool] = False
    viscous: ClassVar[bool] = False
    elastic: ClassVar[bool] = False
    tried: ClassVar[bool] = True
    taken_for: ClassVar[tuple[str, ...]] = ()

    @abc.abstractmethod
    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """One step, elementwise: the force at its end, and what the element then remembers.

        Parameters
        ----------
        motion : PlaceMotion
            Monotonic over the step.
        memory : array
            One number, 0 for the virgin element.
        """

    @classmethod
    def searched(cls) -> tuple[ParameterInfo, ...]:
        """What a search moves: the size, and the shape of a law that has one."""
        return cls.parameters[:2]

    @classmethod
    def scaled(cls, size: ArrayLike, shape: ArrayLike, **held: Any) -> Self:
        """The element of a size and a shape.

        Parameters
        ----------
        size : array_like
            The force is in proportion to it.
        shape : array_like
            Of no effect where :meth:`searched` names a size alone.
        **held
            What a search leaves as it is, where that is not its default.
        """
        names = (info.name for info in cls.searched())
        return cls(**dict(zip(names, (size, shape), strict=False)), **held)

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """Values of the shape to begin a search with; one of no effect without a shape."""
        return (1.0,)

    @classmethod
    def begun(cls, seen: Scales, **held: Any) -> tuple[Self, ...]:
        """Elements to begin a search of all parameters with, from weak to strong ones."""
        found = []
        for shape in cls.starts(seen):
            unit = float(cls.scaled(1.0, shape, **held).backbone(seen.deflection))
            whole = seen.stiffness * seen.deflection / unit
            sizes = [share * whole for share in STRENGTHS]
            sizes += [-size for size in sizes] if cls.either_sign else []
            found += [cls.scaled(size, shape, **held) for size in sizes]
        return tuple(found)

    @classmethod
    def nested(cls, **held: Any) -> "tuple[NestedLaw, ...]":
        """Simpler laws that it becomes at the ends of its shape's range, by size and shape."""
        return ()

    @classmethod
    def nested_whole(cls, **held: Any) -> "tuple[NestedLaw, ...]":
        """The same of the law with all of its parameters, by these in their order."""
        return cls.nested(**held) if cls.searched() == cls.parameters else ()


class NestedLaw(NamedTuple):
    """A simpler law that a law becomes at an end of its range, with the maps between them.

    Attributes
    ----------
    law : type
        The simpler one.
    narrowed : function
        Values of the law -> size and shape of the simpler one that does most nearly the same;
        several where it may be either.
    widened : function
        (size and shape of the simpler law, what the place has seen, share) -> values at which the
        law does the same, the more nearly the smaller the share.
    """

    law: type[AbstractForceLaw]
    narrowed: Callable[[Values], tuple[Values, ...]]
    widened: Callable[[Values, Scales, float], Values]


def stiffness_alone(values: Values) -> tuple[Values, ...]:
    """Of a law whose size is a stiffness, the spring that it becomes."""
    return (values[:1],)
