"""The ``qsma:`` section."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, TypeAdapter, WrapValidator, model_validator

from iwanjax.config.faults import fault
from iwanjax.config.section import CONFIG, ConfigSection, Index, OneOrMore


class _Range(ConfigSection):
    start: Annotated[float, Field(alias="from", gt=0)]
    to: float
    count: Annotated[int, Field(ge=2, le=100_000)]


def _row(raw: Any, validate: Callable[[Any], tuple[float, ...]]) -> tuple[float, ...]:
    """Levels from a list of them or from a range."""
    if isinstance(raw, Mapping):
        ends = _Range.model_validate(raw)
        if ends.to <= ends.start:
            raise fault(f"got {ends.to:g}; expected more than from = {ends.start:g}", "to")
        return tuple(np.geomspace(ends.start, ends.to, ends.count).tolist())
    levels = validate(raw)
    for i, (low, high) in enumerate(pairwise((0.0, *levels))):
        if high <= low:
            raise fault(f"got {high:g}; expected positive levels that rise, here above {low:g}", i)
    return levels


def _rows(raw: Any, validate: Callable[[Any], Any]) -> tuple[tuple[float, ...], ...]:
    """A row of levels for each mode, or a single one for all."""
    if isinstance(raw, list) and any(isinstance(entry, Mapping | list) for entry in raw):
        return validate(raw)
    return (_ONE_ROW.validate_python(raw),)


_Row = Annotated[tuple[float, ...], Field(min_length=1), WrapValidator(_row)]
_ONE_ROW = TypeAdapter(_Row, config=CONFIG)


class QsmaSettings(ConfigSection):
    """The ``qsma:`` section: what :func:`iwanjax.qsma` is asked for.

    Attributes
    ----------
    modes : tuple of int
        Indices among the elastic modes, lowest first.
    alpha : tuple of tuple of float
        Load levels, from numbers or a geometric range {from, to, count}: one row for all
        modes or one each; see :attr:`levels`.
    zeta0 : tuple of float or None
        Background damping ratio, one for all modes or one each; None takes the structure's C.
    frequency : {"secant", "first_harmonic"}
        Which frequency a level has.
    shape : {"linear", "updated"}
        In which shape the structure is loaded.
    """

    modes: Annotated[tuple[Index, ...], Field(min_length=1)] = (0,)
    alpha: Annotated[tuple[_Row, ...], WrapValidator(_rows)]
    zeta0: Annotated[tuple[Annotated[float, Field(ge=0)], ...] | None, OneOrMore] = None
    frequency: Literal["secant", "first_harmonic"] = "secant"
    shape: Literal["linear", "updated"] = "linear"

    @property
    def levels(self) -> np.ndarray:
        """Load levels, (modes, levels), force/mass^(1/2)."""
        return np.broadcast_to(self.alpha, (len(self.modes), len(self.alpha[0])))

    @property
    def damping(self) -> np.ndarray | None:
        """Background damping ratio of each mode, (modes,), or None."""
        return None if self.zeta0 is None else np.broadcast_to(self.zeta0, (len(self.modes),))

    @model_validator(mode="after")
    def _one_for_each_mode(self) -> Self:
        count = len(self.modes)
        if len(set(self.modes)) < count:
            raise fault("holds a mode twice; expected each once", "modes")
        for key, what, given in (
            ("alpha", "sets of levels", self.alpha),
            ("zeta0", "numbers", self.zeta0),
        ):
            if given is not None and len(given) not in (1, count):
                raise fault(
                    f"got {len(given)} {what} for {count} mode(s); expected one for all or one "
                    "each",
                    key,
                )
        lengths = [str(len(row)) for row in self.alpha]
        if len(set(lengths)) > 1:
            raise fault(
                f"got {' and '.join(lengths)} levels; expected as many for every mode", "alpha"
            )
        return self
