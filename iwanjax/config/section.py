"""What the sections of a study file are made of."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    TypeAdapter,
    model_validator,
)

from iwanjax.config.faults import fault, one_of

CONFIG = ConfigDict(frozen=True, allow_inf_nan=False)


class ConfigSection(BaseModel):
    """A mapping that rejects unknown keys before anything else is complained of."""

    model_config = CONFIG

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, raw: Any) -> Any:
        keys = [field.alias or name for name, field in cls.model_fields.items()]
        for key in raw if isinstance(raw, Mapping) else ():
            if key not in keys:
                raise fault(f"unknown key; {one_of(key, keys)}", key)
        return raw


def _pair(raw: Any) -> tuple[float, float]:
    """Two numbers that rise."""
    ends = _NUMBERS.validate_python(raw)
    if len(ends) != 2:
        raise fault(f"got {len(ends)} number(s); expected two, [lower, upper]")
    low, high = ends
    if high <= low:
        raise fault(f"got {high:g}; expected more than the lower end {low:g}", 1)
    return low, high


def _band(raw: Any) -> tuple[float, float]:
    """Two positive numbers that rise."""
    low, high = _pair(raw)
    if low <= 0.0:
        raise fault(f"got {low:g}; expected a positive frequency, Hz", 0)
    return low, high


def _offset(raw: Any) -> Literal["mean"] | tuple[float, ...]:
    """``mean``, or one number for each channel; a single one may stand alone."""
    if raw == "mean":
        return "mean"
    if isinstance(raw, str):
        raw = [raw]
    return _NUMBERS.validate_python(raw if isinstance(raw, list) else [raw])


_NUMBERS = TypeAdapter(tuple[float, ...], config=CONFIG)

OneOrMore = BeforeValidator(lambda raw: [raw] if isinstance(raw, str | int | float) else raw)
"""For lists that a single entry may stand for."""
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Index = Annotated[int, Field(ge=0)]
Pair = Annotated[tuple[float, float], PlainValidator(_pair)]
Band = Annotated[tuple[float, float], PlainValidator(_band)]
Offset = Annotated[Literal["mean"] | tuple[float, ...], PlainValidator(_offset)]
"""What channels show where nothing moves or acts."""
