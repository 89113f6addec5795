"""Studies: a model with its recordings, and all that can be done with them but write files.

Fits, simulations and diagnoses stay in their modules: they load the optimisers, which reading a
study does not need.
"""

from iwanjax.config import Measurement
from iwanjax.signals.tabular import as_recording
from iwanjax.studies.loading import load_study
from iwanjax.studies.measured import Hit, MeasuredMode
from iwanjax.studies.predicted import PredictedRecording
from iwanjax.studies.results import StudyResults
from iwanjax.studies.study import Study

__all__ = [
    "Hit",
    "MeasuredMode",
    "Measurement",
    "PredictedRecording",
    "Study",
    "StudyResults",
    "as_recording",
    "load_study",
]
