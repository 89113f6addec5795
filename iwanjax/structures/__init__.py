"""Structures: linear matrices, their modes, and joints attached to them."""

from iwanjax.structures.jointed import JointedStructure, ModalBasis
from iwanjax.structures.linear import LinearStructure, Modes, null_space_transform
from iwanjax.structures.systems import SYSTEMS, oscillator, three_mass

__all__ = [
    "SYSTEMS",
    "JointedStructure",
    "LinearStructure",
    "ModalBasis",
    "Modes",
    "null_space_transform",
    "oscillator",
    "three_mass",
]
