"""Studies from their files."""

from pathlib import Path

from iwanjax.config import read_study
from iwanjax.studies.study import Study


def load_study(path: str | Path) -> Study:
    """Read a study file and the model it names; recordings are opened when they are needed.

    Parameters
    ----------
    path : str or Path
        A YAML file; ``configs/modal_ringdown.yaml`` is one to copy, with every key explained.

    Raises
    ------
    InputError
        ``file:line: key: what arrived; expected ...`` in one line, for the first fault.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.load_study("configs/three_mass.yaml")
    Study('three_mass': 3 coordinates with J1; 0 recording(s))
    """
    return Study.of(read_study(path))
