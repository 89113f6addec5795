"""What may be missing from a model: kinds of physics and of faults of joints, with their signs."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeAlias

from jaxtyping import Array

from iwanjax.effects.faults import AbstractFault
from iwanjax.effects.nested import Nested, softened
from iwanjax.joints import JOINTS, LinearSpring, ParameterInfo
from iwanjax.joints.force_law import (
    AbstractForceLaw,
    CanBegin,
    HasLimits,
    NestedLaw,
    PlaceMotion,
    Scales,
)

_YIELDS = (0.05, 0.3)
"""Shares of the largest deflection at which a law whose stiffness is in K is first tried."""


@dataclass(frozen=True)
class ForceKind:
    """One kind of missing physics: a law of :mod:`iwanjax.joints` at some place of the structure.

    Parameters
    ----------
    name : str
        As in ``diagnosis.json``.
    usual : str
        What the field calls it.
    law : type
        Of which the force, what is fitted, where to begin and the nested laws are.
    signs : str
        What betrays it, in words.
    held : tuple of (str, value)
        Other arguments of the law.
    variant : str
        Which of several forms of the same name, in words; empty for the only one.
    noun : str
        With its article; what the field calls it where there is none.
    within : bool
        Whether K holds the law's stiffness at rest already: its force is what differs from that.
    """

    name: str
    usual: str
    law: type[AbstractForceLaw]
    signs: str = ""
    held: tuple[tuple[str, Any], ...] = ()
    variant: str = ""
    noun: str = ""
    within: bool = False

    @property
    def sentence(self) -> str:
        """What a verdict says of it, its place left open."""
        said = missing(self.noun or self.usual)
        return f"{said}, {self.variant}" if self.within else said

    @property
    def size(self) -> ParameterInfo:
        """The factor of the force; zero is no force at all."""
        return self._infos()[0]

    @property
    def shape(self) -> ParameterInfo | None:
        """A second, positive parameter that the force depends on in another way."""
        return self._infos()[1] if len(self._infos()) > 1 else None

    @property
    def positive(self) -> bool:
        """Whether a negative size means nothing."""
        return self.size.lower >= 0.0

    @property
    def inertial(self) -> bool:
        """Whether the force is in proportion to the place's acceleration."""
        return self.law.inertial

    @property
    def linear(self) -> bool:
        """Whether an error of the model's mass, damping or stiffness does the same."""
        return self.law.inertial or self.law.viscous or self.law.elastic

    @property
    def limits(self) -> tuple[Nested, ...]:
        """Simpler kinds that it becomes at the ends of its shape's range.

        Where one of them does all but as well, that one is named.
        """
        if self.within:
            return (softened(lambda seen: seen.deflection),)
        return _nested(self.law.nested(**dict(self.held)))

    def shapes(self, seen: Scales) -> tuple[float, ...]:
        """Values of the shape to begin with.

        What K holds has not given way in the tests that K is of: shapes are the deflection at
        which it does, a small and a middling one.
        """
        if self.within:
            return tuple(share * seen.deflection for share in _YIELDS)
        return self.law.starts(seen)

    def unit_force(self, motion: PlaceMotion, shape: Array, memory: Array) -> tuple[Array, Array]:
        """Force that opposes a growing deflection, for size 1, and what the place remembers.

        Elementwise over places, one number of memory each.
        """
        law = self.law.scaled(1.0, shape, **dict(self.held))
        force, memory = law.follow(motion, memory)
        return (force - law.initial_stiffness * motion.d if self.within else force), memory

    @property
    def whole(self) -> "JointKind":
        """The same with all of the law's parameters fitted, those too that a search holds."""
        return JointKind(
            self.name,
            self.usual,
            self.law.parameters,
            self.signs,
            self.noun or self.usual,
            self.sentence,
            variant=self.variant,
            within=self.within,
            more=True,
            law=self.law,
            held=self.held,
        )

    def _infos(self) -> tuple[ParameterInfo, ...]:
        size, *shape = self.law.searched()
        return (replace(size, lower=-math.inf) if self.law.either_sign else size, *shape)


@dataclass(frozen=True)
class JointKind:
    """One kind of fault of the model's joints, or a joint too few.

    Parameters
    ----------
    name, usual, signs, noun, sentence
        As for :class:`ForceKind`.
    parameters : tuple of ParameterInfo
        What is fitted.
    variant, within
        As for :class:`ForceKind`, of a joint left out.
    more : bool
        Whether the model has a joint too few.
    law : type, optional
        Of which all parameters are fitted, where all other kinds leave much.
    held : tuple of (str, value)
        Other arguments of what a search begins with.
    element : type, optional
        What a joint too few is, where that is no ``law``.
    """

    name: str
    usual: str
    parameters: tuple[ParameterInfo, ...]
    signs: str
    noun: str
    sentence: str
    variant: str = ""
    within: bool = False
    more: bool = False
    law: type[CanBegin] | None = None
    held: tuple[tuple[str, Any], ...] = ()
    element: type[HasLimits] | None = None

    @property
    def limits(self) -> tuple[Nested, ...]:
        """As for :class:`ForceKind`; what K holds and never gives way is nothing."""
        element = self.element or self.law
        laws = element.nested_whole(**dict(self.held)) if element else ()
        laws = [each for each in laws if not (self.within and each.law is LinearSpring)]
        return tuple(each._replace(within=self.within) for each in _nested(laws))


