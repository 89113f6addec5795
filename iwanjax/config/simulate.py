"""The ``simulate:`` section: what is integrated in time, and under which forces."""

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias, get_args

from pydantic import Field, PlainValidator, TypeAdapter, WrapValidator, model_validator

from iwanjax.config.faults import fault, one_of
from iwanjax.config.section import CONFIG, ConfigSection, Count, Index, OneOrMore, Positive
from iwanjax.dynamics.excitations import Sweep
from iwanjax.dynamics.integration import Quantity
from iwanjax.dynamics.propagator import Method
from iwanjax.dynamics.transient import ACCURACY
from iwanjax.joints.sliders import SLIDERS

# A mistaken dt or duration would ask for more than any memory holds.
_MOST_STEPS = 100_000_000
_KEEP: tuple[Quantity, ...] = get_args(Quantity)
# What means nothing for a joint that is driven on its own.
_OF_A_STRUCTURE = ("method", "sensors", "keep", "every", "substeps", "modes", "accuracy")

_FLOAT = TypeAdapter(float, config=CONFIG)
_ROW = TypeAdapter(tuple[float, ...], config=CONFIG)


class Ramp(ConfigSection):
    """An amplitude that changes on a straight line, then stays (thesis 4.23, 4.24, 4.42).

    Attributes
    ----------
    start, to : float
        At t = 0 and from ``duration`` on; ``start`` is called ``from`` in a file.
    duration : float
        s.
    """

    start: Annotated[float, Field(alias="from")]
    to: float
    duration: Positive


def _amplitude(raw: Any) -> float | Ramp:
    return Ramp.model_validate(raw) if isinstance(raw, Mapping) else _FLOAT.validate_python(raw)


def _direction(raw: Any) -> str | tuple[float, ...]:
    if isinstance(raw, str):
        return raw
    if not isinstance(raw, list):
        raise fault("expected a label, or a list of one number for each coordinate")
    return _ROW.validate_python(raw)


Amplitude = Annotated[float | Ramp, PlainValidator(_amplitude)]
"""A number, or a mapping {from, to, duration}."""
Direction = Annotated[str | tuple[float, ...], PlainValidator(_direction)]
"""A label, or a row of numbers."""


def _one_of(section: ConfigSection, *keys: str) -> None:
    """Refuse a section that has several of the keys, or none."""
    given = [key for key in keys if getattr(section, key) is not None]
    if len(given) != 1:
        got = " and ".join(given) or "neither"
        raise fault(f"got {got}; expected one of {' and '.join(keys)}")


class ModalImpact(ConfigSection):
    """A half sine that excites one linear mode alone (2.27)."""

    type: Literal["modal_impact"]
    mode: Index
    p: float
    limit: Literal["low", "high"] = "low"


class PointImpact(ConfigSection):
    """A half sine at one place (2.29), (4.43): of a circular frequency or a duration."""

    type: Literal["point_impact"]
    input: Direction
    p: float
    omega: Positive | None = None
    duration: Positive | None = None

    @property
    def circular(self) -> float:
        """Of the whole sine, rad/s."""
        return self.omega or math.pi / (self.duration or math.nan)

    @model_validator(mode="after")
    def _one_length(self) -> Self:
        _one_of(self, "omega", "duration")
        return self


class Sine(ConfigSection):
    """A sine at one place, its amplitude steady or ramped (4.40), (4.42)."""

    type: Literal["sine"]
    input: Direction
    amplitude: Amplitude
    frequency: Positive | None = None
    omega: Positive | None = None

    @property
    def circular(self) -> float:
        """rad/s."""
        return self.omega or 2.0 * math.pi * (self.frequency or math.nan)

    @model_validator(mode="after")
    def _one_frequency(self) -> Self:
        _one_of(self, "frequency", "omega")
        return self


class SweptSine(ConfigSection):
    """A sine of which the frequency moves through a band, Hz, over the whole case."""

    type: Literal["sweep"]
    input: Direction
    amplitude: Amplitude
    start: Annotated[float, Field(alias="from", gt=0)]
    to: Positive
    kind: Sweep = "linear"

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if self.start == self.to:
            raise fault(f"got {self.to:g} as from; expected another frequency", "to")
        return self


class RecordedForce(ConfigSection):
    """Forces of a recording, one for each label in ``input``."""

    type: Literal["recording"]
    file: str
    input: Annotated[tuple[str, ...], Field(min_length=1), OneOrMore]
    array: str | None = None
    variable: str | None = None
    index: Index | None = None
    sampling_rate: Positive | None = None


Excitation: TypeAlias = ModalImpact | PointImpact | Sine | SweptSine | RecordedForce
_KINDS: dict[str, type[ConfigSection]] = {
    "modal_impact": ModalImpact,
    "point_impact": PointImpact,
    "sine": Sine,
    "sweep": SweptSine,
    "recording": RecordedForce,
}


