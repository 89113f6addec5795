"""Plain words for what may be missing: "A cubic spring is missing between m5 and m6"."""

import math
from collections.abc import Iterable, Mapping

from iwanjax.effects.estimate import Estimate
from iwanjax.effects.kinds import ForceKind, Kind

# Of each kind: a noun, and a sentence with its place, where that is not "... is missing".
_NOUNS: Mapping[str, str] = {
    "stiffness_error": "a linear spring",
    "mass_error": "a mass",
    "viscous_damping": "a viscous damper",
    "cubic_stiffness": "a cubic spring",
    "quadratic_stiffness": "a quadratic spring",
    "gap_contact": "a gap",
    "bilinear_stiffness": "a bilinear spring",
    "coulomb_friction": "dry friction",
    "iwan_joint": "a joint",
    "tanh_spring": "a softening spring",
    "bouc_wen": "a Bouc-Wen element",
    "backlash": "a slider with a dead band",
    "quadratic_damping": "quadratic damping (drag)",
    "viscoelastic": "a viscoelastic element (Maxwell)",
    "stiction": "static friction above the kinetic one",
    "joint_drift": "a change from recording to recording",
    "modal_coupling": "another mode that moves the joint",
    "sensor_gain": "a wrong gain",
    "sensor_delay": "a delay",
    "sensor_saturation": "saturation",
    "sensor_polarity": "a wrong sign",
}
_SENTENCES: Mapping[str, str] = {
    "stiction": "Joint {} has more static than kinetic friction",
    "joint_drift": "Joint {} changes from recording to recording",
    "modal_coupling": "The joint of {} is moved by another mode as well",
    "sensor_gain": "Sensor {} has a wrong gain",
    "sensor_delay": "Sensor {} is late",
    "sensor_saturation": "Sensor {} saturates",
    "sensor_polarity": "Sensor {} has the wrong sign",
}
# Relative error from which on it is told as a multiple of what was measured.
_MANIFOLD = 10.0


def noun(kind: Kind, where: str) -> str:
    """For instance "a gap between m5 and m6"."""
    return f"{_NOUNS.get(kind.name, kind.usual)} {place(where)}"


def sentence(kind: Kind, where: str) -> str:
    """For instance "A cubic spring is missing between m5 and m6", without its full stop."""
    if kind.name in _SENTENCES:
        return _SENTENCES[kind.name].format(where)
    name = _NOUNS.get(kind.name, kind.usual)
    held = f", {kind.variant}" if isinstance(kind, ForceKind) and kind.within else ""
    return f"{name[:1].upper()}{name[1:]} is missing {place(where)}{held}"


def place(where: str) -> str:
    """Between m5 and m6 for m5-m6, between m1 and ground, else at J1."""
    ends = where.split("-")
    return f"between {ends[0]} and {ends[1]}" if len(ends) == 2 and all(ends) else f"at {where}"


def sizes(parameters: Iterable[Estimate]) -> str:
    """For instance "k3 = 2.5e+12 ± 1e+10 force/length^3"."""
    return ", ".join(
        f"{p.info.name} = {p.value:.4g}"
        + (f" ± {p.std:.2g}" if math.isfinite(p.std) else "")
        + (f" {p.info.dimension}" if p.info.dimension not in ("", "1") else "")
        for p in parameters
    )


def share(error: float) -> str:
    """A relative error in per cent; as a multiple where it is many times what was measured."""
    if math.isnan(error):
        return "an unknown error"
    if not math.isfinite(error):
        return "no finite error"
    return f"{error:.3g} times the signal" if error > _MANIFOLD else f"{100.0 * error:.3g} %"
