"""What a plan of recordings would show of effects that nobody has measured yet."""

from iwanjax.planning.detectability import detectability
from iwanjax.planning.result import AddedMeasurement, AlikePair, Detectability, SmallestSize

__all__ = ["AddedMeasurement", "AlikePair", "Detectability", "SmallestSize", "detectability"]
