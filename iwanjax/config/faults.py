"""What is wrong with a value, in words: what arrived, what was expected, what was meant."""

import re
from collections.abc import Iterable

from pydantic_core import ErrorDetails, PydanticCustomError

from iwanjax.files import nearest

_EXPECTED = {
    "float_parsing": "a number, without unit",
    "float_type": "a number",
    "int_parsing": "a whole number",
    "int_type": "a whole number",
    "string_type": "text",
    "tuple_type": "a list",
    "dict_type": "a mapping, key: value",
    "model_type": "a mapping, key: value",
    "too_short": "at least one entry",
}
_MOST_SHOWN = 20
_EXAMPLES = {
    "name": "name: my_study",
    "model": "model: {builder: three_mass}",
    "type": "type: iwan4",
    "parameters": "parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}",
    "count": "count: 50",
    "file": "file: rec1.npz",
    "band": "band: [90, 150]",
    "joint": "joint: {type: iwan4}",
    "alpha": "alpha: [{from: 1e-2, to: 1e+2, count: 50}]",
}


def fault(message: str, key: str | int | None = None) -> PydanticCustomError:
    """A fault of a section, or of one key in it, told in our own words."""
    return PydanticCustomError("fault", "{message}", {"message": message, "key": key})


def told(details: ErrorDetails, arrived: str) -> str:
    """A fault that pydantic found, as a sentence."""
    kind, message = details["type"], details["msg"]
    if kind == "fault":
        return message
    name = str(details["loc"][-1]) if details["loc"] else ""
    if kind == "missing":
        return f"{name!r} is missing; add for instance {_EXAMPLES.get(name, f'{name}: 1.0')}"
    if kind == "literal_error":
        expected = details.get("ctx", {})["expected"]
        hint = nearest(str(details["input"]), re.findall(r"'([^']*)'", expected))
        return f"got {arrived}; expected {expected}{hint}"
    if kind not in _EXPECTED:
        return f"got {arrived}; {message.replace('Input should', 'it should')}"
    example = f", for instance {_EXAMPLES[name]}" if name in _EXAMPLES else ""
    return f"got {arrived}; expected {_EXPECTED[kind]}{example}"


def one_of(name: str, known: Iterable[str]) -> str:
    """What is known where ``name`` is not, and what it may have been meant for."""
    names = list(known)
    shown = ", ".join(names[:_MOST_SHOWN]) + (", ..." if len(names) > _MOST_SHOWN else "")
    return f"expected one of {shown or 'none'}{nearest(name, names)}"
