"""How often a diagnosis is right, by effects concealed in a study's own recordings.

Nothing here is shared with what is tried but the formats of files: laws, integration and
measurement chain are written a second time, and a diagnosis is a command of its own process.
"""

from iwanjax.trial.campaign import run_trials
from iwanjax.trial.outcome import TrialOutcome, TrialResult
from iwanjax.trial.plan import TrialPlan
from iwanjax.trial.simulation import Take, TrialBase
from iwanjax.trial.structure import TrialStructure

__all__ = [
    "Take",
    "TrialBase",
    "TrialOutcome",
    "TrialPlan",
    "TrialResult",
    "TrialStructure",
    "run_trials",
]
