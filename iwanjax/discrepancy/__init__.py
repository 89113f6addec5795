"""Discrepancy: where models and recordings differ, and why.

:func:`~iwanjax.discrepancy.steady.diagnose_joint.diagnose_curves`,
:func:`~iwanjax.discrepancy.steady.diagnose_modes.diagnose_modes` and
:func:`~iwanjax.discrepancy.steady.diagnose_joint.diagnose_loops` stay in their modules: they load
the optimisers, which pictures of a diagnosis do not need.
"""

from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.findings import Suspect
from iwanjax.discrepancy.histories.diagnose import diagnose_histories
from iwanjax.discrepancy.single_mode import ModeComparison, compare_modes
from iwanjax.discrepancy.steady.runs import CurveRun, LoopRun, ModesRun
from iwanjax.effects.catalogue import CATALOGUE, catalogue
from iwanjax.effects.faults import AbstractForceFault, AbstractSensorFault
from iwanjax.effects.kinds import ForceKind, JointKind, ModeKind
from iwanjax.identification.recordings import StudyRecording

__all__ = [
    "CATALOGUE",
    "AbstractForceFault",
    "AbstractSensorFault",
    "CurveRun",
    "Diagnosis",
    "ForceKind",
    "JointKind",
    "LoopRun",
    "ModeComparison",
    "ModeKind",
    "ModesRun",
    "StudyRecording",
    "Suspect",
    "catalogue",
    "compare_modes",
    "diagnose_histories",
]
