"""Study files: every key checked, every fault told in one line with its file, line and key."""

from iwanjax.config.cases import SimulationCase
from iwanjax.config.modal import ModalMode
from iwanjax.config.parameters import ParameterChange
from iwanjax.config.qsma import QsmaSettings
from iwanjax.config.recordings import ForceSettings, RecordingEntry, ResponseSettings
from iwanjax.config.settings import FitSettings, PosteriorSettings, RingdownSettings
from iwanjax.config.simulate import SimulateSection
from iwanjax.config.study import Study, load_study

__all__ = [
    "FitSettings",
    "ForceSettings",
    "ModalMode",
    "ParameterChange",
    "PosteriorSettings",
    "QsmaSettings",
    "RecordingEntry",
    "ResponseSettings",
    "RingdownSettings",
    "SimulateSection",
    "SimulationCase",
    "Study",
    "load_study",
]
