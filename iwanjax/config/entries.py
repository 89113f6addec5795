"""A study's recordings held against their kind, the disk and the model."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from iwanjax.config.faults import one_of
from iwanjax.config.names import Names, known, once
from iwanjax.config.recordings import (
    Data,
    Kind,
    Measurement,
    Quantity,
    RecordingEntry,
    RecordingSection,
    ResponseSettings,
)
from iwanjax.config.section import ConfigSection
from iwanjax.config.source import Place, Source
from iwanjax.curves import ModalCurves
from iwanjax.files import nearest
from iwanjax.signals import ForceLoop, Recording
from iwanjax.structures.model_file import BASE

_HISTORIES = ("transient", "free_decay")
_EVERY = ("file", "kind", "use", "name")
_HISTORY = (
    *_EVERY,
    *("variable", "sampling_rate", "index", "response", "mode", "modes", "from", "to", "initial"),
)
_KEYS: dict[Kind, tuple[str, ...]] = {
    "transient": (*_HISTORY, "force"),
    "free_decay": _HISTORY,
    "curves": (*_EVERY, "response", "mode"),
    "response_control": (*_EVERY, "response", "mode", "levels"),
    "force_control": (*_EVERY, "response", "mode", "levels"),
    "loop": (*_EVERY, "joint", "sampling_rate", "response", "force", "channels"),
}
# What files call the attributes of a Measurement that are named otherwise.
_IN_FILES = {"start": "from", "end": "to"}
# Of a response that is an amplitude of one mode, not a time history.
_AMPLITUDE = ("sensors", "quantity", "unit")
# Of a history's force, and of a loop's deflection and force.
_ACTING = ("array", "inputs", "offset")
_DEFLECTION = ("channel", "quantity", "unit")
_LOADED = ("array", "unit")


def recording_entries(
    source: Source, sections: Sequence[RecordingSection], names: Names
) -> tuple[RecordingEntry, ...]:
    """Hold each entry of a file against its kind, the disk and the model."""
    return tuple(_entry(source, ("recordings", i), each, names) for i, each in enumerate(sections))


def measured_entries(
    source: Source, given: Sequence[Data | Measurement], names: Names
) -> tuple[RecordingEntry, ...]:
    """Hold recordings in memory against the model."""
    measurements = [each if isinstance(each, Measurement) else Measurement(each) for each in given]
    labels = [each.name or getattr(each.data, "name", "") or "recording" for each in measurements]
    found = []
    for i, (each, label) in enumerate(zip(measurements, labels, strict=True)):
        # Results go by name.
        name = label if labels.count(label) == 1 else f"{label}[{i}]"
        raw = _as_section(source, ("recordings", i), each, name, names)
        section = source.validated(RecordingSection, raw, ("recordings", i))
        found.append(_entry(source, ("recordings", i), section, names, each.data))
    return tuple(found)


def _as_section(
    source: Source, place: Place, given: Measurement, name: str, names: Names
) -> dict[str, Any]:
    """What a file would say of a recording in memory."""
    data = given.data
    said: dict[str, Any] = {"file": name, "name": name, "use": given.use}
    for key in ("mode", "joint", "start", "end", "initial"):
        if getattr(given, key) is not None:
            said[_IN_FILES.get(key, key)] = getattr(given, key)
    if "mode" in said:
        said["mode"] = str(said["mode"])
    if isinstance(data, Recording):
        said["kind"] = "free_decay" if data.force is None else "transient"
        if names.sensors is not None:
            said["response"] = {"sensors": [channel.name for channel in data.channels]}
        if data.force is not None:
            said["force"] = {"inputs": [channel.name for channel in data.inputs]}
    elif isinstance(data, ModalCurves | ForceLoop):
        said["kind"] = "curves" if isinstance(data, ModalCurves) else "loop"
    else:
        raise source.error(
            place,
            f"got a {type(data).__name__}; expected a Recording (as_recording makes one of arrays "
            "and tables), ModalCurves, a ForceLoop, or a Measurement of one of these",
        )
    return said


def history_entry(source: Source, place: Place, section: RecordingSection) -> RecordingEntry:
    """A time history that a model is to be identified from, whose channels may have any names."""
    if section.kind not in _HISTORIES:
        raise source.error(
            (*place, "kind"), f"got {section.kind}; expected one of {', '.join(_HISTORIES)}"
        )
    return _entry(source, place, section, Names())


def _entry(
    source: Source, place: Place, section: RecordingSection, names: Names, data: Data | None = None
) -> RecordingEntry:
    _refuse_foreign(source, place, section)
    path = existing(source, (*place, "file"), section.file) if data is None else None
    if section.kind in _HISTORIES:
        _check_history(source, place, section, data)
    response = _response(source, (*place, "response"), section, names)
    for j, label in enumerate(section.force.inputs if section.force else ()):
        if label == BASE and BASE not in (names.inputs or (BASE,)):
            raise source.error(
                (*place, "force", "inputs", j),
                "the model has no input 'base', the acceleration of the ground; add it to the "
                "model's input_labels, and to input_rows -M r, with r the motion of the "
                "coordinates when the ground moves by 1 and nothing deforms",
            )
        known(source, (*place, "force", "inputs", j), label, names.inputs, "input")
    for key, given in (("levels", section.levels), ("channels", section.channels)):
        once(source, (*place, key), given or ())
    return RecordingEntry(
        path=path,
        kind=section.kind,
        use=section.use,
        name=section.name or Path(section.file).name,
        place=source.told(place),
        modes=_modes(source, place, section, names),
        response=response,
        force=section.force,
        variable=section.variable,
        sampling_rate=section.sampling_rate,
        index=section.index,
        levels=section.levels,
        joint=_joint(source, place, section, names),
        channels=section.channels,
        start=section.start,
        end=section.end,
        initial=section.initial,
        places={
            file_key: source.told((*place, _key(source, key)))
            for key, file_key in _IN_FILES.items()
        },
        data=data,
    )


def _refuse_foreign(source: Source, place: Place, section: RecordingSection) -> None:
    """Refuse keys that mean nothing for the entry's kind."""
    keys = _KEYS[section.kind]
    for key in _given(section):
        if key not in keys:
            raise source.error(
                (*place, key),
                f"does not belong to kind {section.kind}; expected one of {', '.join(keys)}",
            )
    looped = section.kind == "loop"
    parts: list[tuple[str, ConfigSection, tuple[str, ...]]] = []
    if section.force is not None:
        parts.append(("force", section.force, _LOADED if looped else _ACTING))
    if section.kind not in _HISTORIES:
        parts.append(("response", section.response, _DEFLECTION if looped else _AMPLITUDE))
    for part, said, expected in parts:
        for key in _given(said):
            if key not in expected:
                raise source.error(
                    (*place, part, key),
                    f"does not belong to kind {section.kind}; expected one of "
                    f"{', '.join(expected)}",
                )
    if section.kind in _HISTORIES:
        return
    if len(section.response.sensors) > 1:
        raise source.error(
            (*place, "response", "sensors"),
            f"got {len(section.response.sensors)} sensors; expected one: {section.kind} are "
            "against one amplitude",
        )


