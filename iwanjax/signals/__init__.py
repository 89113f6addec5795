"""Signals: recordings of measurements, and the files they come in."""

from iwanjax.signals.curves_file import read_curves
from iwanjax.signals.readers import read_recording, read_recordings
from iwanjax.signals.recording import Channel, Recording

__all__ = ["Channel", "Recording", "read_curves", "read_recording", "read_recordings"]
