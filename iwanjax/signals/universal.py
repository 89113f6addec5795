"""Universal files: time responses in data sets 58 and 58b, by pyuff (extra ``io``).

Format of the data set: SDRC universal file, data set 58 "function at nodal DOF". Most analysers
write it (.uff, .unv), Simcenter Test.Lab among them.
"""

import enum
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from iwanjax.errors import InputError, missing_library
from iwanjax.signals.file_record import FileRecord, quantity_of
from iwanjax.signals.recording import Channel


class _Code(enum.IntEnum):
    """Numbers of the format that decide what is read."""

    DATA_SET = 58
    # Field 1 of record 8: what the abscissa is.
    TIME = 17


class _Ordinate(enum.IntEnum):
    """Field 1 of record 9: what was measured."""

    DISPLACEMENT = 8
    REACTION_FORCE = 9
    VELOCITY = 11
    ACCELERATION = 12
    EXCITATION_FORCE = 13


# Field 1 of record 6, by its number.
_FUNCTIONS = (
    "general function",
    "time response",
    "auto spectrum",
    "cross spectrum",
    "frequency response function",
    "transmissibility",
    "coherence",
)
_GENERAL, _TIME_RESPONSE, *_ = range(len(_FUNCTIONS))
# Field 7 of record 6, by its magnitude.
_AXES = ("", "x", "y", "z", "rx", "ry", "rz")


def read_universal(path: Path) -> list[FileRecord]:
    """Time responses of a universal file; each run of channels of other names is a recording.

    Raises
    ------
    InputError
        Where pyuff is not installed, and for a file that is cut short, damaged or without a
        time response, not naming the file.
    """
    pyuff = _pyuff()
    content = path.read_bytes().rstrip()
    if b"    -1" not in content[:512]:
        raise InputError("is no universal file: no line '    -1' begins it; export it again")
    if not content.endswith(b"    -1"):
        raise InputError("the last data set does not end with '    -1'; is the file cut short?")
    file = pyuff.UFF(str(path))
    kinds = [int(kind) for kind in np.atleast_1d(file.get_set_types())]
    functions = [file.read_sets(i) for i, kind in enumerate(kinds) if kind == _Code.DATA_SET]
    found = [each for each in functions if _is_history(each)]
    if not found:
        raise InputError(f"no time response; found {_told(kinds, functions)}")
    runs: list[dict[str, Any]] = []
    for each in found:
        name, grid = _name(each), _grid(each)
        if not runs or name in runs[-1]["sets"] or grid != runs[-1]["grid"]:
            runs.append({"grid": grid, "sets": {}})
        runs[-1]["sets"][name] = each
    return [_record(run["sets"]) for run in runs]


def _pyuff() -> ModuleType:
    try:
        import pyuff
    except ImportError:
        raise missing_library("universal files", "pyuff", "io") from None
    return pyuff


def _is_history(held: dict[str, Any]) -> bool:
    """Whether a function is real and of time."""
    of_time = held["func_type"] == _TIME_RESPONSE or (
        held["func_type"] == _GENERAL and held["abscissa_spec_data_type"] == _Code.TIME
    )
    return of_time and not np.iscomplexobj(held["data"])


def _told(kinds: list[int], functions: list[dict[str, Any]]) -> str:
    """What a file without time responses holds."""
    told = [
        f"{count} x {_FUNCTIONS[kind] if kind < len(_FUNCTIONS) else f'function of type {kind}'}"
        for kind, count in Counter(each["func_type"] for each in functions).items()
    ]
    others = sorted(set(kinds) - {int(_Code.DATA_SET)})
    told += [f"data sets {', '.join(map(str, others))}"] if others else []
    return "; ".join(told) or "no data set"


def _grid(held: dict[str, Any]) -> tuple[float, ...]:
    """What recordings of one run share: number, beginning and step of the samples."""
    count = int(held["num_pts"])
    if len(held["data"]) < count:
        raise InputError(
            f"{_name(held)} has {len(held['data'])} of its {count} values; is the file cut short?"
        )
    if not held["abscissa_spacing"]:
        x = held["x"][:count]
        return (count, *map(float, x[[0, -1]])) if count else (0.0,)
    if not (count > 0 and 0.0 < held["abscissa_inc"] < np.inf):
        raise InputError(
            f"{_name(held)} has {count} values at steps of {held['abscissa_inc']:g} s; expected "
            "positive numbers"
        )
    return count, held["abscissa_min"], held["abscissa_inc"]


def _name(held: dict[str, Any]) -> str:
    """Entity, node and direction of the response, as Test.Lab writes them: wing:12:+Z."""
    entity, node, direction = (held[key] for key in ("rsp_ent_name", "rsp_node", "rsp_dir"))
    parts = [entity if entity not in ("NONE", "") else ""]
    parts += [str(node) if node else "", _direction(direction).upper()]
    return ":".join(filter(None, parts)) or str(held["id1"]).strip() or "channel"


def _direction(number: int) -> str:
    axis = _AXES[abs(number)] if abs(number) < len(_AXES) else ""
    return f"{'-' if number < 0 else '+'}{axis}" if axis else ""


def _channel(name: str, held: dict[str, Any]) -> Channel:
    unit = str(held["ordinate_axis_units_lab"]).strip()
    unit = "" if unit == "NONE" else unit
    known = {each.value: each.name.lower() for each in _Ordinate}
    measured = known.get(held["ordinate_spec_data_type"], "")
    quantity = "force" if measured.endswith("_force") else measured
    return Channel(name, quantity or quantity_of(unit), unit, _direction(held["rsp_dir"]))


def _record(sets: dict[str, dict[str, Any]]) -> FileRecord:
    first = next(iter(sets.values()))
    count, even = int(first["num_pts"]), bool(first["abscissa_spacing"])
    grid = first["abscissa_min"] + first["abscissa_inc"] * np.arange(count)
    time = grid if even else first["x"][:count]
    lines = {f"id{i}": str(first[f"id{i}"]).strip() for i in range(1, 6)}
    return FileRecord(
        {"time": time, **{name: held["data"][:count] for name, held in sets.items()}},
        {name: _channel(name, held) for name, held in sets.items()},
        metadata={key: line for key, line in lines.items() if line not in ("", "NONE")},
    )
