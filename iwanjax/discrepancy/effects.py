"""What may be missing from a model: each kind of physics with its force and its signs."""

import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, Literal, TypeAlias

from jaxtyping import Array

from iwanjax.discrepancy.nested import TURNED, WRONG_SIGN, Nested
from iwanjax.errors import InputError
from iwanjax.joints import JOINTS, Iwan4, ParameterInfo, described
from iwanjax.joints.force_law import AbstractForceLaw, NestedLaw, PlaceMotion, Scales
from iwanjax.joints.iwan4 import NEVER_SLIPPING, SLIDING_AT_ONCE


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
    """

    name: str
    usual: str
    law: type[AbstractForceLaw]
    signs: str = ""
    held: tuple[tuple[str, Any], ...] = ()
    variant: str = ""

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
    def limits(self) -> tuple[Nested, ...]:
        """Simpler kinds that it becomes at the ends of its shape's range.

        Where one of them does all but as well, that one is named.
        """
        return _nested(self.law.nested(**dict(self.held)))

    def shapes(self, seen: Scales) -> tuple[float, ...]:
        """Values of the shape to begin with."""
        return self.law.starts(seen)

    def unit_force(self, motion: PlaceMotion, shape: Array, memory: Array) -> tuple[Array, Array]:
        """Force that opposes a growing deflection, for size 1, and what the place remembers.

        Elementwise over places, one number of memory each.
        """
        return self.law.scaled(1.0, shape, **dict(self.held)).follow(motion, memory)

    def _infos(self) -> tuple[ParameterInfo, ...]:
        size, *shape = self.law.searched()
        return (replace(size, lower=-math.inf) if self.law.either_sign else size, *shape)


@dataclass(frozen=True)
class SensorKind:
    """One kind of fault of the measurement chain; it acts on what is predicted, not on the data.

    Parameters
    ----------
    name, usual, size, signs
        As for :class:`ForceKind`.
    acts : {"gain", "delay", "limit"}
        What is wrong with a sensor: a factor 1 + size, a delay in seconds, or the largest value
        that it shows.
    fixed : float, optional
        The size, where there is nothing to fit.
    positive : bool
        Whether a negative size means nothing.
    limits : tuple of Nested
        Simpler kinds that it becomes at one size: with nothing to fit.
    """

    name: str
    usual: str
    size: ParameterInfo
    signs: str
    acts: Literal["gain", "delay", "limit"]
    fixed: float | None = None
    positive: bool = False
    limits: tuple[Nested, ...] = ()


@dataclass(frozen=True)
class JointKind:
    """One kind of fault of the model's joints, or a joint too few.

    Parameters
    ----------
    name, usual, signs
        As for :class:`ForceKind`.
    parameters : tuple of ParameterInfo
        What is fitted.
    nested : tuple of NestedLaw
        Simpler laws that a joint becomes.
    """

    name: str
    usual: str
    parameters: tuple[ParameterInfo, ...]
    signs: str
    nested: tuple[NestedLaw, ...] = ()

    @property
    def limits(self) -> tuple[Nested, ...]:
        """As for :class:`ForceKind`."""
        return _nested(self.nested)


@dataclass(frozen=True)
class ModeKind:
    """One way in which a mode's own joint is not its own: what else moves it.

    Parameters
    ----------
    name, usual, size, signs
        As for :class:`ForceKind`.
    limits : tuple of Nested
        As for :class:`ForceKind`.
    """

    name: str
    usual: str
    size: ParameterInfo
    signs: str
    limits: tuple[Nested, ...] = ()
    # There is nothing about it beside its size.
    shape: ClassVar[None] = None


Kind: TypeAlias = ForceKind | SensorKind | JointKind | ModeKind


def _nested(laws: Iterable[NestedLaw]) -> tuple[Nested, ...]:
    """The kinds that nested laws are; a law that is no kind is no hypothesis either."""
    return tuple(
        Nested(kind.name, nested.narrowed, nested.widened)
        for nested in laws
        for kinds in catalogue().values()
        for kind in kinds
        if isinstance(kind, ForceKind) and kind.law is nested.law and not kind.variant
    )


_FAULTS: tuple[Kind, ...] = (
    SensorKind(
        "sensor_gain",
        "calibration of a sensor",
        ParameterInfo("gain_error", "1", "factor of the sensor less one"),
        "one sensor off by the same share at every frequency and amplitude",
        "gain",
        limits=(WRONG_SIGN,),
    ),
    SensorKind(
        "sensor_delay",
        "delay of a filter in one channel",
        ParameterInfo("delay", "time", "by which the sensor is late", 0.0),
        "one sensor whose phase lags in proportion to frequency",
        "delay",
        positive=True,
    ),
    SensorKind(
        "sensor_saturation",
        "overload of an amplifier",
        ParameterInfo("limit", "sensor", "largest value that the sensor shows", 0.0),
        "peaks of one sensor that are cut at one level",
        "limit",
    ),
    SensorKind(
        "sensor_polarity",
        "sensor mounted or wired the wrong way round",
        ParameterInfo("factor", "1", "factor of the sensor less one"),
        "one sensor with the opposite sign",
        "gain",
        fixed=TURNED,
    ),
    JointKind(
        "stiction",
        "static and kinetic friction that differ",
        (ParameterInfo("theta", "1", "kinetic over static friction", 0.0, upper=1.0),),
        "less damping after large amplitudes than the joint's growth would have it",
    ),
    JointKind(
        "joint_drift",
        "bolt loosening, wear-in, temperature",
        (
            ParameterInfo("F_S_change", "1", "of ln F_S from recording to recording"),
            ParameterInfo("K_T_change", "1", "of ln K_T from recording to recording"),
        ),
        "recordings that each want another strength of one joint",
    ),
    JointKind(
        "iwan_joint",
        "a joint left out",
        Iwan4.parameters,
        "microslip where no joint is",
        (SLIDING_AT_ONCE, NEVER_SLIPPING),
    ),
    ModeKind(
        "modal_coupling",
        "a joint that several modes move at once",
        ParameterInfo("ratio", "1", "the joint's deflection by the other mode over that by this"),
        "hits that differ at equal amplitude, the lower in frequency the more another mode moves",
    ),
)


@cache
def _of_law(registered: str, law: type[AbstractForceLaw]) -> tuple[Kind, ...]:
    """The kind that a law is, each of its variants."""
    name, usual, signs = law.effect or (registered, described(law).partition(":")[0], "")
    return tuple(ForceKind(name, usual, law, signs, v.held, v.words) for v in law.variants)


def _laws() -> dict[str, type[AbstractForceLaw]]:
    return {name: law for name, law in JOINTS.items() if issubclass(law, AbstractForceLaw)}


CATALOGUE: dict[str, tuple[Kind, ...]] = {
    **{law.effect.name: _of_law(name, law) for name, law in _laws().items() if law.effect},
    **{kind.name: (kind,) for kind in _FAULTS},
}
"""Kinds that have a name of their own, each with its variants; :func:`catalogue` has all."""


def catalogue() -> dict[str, tuple[Kind, ...]]:
    """All kinds by name: those of :data:`CATALOGUE`, and every other law that is a joint's type.

    Raises
    ------
    InputError
        Where a law was registered by the name of another kind.
    """
    found = dict(CATALOGUE)
    for registered, law in _laws().items():
        kinds = _of_law(registered, law)
        if found.setdefault(kinds[0].name, kinds) != kinds:
            raise InputError(
                f"hypotheses: {kinds[0].name!r} is a kind of the catalogue; register "
                f"{law.__name__} under another name"
            )
    return found


def shipped(kind: ForceKind) -> bool:
    """Whether a kind's law is one of the package's own."""
    return kind.law.__module__.startswith("iwanjax.")


def kinds_of(names: tuple[str, ...] = ()) -> tuple[Kind, ...]:
    """The kinds of these names; for none all but laws that are only tried when asked for.

    Raises
    ------
    InputError
        For an unknown name, with the nearest known one.
    """
    known = catalogue()
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
            raise InputError(f"hypotheses: {name!r} is unknown; {hint}")
    if names:
        return tuple(kind for name in names for kind in known[name])
    return tuple(
        kind
        for kinds in known.values()
        for kind in kinds
        if not isinstance(kind, ForceKind) or kind.law.tried
    )