def _given(section: ConfigSection) -> list[str]:
    """Keys of a section that the file has."""
    fields = type(section).model_fields.items()
    return [field.alias or name for name, field in fields if name in section.model_fields_set]


def _key(source: Source, attribute: str) -> str:
    """What messages call an attribute: as the file does, or as Python does."""
    return attribute if source.path is None else _IN_FILES.get(attribute, attribute)


def existing(source: Source, place: Place, file: str) -> Path:
    """The path of a file that is there, relative to the study's folder."""
    path = source.folder / file
    if path.is_file():
        return path
    if path.is_dir():
        raise source.error(place, f"{path} is a folder; expected a file")
    folder = path.parent
    beside = [each.name for each in folder.iterdir()] if folder.is_dir() else []
    raise source.error(
        place,
        f"{path} does not exist; expected a file, relative to the study's folder"
        f"{nearest(path.name, beside)}",
    )


def _check_history(
    source: Source, place: Place, section: RecordingSection, data: Data | None
) -> None:
    """Hold the keys of a time history against each other."""
    if section.index is not None:
        once(source, (*place, "index"), section.index)
    if section.start is not None and section.end is not None and section.end <= section.start:
        start, end = (_key(source, each) for each in ("start", "end"))
        raise source.error(
            (*place, end), f"got {section.end:g}; expected more than {start} = {section.start:g}"
        )
    if section.kind == "free_decay" and section.initial not in (None, "unknown"):
        raise source.error(
            (*place, "initial"), f"got {section.initial}; a free decay begins in an unknown state"
        )
    if data is not None:  # which says what its channels measure
        return
    response = section.response
    # Names of channels may tell the quantity; those of arrays and sensors are not counted upon.
    unnamed = response.channel is None and not response.channels
    if response.quantity is None and unnamed and (response.array or response.sensors):
        kinds = ", ".join(get_args(Quantity))
        raise source.error(
            (*place, "response"), f"'quantity' is missing; add quantity: and one of {kinds}"
        )


def _response(
    source: Source, place: Place, section: RecordingSection, names: Names
) -> ResponseSettings:
    """The response with all its channels in one place."""
    response = section.response
    if response.channel is not None:
        if response.channels:
            raise source.error(
                (*place, "channels"), "got both channel and channels; expected one of them"
            )
        response = response.model_copy(update={"channels": (response.channel,)})
    for key, labels in (("channels", response.channels), ("sensors", response.sensors)):
        once(source, (*place, key), labels)
    if response.channels and response.sensors and len(response.channels) != len(response.sensors):
        raise source.error(
            (*place, "sensors"),
            f"got {len(response.sensors)} for {len(response.channels)} channel(s); expected one "
            "each",
        )
    for j, label in enumerate(response.sensors):
        known(source, (*place, "sensors", j), label, names.sensors, "sensor")
    return response


def _modes(
    source: Source, place: Place, section: RecordingSection, names: Names
) -> tuple[str | int, ...]:
    """What the entry tells of, in full."""
    if section.mode is not None and section.modes is not None:
        raise source.error((*place, "modes"), "got both mode and modes; expected one of them")
    if section.mode is not None:
        return (names.mode(source, (*place, "mode"), section.mode),)
    if section.modes is not None:
        found = tuple(
            names.mode(source, (*place, "modes", j), each) for j, each in enumerate(section.modes)
        )
        once(source, (*place, "modes"), found)
        return found
    if section.kind == "loop":
        return ()
    if section.kind in _HISTORIES:
        return names.modes
    if len(names.modes) != 1:
        raise source.error(
            place,
            f"'mode' is missing; {section.kind} are of one mode: add mode: and one of "
            f"{', '.join(map(str, names.modes))}",
        )
    return names.modes


def _joint(source: Source, place: Place, section: RecordingSection, names: Names) -> str | None:
    """Whose loop it is; of a joint on its own any name goes where there is no structure."""
    if section.kind != "loop" or names.modal:
        return section.joint
    if section.joint is not None:
        return known(source, (*place, "joint"), section.joint, names.joints, "joint")
    if len(names.joints) != 1:
        raise source.error(
            place, f"'joint' is missing; whose loop is it? {one_of('', names.joints)}"
        )
    return names.joints[0]
