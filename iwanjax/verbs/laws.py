"""The verb ``laws``: every law that a study's joints may have, or a diagnosis may find missing."""

from iwanjax.effects.catalogue import catalogue
from iwanjax.effects.kinds import ForceKind
from iwanjax.joints import (
    JOINTS,
    AbstractJoint,
    AttachedOscillator,
    Iwan4,
    Iwan5,
    UnnamedLaw,
    described,
)
from iwanjax.tables import Grid, as_text

_HEADER = ("type", "parameters", "found as", "what it is")
# Joints that are found by fits of their own, not as a force of one size.
_OTHERS: dict[type[AbstractJoint], str] = {
    Iwan4: "iwan_joint",
    Iwan5: "stiction",
    AttachedOscillator: "(attached_oscillator)",
    UnnamedLaw: "unnamed_law",
}
_NOTE = "In brackets: tried where all others leave more than noise (of curves: where named)."


def run() -> str:
    """A table of names, parameters with units, names in a diagnosis and descriptions."""
    found = _OTHERS | {
        kind.law: kind.name if kind.law.tried else f"({kind.name})"
        for kinds in catalogue().values()
        for kind in kinds
        if isinstance(kind, ForceKind)
    }
    rows = (
        (name, _parameters(law), found.get(law, ""), described(law)) for name, law in JOINTS.items()
    )
    return as_text([Grid(_HEADER, tuple(rows)), _NOTE])


def _parameters(law: type[AbstractJoint]) -> str:
    if issubclass(law, UnnamedLaw):
        return "file: of a law saved by a diagnosis"
    return ", ".join(f"{info.name} [{info.dimension}]" for info in law.parameters)
