"""A clear difference between recordings and a model."""

from typing import NamedTuple

# Deviations beyond which a difference is one, and levels it is taken at.
CLEAR, LEVELS = 3.0, 9


class Observable(NamedTuple):
    """One mode in one recording.

    Attributes
    ----------
    recording : str
        Its name.
    mode : int
        Among the model's elastic modes, the lowest first from zero.
    quantity : {"frequency", "damping"}
        What differs.
    amplitude : (float, float)
        Range of the sensor's amplitude that was compared.
    difference_percent : float
        Model less measured over measured, the median over that range.
    name : str
        What the mode is called.
    """

    recording: str
    mode: int
    quantity: str
    amplitude: tuple[float, float]
    difference_percent: float
    name: str
