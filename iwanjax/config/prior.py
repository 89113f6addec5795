"""Priors by name, with the fields of their own classes."""

import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import PlainValidator, create_model

from iwanjax.config.faults import fault, one_of
from iwanjax.config.section import ConfigSection
from iwanjax.errors import InputError

if TYPE_CHECKING:
    from iwanjax.estimation import AbstractPrior


def _prior(raw: Any) -> "AbstractPrior":
    # Here, because what else comes with it takes a second to import.
    from iwanjax.estimation import PRIORS, AbstractPrior

    if isinstance(raw, AbstractPrior):
        return raw
    kinds = ", ".join(PRIORS)
    if not isinstance(raw, Mapping):
        got = "nothing" if raw is None else repr(raw)
        raise fault(f"got {got}; expected a mapping with type: (one of {kinds}) and its numbers")
    if "type" not in raw:
        raise fault(f"'type' is missing; add type: and one of {kinds}")
    name = raw["type"]
    if name not in PRIORS:
        raise fault(f"got {name!r}; {one_of(str(name), PRIORS)}", "type")
    kind = PRIORS[name]
    fields: dict[str, Any] = dict.fromkeys(inspect.signature(kind).parameters, (float, ...))
    section = create_model("_PriorSection", __base__=ConfigSection, type=(str, ...), **fields)
    numbers = section.model_validate(raw).model_dump(exclude={"type"})
    try:
        return kind(**numbers)
    except InputError as error:
        raise fault(str(error)) from None


Prior = Annotated[Any, PlainValidator(_prior)]
"""An entry of ``priors:``, as the object of the library."""
