"""Plain words for what may be missing: "A cubic spring is missing between m5 and m6"."""

import math
from collections.abc import Iterable

from iwanjax.effects.estimate import Estimate
from iwanjax.effects.kinds import Kind

# Relative error from which on it is told as a multiple of what was measured.
_MANIFOLD = 10.0


def noun(kind: Kind, where: str) -> str:
    """For instance "a gap between m5 and m6"."""
    return f"{kind.noun or kind.usual} {place(where)}"


def sentence(kind: Kind, where: str) -> str:
    """For instance "A cubic spring is missing between m5 and m6", without its full stop."""
    return kind.sentence.format(where=where, place=place(where))


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
