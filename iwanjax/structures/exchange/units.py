"""What frequencies and masses would be if units had been mixed up."""

from typing import NamedTuple

import numpy as np

# Standard gravity in inches: one slinch (lbf s^2 / in) weighs so many pounds.
_POUNDS_PER_SLINCH = 386.0886
# A structure with joints weighs more than 50 g, so a smaller number is in tonnes.
_LEAST_KG = 0.05
# Elastic modes of the structures that have bolted joints, Hz.
_USUAL = (1.0, 20e3)
# Predictions of a first frequency that are further off are explained by something else.
_CLOSE = 1.5


class MixUp(NamedTuple):
    """Units that do not go together, and true over computed frequency with them."""

    units: str
    factor: float


MIX_UPS = (
    MixUp("K in N/mm with M in kg, or K in N/m with M in g", np.sqrt(1e3)),
    MixUp("K in N/m with M in tonne", 1.0 / np.sqrt(1e3)),
    MixUp("K in N/mm with M in g, or a unit of time of 1 ms", 1e3),
    MixUp("density in kg/m^3 with lengths in mm", 1e6),
    MixUp("K in lbf/in with M in lb", np.sqrt(_POUNDS_PER_SLINCH)),
)


def mass_sentence(mass: float) -> str:
    """A total mass read as kilograms and as tonnes, and which is likelier."""
    in_kg = f"{mass:.4g} kg in N, m, kg, s"
    in_tonnes = f"{1e3 * mass:.4g} kg in N, mm, tonne, s"
    likely, other = (in_tonnes, in_kg) if mass < _LEAST_KG else (in_kg, in_tonnes)
    return f"The total mass is {mass:.4g}: {likely} (the likelier for such a number), {other}."


def mix_up_sentence(first: float) -> str:
    """What the first elastic frequency is, and would be by other units, Hz."""
    others = "; ".join(f"{first * m.factor:.4g} Hz for {m.units}" for m in MIX_UPS)
    return (
        f"The first elastic frequency is {first:.4g} Hz if the units go together (N, m, kg, s or "
        f"N, mm, tonne, s). Had they been mixed it would truly be: {others}."
    )


def frequency_warning(first: float, expected: float | None) -> str:
    """What speaks against the units, given what the frequency should be about; or nothing.

    Parameters
    ----------
    first : float
        First elastic frequency of the matrices, Hz.
    expected : float or None
        What a test or a textbook says, Hz.
    """
    if expected is None:
        low, high = _USUAL
        if low <= first <= high:
            return ""
        return (
            f"The first elastic frequency, {first:.4g} Hz, is unusual (expected {low:g} to "
            f"{high:g} Hz): are the units of M and K mixed?"
        )
    if _near(first, expected):
        return ""
    mix_up = min(MIX_UPS, key=lambda m: abs(np.log(first * m.factor / expected)))
    if _near(first * mix_up.factor, expected):
        return (
            f"The first elastic frequency, {first:.4g} Hz, is far from the {expected:.4g} Hz "
            f"expected, but the units would explain it: {mix_up.units} make it "
            f"{first * mix_up.factor:.4g} Hz."
        )
    return (
        f"The first elastic frequency, {first:.4g} Hz, is far from the {expected:.4g} Hz expected, "
        "and none of the usual mix-ups of units explains it: compare supports and masses."
    )


def _near(value: float, other: float) -> bool:
    return 1.0 / _CLOSE < value / other < _CLOSE
