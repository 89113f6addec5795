"""How much memory a diagnosis by time histories may take, however long the recordings are."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MemorySettings:
    """What may be held at once of all that grows with the number of samples.

    Both together, and what a problem itself takes, stay below 4 GB.

    Attributes
    ----------
    derivatives : int, bytes
        Of all searches side by side; where they are more, none keeps its own, but works them out
        again after every step.
    kernels : int, bytes
        That kernels side by side, and forces of size 1 that are to be judged, may take.
    """

    derivatives: int = 2**29
    kernels: int = 2**30


MEMORY = MemorySettings()
"""As diagnoses are made."""
