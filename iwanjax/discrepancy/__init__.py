"""Discrepancy: where models and recordings differ, and why."""

from iwanjax.discrepancy.catalogue import (
    CATALOGUE,
    ForceKind,
    JointKind,
    SensorKind,
    register_kind,
)
from iwanjax.discrepancy.diagnose import diagnose
from iwanjax.discrepancy.diagnose_curves import CurveRun, diagnose_curves
from iwanjax.discrepancy.measured import Transient
from iwanjax.discrepancy.single_mode import ModeComparison, compare_modes
from iwanjax.discrepancy.verdict import Diagnosis, Suspect

__all__ = [
    "CATALOGUE",
    "CurveRun",
    "Diagnosis",
    "ForceKind",
    "JointKind",
    "ModeComparison",
    "SensorKind",
    "Suspect",
    "Transient",
    "compare_modes",
    "diagnose",
    "diagnose_curves",
    "register_kind",
]
