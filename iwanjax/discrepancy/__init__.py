"""Discrepancy: where models and recordings differ, and why.

:func:`~iwanjax.discrepancy.diagnose_curves.diagnose_curves`,
:func:`~iwanjax.discrepancy.diagnose_modes.diagnose_modes` and
:func:`~iwanjax.discrepancy.diagnose_loops.diagnose_loops` stay in their modules: they load the
optimisers, which pictures of a diagnosis do not need.
"""

from iwanjax.discrepancy.catalogue import (
    CATALOGUE,
    ForceKind,
    JointKind,
    ModeKind,
    SensorKind,
    register_kind,
)
from iwanjax.discrepancy.curve_run import CurveRun, ModesRun
from iwanjax.discrepancy.diagnose import diagnose
from iwanjax.discrepancy.loop_run import LoopRun
from iwanjax.discrepancy.measured import Transient
from iwanjax.discrepancy.single_mode import ModeComparison, compare_modes
from iwanjax.discrepancy.verdict import Diagnosis, Suspect

__all__ = [
    "CATALOGUE",
    "CurveRun",
    "Diagnosis",
    "ForceKind",
    "JointKind",
    "LoopRun",
    "ModeComparison",
    "ModeKind",
    "ModesRun",
    "SensorKind",
    "Suspect",
    "Transient",
    "compare_modes",
    "diagnose",
    "register_kind",
]