def _excitation(raw: Any) -> Any:
    kinds = ", ".join(_KINDS)
    if not isinstance(raw, Mapping):
        got = "nothing" if raw is None else repr(raw)
        raise fault(f"got {got}; expected a mapping with type: (one of {kinds})")
    if "type" not in raw:
        raise fault(f"'type' is missing; add type: and one of {kinds}")
    name = str(raw["type"])
    if name not in _KINDS:
        raise fault(f"got {name!r}; {one_of(name, _KINDS)}", "type")
    return _KINDS[name].model_validate(raw)


class Drive(ConfigSection):
    """One joint alone, its deflection a cosine of steady or ramped amplitude (4.23), (4.24).

    Attributes
    ----------
    joint : str or None
        May be left out where there is only one.
    amplitude : float or Ramp
        Length.
    frequency : float
        Hz.
    """

    joint: str | None = None
    amplitude: Amplitude
    frequency: Positive = 1.0


class SimulateSection(ConfigSection):
    """An entry of ``simulate:``: an excitation of the structure, or a joint driven on its own.

    Attributes
    ----------
    name : str
        What results call it.
    dt : float or None
        Time step, s; a recording has its own.
    duration : float or None
        s.
    samples : int or None
        Steps and one, instead of a duration; a recording has its own.
    method : {"exact", "newmark"}
        Of integration.
    every, substeps, modes, sliders, accuracy
        As for :func:`iwanjax.simulate`.
    values : dict of str to float
        Parameters of joints that differ from the model's in this case, as J1.theta.
    excitation : Excitation or None
        Force on the structure.
    drive : Drive or None
        A joint's deflection.
    sensors : tuple of str
        What is seen; the model's sensors, or else every coordinate.
    keep : tuple of str
        What is kept; everything unless told otherwise.
    """

    driven_keys: ClassVar[tuple[str, ...]] = _OF_A_STRUCTURE

    name: str
    dt: Positive | None = None
    duration: Positive | None = None
    samples: Annotated[int, Field(ge=2)] | None = None
    method: Method = "exact"
    every: Count = 1
    substeps: Count = 1
    modes: Count | None = None
    sliders: Annotated[int, Field(ge=3)] = SLIDERS
    accuracy: Positive | None = ACCURACY
    values: dict[str, float] = Field(default_factory=dict)
    excitation: Annotated[Excitation | None, PlainValidator(_excitation)] = None
    drive: Drive | None = None
    sensors: Annotated[tuple[str, ...], Field(min_length=1), OneOrMore] | None = None
    keep: Annotated[tuple[Quantity, ...], Field(min_length=1), OneOrMore] | None = None

    @property
    def recorded(self) -> bool:
        """Whether the forces, and so the time, come from a recording."""
        return isinstance(self.excitation, RecordedForce)

    @property
    def steps(self) -> int:
        """Time steps of a case that is not recorded."""
        if self.samples is not None:
            return self.samples - 1
        assert self.duration is not None
        assert self.dt is not None
        return round(self.duration / self.dt)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What is kept; the energy cannot be where modes are left out."""
        if self.keep is not None:
            return self.keep
        return tuple(name for name in _KEEP if self.modes is None or name != "energy")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _one_of(self, "excitation", "drive")
        if self.drive is not None:
            for key in self.driven_keys:
                if key in self.model_fields_set:
                    raise fault("means nothing for a joint that is driven on its own", key)
        if self.recorded:
            for key in ("dt", "duration", "samples"):
                if key in self.model_fields_set:
                    raise fault("the recording has its own; for shorter steps say substeps", key)
            return self
        if self.dt is None:
            raise fault("'dt' is missing; add for instance dt: 1e-3, the time step in s")
        _one_of(self, "duration", "samples")
        wanted = self.duration / self.dt if self.duration else (self.samples or 0) - 1
        if not 0.5 < wanted <= _MOST_STEPS:
            raise fault(
                f"got {wanted:.3g} steps of dt = {self.dt:g}; expected 1 to {_MOST_STEPS:.0e}",
                "samples" if self.duration is None else "duration",
            )
        if self.every > self.steps:
            raise fault(f"got {self.every}, but there are {self.steps} steps", "every")
        if self.modes is not None and self.keep is not None and "energy" in self.keep:
            raise fault("holds energy, which needs all modes; leave modes: out", "keep")
        return self


def _cases(raw: Any, validate: Callable[[Any], Any]) -> Any:
    return validate([raw] if isinstance(raw, Mapping) else raw)


SimulateSections = Annotated[
    tuple[SimulateSection, ...], Field(min_length=1), WrapValidator(_cases)
]
"""A list of cases, or one case."""
