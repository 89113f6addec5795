"""How a solve ended, in a code an array can hold and words a person can read."""

import enum


class Result(enum.IntEnum):
    """Outcome of one solve; results that are not ``CONVERGED`` come with NaN values."""

    CONVERGED = 0
    EXHAUSTED = 1
    NO_EQUILIBRIUM = 2
    LOST_MODE = 3

    @property
    def message(self) -> str:
        """What happened and what to try."""
        return _MESSAGES[self]


_MESSAGES = {
    Result.CONVERGED: "converged",
    Result.EXHAUSTED: (
        "the iteration limit was reached before the tolerance; try closer load levels, or an "
        "element whose force does not fall with growing deflection"
    ),
    Result.NO_EQUILIBRIUM: (
        "no static equilibrium: every joint that could carry this load slips; lower alpha"
    ),
    Result.LOST_MODE: (
        "the joints' stiffness is so far from the structure's reference that the mode cannot be "
        "told from others (modal assurance below 1/2); build the structure with joints closer to it"
    ),
}
