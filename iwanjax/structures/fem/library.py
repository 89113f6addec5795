"""The optional finite element library, imported when it is first needed."""

import importlib
from types import ModuleType

from iwanjax.errors import missing_library


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
        raise missing_library("finite element models", "scikit-fem", "fem") from None
