"""The optional finite element library, imported when it is first needed."""

import importlib
from types import ModuleType

from iwanjax.errors import InputError


def skfem() -> ModuleType:
    """The module ``skfem``.

    Raises
    ------
    InputError
        Where it is not installed, naming the extra that brings it.
    """
    try:
        return importlib.import_module("skfem")
    except ImportError:
        raise InputError(
            "finite element models need scikit-fem, which is not installed; try "
            "pip install 'iwanjax[fem]'"
        ) from None