@dataclass(frozen=True)
class ModeKind:
    """One way in which a mode's own joint is not its own: what else moves it.

    Parameters
    ----------
    name, usual, size, signs, noun, sentence
        As for :class:`ForceKind`.
    """

    name: str
    usual: str
    size: ParameterInfo
    signs: str
    noun: str
    sentence: str
    # There is nothing about it beside its size, and no simpler kind is a limit of it.
    shape: ClassVar[None] = None
    limits: ClassVar[tuple[Nested, ...]] = ()


@dataclass(frozen=True)
class ChannelKind:
    r"""One way in which a joint may depend on what was recorded beside its loops.

    A strength is :math:`1 + c\,(u - \bar u)` times what it is at :math:`\bar u`, the middle of
    what the channel u of the fitted loops goes through.

    Parameters
    ----------
    name : str
        As in hypotheses; where it is found the channel's own name stands in place of "channel".
    usual, signs, noun, sentence
        As for :class:`ForceKind`; "a channel" stands for the channel's name.
    strength : str
        What depends, in words.
    moved : str
        The joint's parameter that does; empty for the whole force.
    channel : str
        Which; empty for any.
    middle : float
        :math:`\bar u`.
    """

    name: str
    usual: str
    signs: str
    noun: str
    sentence: str
    strength: str
    moved: str = ""
    channel: str = ""
    middle: float = 0.0
    # There is nothing about it beside its size, and no simpler kind is a limit of it.
    shape: ClassVar[None] = None
    limits: ClassVar[tuple[Nested, ...]] = ()

    @property
    def size(self) -> ParameterInfo:
        """c, over the channel's own unit."""
        at = f"{self.channel} = {self.middle:.4g}"
        meaning = f"relative change of the {self.strength}, none at {at}"
        return ParameterInfo("change", f"1/{self.channel}", meaning)

    @property
    def variant(self) -> str:
        """The channel, which tells kinds of one name apart."""
        return self.channel

    @property
    def catalogued(self) -> str:
        """Name in the catalogue, whatever the channel is."""
        return self.name.removesuffix(self.channel) + "channel" if self.channel else self.name

    def of(self, channel: str, middle: float) -> "ChannelKind":
        """The kind of one channel."""
        # Filled in with the place later, which braces in a name must not disturb.
        escaped = channel.replace("{", "{{").replace("}", "}}")
        at = f" (its parameters: at {middle:.4g})"
        return replace(
            self,
            name=self.name.replace("channel", channel),
            usual=self.usual.replace("a channel", channel),
            noun=self.noun.replace("a channel", channel),
            sentence=self.sentence.replace("a channel", escaped) + at,
            channel=channel,
            middle=middle,
        )


@dataclass(frozen=True)
class UnnamedKind:
    """Physics that no name fits: any force of a place's own motion.

    Parameters
    ----------
    name, usual, noun, sentence
        As for :class:`ForceKind`.
    variant : str
        What the law does, in words.
    """

    name: str = "unnamed_law"
    usual: str = "physics that no name fits"
    signs: str = "a misfit that no named law takes away"
    noun: str = "a force that no name fits"
    sentence: str = "A force that no name fits is missing {place}"
    variant: str = ""
    # Its law has many terms, and no simpler kind is a limit of it.
    shape: ClassVar[None] = None
    limits: ClassVar[tuple[Nested, ...]] = ()
    # K holds no part of it.
    within: ClassVar[bool] = False


NamedKind: TypeAlias = ForceKind | AbstractFault | JointKind | ModeKind | ChannelKind
"""What the catalogue holds."""

Kind: TypeAlias = NamedKind | UnnamedKind


def missing(noun: str) -> str:
    """What a verdict says of what is missing, its place left open."""
    return f"{noun[:1].upper()}{noun[1:]} is missing {{place}}"


def _nested(laws: Iterable[NestedLaw]) -> tuple[Nested, ...]:
    """The kinds that nested laws are; a law that is no kind is no hypothesis either."""
    return tuple(
        Nested(law.effect.name if law.effect else registered, nested.narrowed, nested.widened)
        for nested in laws
        for registered, law in force_laws().items()
        if law is nested.law and any(not variant.words for variant in law.variants)
    )


def force_laws() -> dict[str, type[AbstractForceLaw]]:
    """Laws among the registered joints that may stand alone, by the name they are registered by."""
    return {name: law for name, law in JOINTS.items() if issubclass(law, AbstractForceLaw)}
