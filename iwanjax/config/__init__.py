"""What describes a study: every key checked, every fault told with its file, line and key."""

from iwanjax.config.cases import SimulationCase
from iwanjax.config.modal import ModalMode
from iwanjax.config.parameters import ParameterChange
from iwanjax.config.qsma import QsmaSettings
from iwanjax.config.recordings import (
    Data,
    ForceSettings,
    Measurement,
    RecordingEntry,
    ResponseSettings,
)
from iwanjax.config.settings import FitSettings, PosteriorSettings, RingdownSettings
from iwanjax.config.simulate import SimulateSection
from iwanjax.config.study import StudySetup, given_study, read_study

__all__ = [
    "Data",
    "FitSettings",
    "ForceSettings",
    "Measurement",
    "ModalMode",
    "ParameterChange",
    "PosteriorSettings",
    "QsmaSettings",
    "RecordingEntry",
    "ResponseSettings",
    "RingdownSettings",
    "SimulateSection",
    "SimulationCase",
    "StudySetup",
    "given_study",
    "read_study",
]
