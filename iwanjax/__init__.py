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
    hysteresis,
    register_joint,
)
from iwanjax.quasistatic import ModalOscillator, QsmaSolution, qsma, work_dissipation
from iwanjax.results import Result
from iwanjax.structures import (
    JointedStructure,
    LinearStructure,
    Modes,
    oscillator,
    three_mass,
)

if TYPE_CHECKING:
    from iwanjax.config import (
        Study,
        load_study,
    )
    from iwanjax.dynamics import (
        Energies,
        Transient,
        simulate,
    )
    from iwanjax.plotting import (
        plot,
        plot_bands,
        plot_curves,
        plot_fit,
        plot_joint,
        plot_merged,
        plot_posterior,
        plot_qsma,
        plot_ringdown,
    )
    from iwanjax.signals import (
        Channel,
        MergedCurves,
        Recording,
        RingDown,
        band_pass,
        merge_curves,
        modal_filter,
        read_curves,
        read_recording,
        read_recordings,
        ringdown,
        ringdown_curves,
    )
    from iwanjax.updating import (
        Exponents,
        FitSolution,
        LogNormal,
        LogUniform,
        Normal,
        Parameter,
        Posterior,
        Uniform,
        fit,
        free_exponents,
        modal_parameters,
        structural_parameters,
    )
    from iwanjax.updating.sampling import sample_posterior

__version__ = "0.1.0"

# Reached on first use: they import matplotlib, pydantic, optimistix or emcee, which most scripts
# do not need.
_LATER = {
    "Study": "iwanjax.config",
    "load_study": "iwanjax.config",
    "Energies": "iwanjax.dynamics",
    "Transient": "iwanjax.dynamics",
    "simulate": "iwanjax.dynamics",
    "plot": "iwanjax.plotting",
    "plot_bands": "iwanjax.plotting",
    "plot_curves": "iwanjax.plotting",
    "plot_fit": "iwanjax.plotting",
    "plot_joint": "iwanjax.plotting",
    "plot_merged": "iwanjax.plotting",
    "plot_posterior": "iwanjax.plotting",
    "plot_qsma": "iwanjax.plotting",
    "plot_ringdown": "iwanjax.plotting",
    "Channel": "iwanjax.signals",
    "MergedCurves": "iwanjax.signals",
    "Recording": "iwanjax.signals",
    "RingDown": "iwanjax.signals",
    "band_pass": "iwanjax.signals",
    "merge_curves": "iwanjax.signals",
    "modal_filter": "iwanjax.signals",
    "read_curves": "iwanjax.signals",
    "read_recording": "iwanjax.signals",
    "read_recordings": "iwanjax.signals",
    "ringdown": "iwanjax.signals",
    "ringdown_curves": "iwanjax.signals",
    "Exponents": "iwanjax.updating",
    "FitSolution": "iwanjax.updating",
    "LogNormal": "iwanjax.updating",
    "LogUniform": "iwanjax.updating",
    "Normal": "iwanjax.updating",
    "Parameter": "iwanjax.updating",
    "Posterior": "iwanjax.updating",
    "Uniform": "iwanjax.updating",
    "fit": "iwanjax.updating",
    "free_exponents": "iwanjax.updating",
    "modal_parameters": "iwanjax.updating",
    "sample_posterior": "iwanjax.updating.sampling",
    "structural_parameters": "iwanjax.updating",
}

__all__ = [
    "AbstractJoint",
    "Channel",
    "CubicSpring",
    "Dashpot",
    "Energies",
    "Exponents",
    "FitSolution",
    "Gap",
    "InputError",
    "Iwan4",
    "Iwan5",
    "IwanjaxError",
    "Jenkins",
    "JointedStructure",
    "LinearSpring",
    "LinearStructure",
    "LogNormal",
    "LogUniform",
    "MergedCurves",
    "ModalCurves",
    "ModalOscillator",
    "Modes",
    "Normal",
    "Parameter",
    "Posterior",
    "PowerLawDamping",
    "PrecisionError",
    "QsmaSolution",
    "Recording",
    "Result",
    "RingDown",
    "Study",
    "Transient",
    "Uniform",
    "band_pass",
    "fit",
    "free_exponents",
    "hysteresis",
    "load_study",
    "merge_curves",
    "modal_filter",
    "modal_parameters",
    "oscillator",
    "plot",
    "plot_bands",
    "plot_curves",
    "plot_fit",
    "plot_joint",
    "plot_merged",
    "plot_posterior",
    "plot_qsma",
    "plot_ringdown",
    "qsma",
    "read_curves",
    "read_recording",
    "read_recordings",
    "register_joint",
    "ringdown",
    "ringdown_curves",
    "sample_posterior",
    "simulate",
    "structural_parameters",
    "three_mass",
    "work_dissipation",
]


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
