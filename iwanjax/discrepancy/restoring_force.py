"""A recovered force beside the laws that may explain it."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class RestoringForce:
    """A recovered force at a place in the hardest recording, and laws that may explain it.

    Attributes
    ----------
    kind, where : str
        Chosen suspect.
    over : str
        What the force is shown over: "deflection", "rate" or "acceleration".
    x, force : (N,) array
        Samples, opposing a growing deflection.
    centre, middle, spread : (bins,) array
        Medians of the force in bins of x, and deviations of a sample about them.
    laws : dict of str to (bins,) array
        Medians, in the same bins, of what the chosen kind and its rivals there would do in the
        same motion.
    """

    kind: str
    where: str
    over: str
    x: np.ndarray = field(repr=False)
    force: np.ndarray = field(repr=False)
    centre: np.ndarray = field(repr=False)
    middle: np.ndarray = field(repr=False)
    spread: np.ndarray = field(repr=False)
    laws: dict[str, np.ndarray] = field(repr=False)
