"""The verb ``laws``: every law that a study's joints may have, or a diagnosis may find missing."""

from iwanjax.discrepancy.effects import ForceKind, catalogue
from iwanjax.joints import JOINTS, AbstractJoint, described
from iwanjax.tables import Grid, as_text

_HEADER = ("type", "parameters", "found as", "what it is")


def run() -> str:
    """A table of names, parameters with units, names in a diagnosis and descriptions.

    In brackets what a diagnosis tries only when asked for it.
    """
    found: dict[type[AbstractJoint], str] = {
        kind.law: kind.name if kind.law.tried else f"({kind.name})"
        for kinds in catalogue().values()
        for kind in kinds
        if isinstance(kind, ForceKind)
    }
    rows = (
        (name, _parameters(law), found.get(law, ""), described(law)) for name, law in JOINTS.items()
    )
    return as_text([Grid(_HEADER, tuple(rows))])


def _parameters(law: type[AbstractJoint]) -> str:
    return ", ".join(f"{info.name} [{info.dimension}]" for info in law.parameters)
