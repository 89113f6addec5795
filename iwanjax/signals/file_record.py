"""One recording as a file holds it: named arrays, and what the file says of each."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from iwanjax.files import Node
from iwanjax.signals.recording import Channel

# acc1 (m/s^2), Force [N]; a number in brackets counts columns.
_BRACKETED = re.compile(r".*[^\s([]\s*[(\[]\s*(?!\d+[)\]])([^()\[\]]+?)\s*[)\]]")
# Spaces, dots and powers are written in many ways.
_SPELLING = str.maketrans({"²": "2", "µ": "u", "μ": "u", "^": None, "*": None, " ": None})
_OF_UNIT = {
    "acceleration": r"(mm|cm|m|in|ft)/(s2|s/s|sec2)|mm/s/s|[gG]|m[gG]|gn",
    "velocity": r"(um|mm|cm|m|in|ft|i)/(s|sec)|ips",
    "displacement": r"nm|um|mm|cm|m|in|inch|ft|mil",
    "force": r"[mkM]?N|kp|kgf|lbf?|kip|kips",
}


@dataclass(frozen=True, eq=False)
class FileRecord:
    """Named arrays of one recording in a file.

    Attributes
    ----------
    arrays : dict of str to Node
        In the order of the file; a time axis is one of them where the file holds it.
    channels : dict of str to Channel
        What the file says of an array: quantity, unit and direction.
    sampling_rate : float or None
        Hz, where the file says it beside, or instead of, a time axis.
    metadata : dict of str to str
        What else the file says: date, operator, rig.
    name : str
        Of the group or segment in the file; empty where it has none.
    """

    arrays: Mapping[str, Node]
    channels: Mapping[str, Channel] = field(default_factory=dict)
    sampling_rate: float | None = None
    metadata: Mapping[str, str] = field(default_factory=dict)
    name: str = ""


def quantity_of(unit: str) -> str:
    """What is measured in a unit; empty where it is none of a motion or a force."""
    spelt = unit.strip().translate(_SPELLING).replace("sec", "s").replace("s**2", "s2")
    return next((name for name, form in _OF_UNIT.items() if re.fullmatch(form, spelt)), "")


def channel_of(name: str, unit: str = "", direction: str = "") -> Channel:
    """A channel by its name and unit; a unit in brackets at the name's end counts as well."""
    if not unit and (found := _BRACKETED.fullmatch(name)):
        unit = found[1]
    return Channel(name, quantity_of(unit), unit, direction)


def numbered(names: list[str]) -> list[str]:
    """The names, those that are there already with a number: a, b, a (2)."""
    found: list[str] = []
    for name in names:
        count = 1
        while (label := name if count == 1 else f"{name} ({count})") in found:
            count += 1
        found.append(label)
    return found
