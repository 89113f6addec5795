"""Differentiable model updating for structures with bolted joints."""

import importlib
from typing import TYPE_CHECKING, Any

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError, IwanjaxError, PrecisionError
from iwanjax.joints import (
    AbstractJoint,
    CubicSpring,
    Dashpot,
    Gap,
    Iwan4,
    Iwan5,
    Jenkins,
    LinearSpring,
    PowerLawDamping,
    register_joint,
)
from iwanjax.quasistatic import QsmaSolution, qsma, work_dissipation
from iwanjax.results import Result
from iwanjax.structures import (
    JointedStructure,
    LinearStructure,
    Modes,
    oscillator,
    three_mass,
)

if TYPE_CHECKING:
    from iwanjax.config import load_study
    from iwanjax.plotting import plot, plot_curves, plot_joint, plot_qsma

__version__ = "0.1.0"

# Reached on first use: they import matplotlib and pydantic, which most scripts do not need.
_LATER = {
    "load_study": "iwanjax.config",
    "plot": "iwanjax.plotting",
    "plot_curves": "iwanjax.plotting",
    "plot_joint": "iwanjax.plotting",
    "plot_qsma": "iwanjax.plotting",
}

__all__ = [
    "AbstractJoint",
    "CubicSpring",
    "Dashpot",
    "Gap",
    "InputError",
    "Iwan4",
    "Iwan5",
    "IwanjaxError",
    "Jenkins",
    "JointedStructure",
    "LinearSpring",
    "LinearStructure",
    "ModalCurves",
    "Modes",
    "PowerLawDamping",
    "PrecisionError",
    "QsmaSolution",
    "Result",
    "load_study",
    "oscillator",
    "plot",
    "plot_curves",
    "plot_joint",
    "plot_qsma",
    "qsma",
    "register_joint",
    "three_mass",
    "work_dissipation",
]


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
