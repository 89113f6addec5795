"""Differentiable model updating for structures with bolted joints."""

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

__version__ = "0.1.0"

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
    "oscillator",
    "qsma",
    "register_joint",
    "three_mass",
    "work_dissipation",
]
