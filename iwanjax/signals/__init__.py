"""Signals: recordings of measurements, the files they come in, and the curves they hold."""

from iwanjax.signals.contents import FileContents, file_contents
from iwanjax.signals.curves_file import read_curves, read_force_control, read_response_control
from iwanjax.signals.filters import band_pass, measured_components, modal_filter
from iwanjax.signals.force_control import curves_from_force_control
from iwanjax.signals.force_loop import ForceLoop, read_loop
from iwanjax.signals.hilbert import RingDown, ringdown, ringdown_curves
from iwanjax.signals.merge import MergedCurves, merge_curves
from iwanjax.signals.readers import read_recording, read_recordings
from iwanjax.signals.recording import Channel, Recording
from iwanjax.signals.response_control import (
    ControlledResonance,
    controlled_resonance,
    resonance_from_control,
)

__all__ = [
    "Channel",
    "ControlledResonance",
    "FileContents",
    "ForceLoop",
    "MergedCurves",
    "Recording",
    "RingDown",
    "band_pass",
    "controlled_resonance",
    "curves_from_force_control",
    "file_contents",
    "measured_components",
    "merge_curves",
    "modal_filter",
    "read_curves",
    "read_force_control",
    "read_loop",
    "read_recording",
    "read_recordings",
    "read_response_control",
    "resonance_from_control",
    "ringdown",
    "ringdown_curves",
]
