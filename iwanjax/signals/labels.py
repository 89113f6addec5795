"""What stands beside the arrays of a recording: names of channels, units, rate, remarks."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from iwanjax.files import Node

CHANNEL_NAMES = ("channels", "channel_names", "sensors", "sensor_labels", "labels")
INPUT_NAMES = ("inputs", "input_names", "input_labels")
UNITS = ("units", "unit", "channel_units")

_RATE = re.compile(r"(sampl(e|ing)[ _]*(rate|freq(uency)?)|fs)([ _(]*hz\)?)?", re.IGNORECASE)
_STEP = re.compile(r"(dt|delta[ _]?t|time[ _]?step|sample[ _]?time)([ _(]*s\)?)?", re.IGNORECASE)


def rate_of(name: str, value: float) -> float | None:
    """Hz, if a number of this name is a sampling rate or a time step; else None."""
    if not 0.0 < value < np.inf:
        return None
    if _RATE.fullmatch(name):
        return float(value)
    return float(1.0 / value) if _STEP.fullmatch(name) else None


def rate_beside(fields: Mapping[str, Node]) -> float | None:
    """Hz, of the first single number that is a sampling rate or a time step."""
    for name, node in fields.items():
        if isinstance(node, np.ndarray) and node.dtype.kind in "iuf" and node.size == 1:
            rate = rate_of(name, float(node.ravel()[0]))
            if rate is not None:
                return rate
    return None


def texts_beside(fields: Mapping[str, Node], names: Sequence[str], count: int) -> list[str] | None:
    """The first of some arrays of text that has an entry for each of so many columns."""
    for name in names:
        texts = _texts(fields.get(name))
        if len(texts) == count and all(texts):
            return texts
    return None


def remarks(fields: Mapping[str, Node]) -> dict[str, str]:
    """Single texts by name."""
    texts = {name: _texts(node) for name, node in fields.items()}
    return {name: found[0] for name, found in texts.items() if len(found) == 1 and found[0]}


def _texts(node: Any) -> list[str]:
    """An array or a cell of text as a list; of anything else nothing."""
    if not isinstance(node, np.ndarray):
        return []
    if node.dtype.kind == "U":
        return [str(text).strip() for text in node.flat]
    if node.dtype.kind == "O":
        inner = [_texts(entry) for entry in node.flat]
        return [text for texts in inner for text in texts] if all(map(len, inner)) else []
    return []
