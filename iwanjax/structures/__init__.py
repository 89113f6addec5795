"""Structures: linear matrices, their modes, and joints attached to them."""

from iwanjax.structures.affine import AffineStructure, Term, spring
from iwanjax.structures.assurance import modal_assurance
from iwanjax.structures.jointed import JointedStructure, ModalBasis
from iwanjax.structures.linear import LinearStructure, LinearTrust, Modes, null_space_transform
from iwanjax.structures.systems import SYSTEMS, oscillator, three_mass

__all__ = [
    "SYSTEMS",
    "AffineStructure",
    "JointedStructure",
    "LinearStructure",
    "LinearTrust",
    "ModalBasis",
    "Modes",
    "Term",
    "modal_assurance",
    "null_space_transform",
    "oscillator",
    "spring",
    "three_mass",
]
