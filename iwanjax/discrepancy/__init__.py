"""Discrepancy: where models and recordings differ, and why."""

from iwanjax.discrepancy.catalogue import CATALOGUE, Kind, register_kind
from iwanjax.discrepancy.diagnose import Diagnosis, diagnose
from iwanjax.discrepancy.measured import Transient
from iwanjax.discrepancy.single_mode import ModeComparison, compare_modes

__all__ = [
    "CATALOGUE",
    "Diagnosis",
    "Kind",
    "ModeComparison",
    "Transient",
    "compare_modes",
    "diagnose",
    "register_kind",
]
