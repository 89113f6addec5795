"""The catalogue: every law and fault that may be missing, by the name that results give it."""

import difflib
from collections.abc import Iterable, Sequence
from functools import cache
from typing import TypeGuard

from iwanjax.effects import (
    force_delay,
    force_gain,
    force_saturation,
    sensor_delay,
    sensor_drift,
    sensor_gain,
    sensor_high_pass,
    sensor_hum,
    sensor_saturation,
)
from iwanjax.effects.faults import AbstractFault, AbstractSensorFault
from iwanjax.effects.joint_faults import JOINT_FAULTS
from iwanjax.effects.kinds import ForceKind, Kind, NamedKind, force_laws
from iwanjax.errors import InputError
from iwanjax.joints import described
from iwanjax.joints.force_law import AbstractForceLaw, EffectName

FAULTS: tuple[AbstractFault, ...] = (
    sensor_gain.GAIN,
    sensor_delay.DELAY,
    sensor_high_pass.HIGH_PASS,
    sensor_saturation.SATURATION,
    sensor_gain.POLARITY,
    force_gain.GAIN,
    force_delay.DELAY,
    force_saturation.SATURATION,
    force_gain.POLARITY,
    sensor_hum.HUM,
    sensor_drift.DRIFT,
)
"""Faults of channels; those of one channel act one after the other in this order."""


def sensor_faults_of(kinds: Iterable[Kind]) -> tuple[AbstractSensorFault, ...]:
    """Those of sensors among kinds."""
    return tuple(kind for kind in kinds if isinstance(kind, AbstractSensorFault))


@cache
def _of_law(registered: str, law: type[AbstractForceLaw]) -> tuple[NamedKind, ...]:
    """The kind that a law is, each of its variants."""
    effect = law.effect or EffectName(registered, described(law).partition(":")[0])
    return tuple(
        ForceKind(
            effect.name, effect.usual, law, effect.signs, v.held, v.words, effect.noun, v.within
        )
        for v in law.variants
    )


CATALOGUE: dict[str, tuple[NamedKind, ...]] = {
    **{law.effect.name: _of_law(name, law) for name, law in force_laws().items() if law.effect},
    **{kind.name: (kind,) for kind in FAULTS},
    **{
        name: tuple(kind for kind in JOINT_FAULTS if kind.name == name)
        for name in dict.fromkeys(kind.name for kind in JOINT_FAULTS)
    },
}
"""Kinds that have a name of their own, each with its variants; :func:`catalogue` has all."""


def catalogue() -> dict[str, tuple[NamedKind, ...]]:
    """All kinds by name: those of :data:`CATALOGUE`, and every other law that is a joint's type.

    Raises
    ------
    InputError
        Where a law was registered by the name of another kind.
    """
    found = dict(CATALOGUE)
    for registered, law in force_laws().items():
        kinds = _of_law(registered, law)
        if found.setdefault(kinds[0].name, kinds) != kinds:
            raise InputError(
                f"hypotheses: {kinds[0].name!r} is a kind of the catalogue; register "
                f"{law.__name__} under another name"
            )
    return found


def shipped(kind: ForceKind) -> bool:
    """Whether a kind's law is one of the package's own."""
    return kind.law.__module__.startswith("iwanjax.")


def kinds_of(names: tuple[str, ...] = ()) -> tuple[NamedKind, ...]:
    """The kinds of these names; for none all but laws that are not tried from the beginning.

    Raises
    ------
    InputError
        For an unknown name, with the nearest known one.
    """
    known = catalogue()
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
            raise InputError(f"hypotheses: {name!r} is unknown; {hint}")
    if names:
        return tuple(kind for name in names for kind in known[name])
    return tuple(kind for kinds in known.values() for kind in kinds if not _late(kind))


def kinds_in_time(names: tuple[str, ...] = ()) -> tuple[NamedKind, ...]:
    """The same of motions in time; laws that come in late have all of their parameters there.

    Raises
    ------
    InputError
        As :func:`kinds_of`.
    """
    kinds = kinds_of(names or tuple(catalogue()))
    return tuple(kind.whole if _late(kind) else kind for kind in kinds)


def limits_outside(kinds: Sequence[Kind]) -> tuple[ForceKind, ...]:
    """Kinds that some of these become at an end of their range, and that are not among them."""
    every = (kind for kinds in catalogue().values() for kind in kinds)
    limits = [limit for kind in kinds for limit in getattr(kind, "limits", ())]
    return tuple(
        kind
        for kind in every
        if isinstance(kind, ForceKind) and kind not in kinds and any(x.means(kind) for x in limits)
    )


def _late(kind: NamedKind) -> TypeGuard[ForceKind]:
    """Whether a law is not tried from the beginning."""
    return isinstance(kind, ForceKind) and not kind.law.tried
