"""Differentiable model updating for structures with bolted joints."""

import importlib
from typing import TYPE_CHECKING, Any

from iwanjax.compiler import compile_quickly
from iwanjax.curves import ModalCurves
from iwanjax.errors import AccuracyError, InputError, IwanjaxError, PrecisionError
from iwanjax.joints import (
    AbstractJoint,
    BilinearSpring,
    CubicSpring,
    Dashpot,
    Gap,
    Iwan4,
    Iwan5,
    Jenkins,
    LinearSpring,
    Maxwell,
    QuadraticDrag,
    QuadraticSpring,
    Tabulated,
    hysteresis,
    register_joint,
)
from iwanjax.quasistatic import (
    ModalOscillator,
    QsmaSolution,
    coupled_modes,
    qsma,
)
from iwanjax.results import Result, draw_with
from iwanjax.structures import (
    AffineStructure,
    JointedStructure,
    LinearStructure,
    Term,
    modal_assurance,
    oscillator,
    spring,
    three_mass,
)

if TYPE_CHECKING:
    from iwanjax.discrepancy import Diagnosis, compare_modes
    from iwanjax.dynamics import (
        SimulatedResponse,
        base_input,
        controlled_response,
        half_sine,
        harmonic_response,
        modal_decays,
        modal_input,
        nonlinear_modes,
        point_input,
        ramp,
        simulate,
        sine,
        sweep,
    )
    from iwanjax.estimation import LogNormal, LogUniform, Normal, Parameter, Uniform
    from iwanjax.modal_analysis import modal_test
    from iwanjax.plotting import plot
    from iwanjax.signals import (
        ForceLoop,
        Recording,
        band_pass,
        merge_curves,
        modal_filter,
        read_curves,
        read_recording,
        read_recordings,
        ringdown,
        ringdown_curves,
    )
    from iwanjax.structures.fem.brake_reuss import (
        brake_reuss_beam,
        brake_reuss_joints,
        brake_reuss_springs,
    )
    from iwanjax.structures.fem.sumali import sumali_beam, sumali_joints, sumali_springs
    from iwanjax.studies import Measurement, Study, as_recording, load_study
    from iwanjax.studies.dispatch import diagnose
    from iwanjax.updating import (
        FitSolution,
        MeasuredModes,
        Posterior,
        fit,
        modal_parameters,
        pareto_front,
        positive_parameter,
        sample_fits,
        structural_parameters,
        update_linear,
    )
    from iwanjax.updating.sampling import sample_posterior

__version__ = "0.1.0"

# Reached on first use: they import matplotlib, pydantic, optimistix, emcee or sparse matrices,
# which most scripts do not need.
_LATER = {
    "Measurement": "iwanjax.studies",
    "Study": "iwanjax.studies",
    "as_recording": "iwanjax.studies",
    "load_study": "iwanjax.studies",
    "diagnose": "iwanjax.studies.dispatch",
    "Diagnosis": "iwanjax.discrepancy",
    "compare_modes": "iwanjax.discrepancy",
    "controlled_response": "iwanjax.dynamics",
    "harmonic_response": "iwanjax.dynamics",
    "base_input": "iwanjax.dynamics",
    "half_sine": "iwanjax.dynamics",
    "modal_input": "iwanjax.dynamics",
    "point_input": "iwanjax.dynamics",
    "ramp": "iwanjax.dynamics",
    "sine": "iwanjax.dynamics",
    "sweep": "iwanjax.dynamics",
    "modal_decays": "iwanjax.dynamics",
    "nonlinear_modes": "iwanjax.dynamics",
    "SimulatedResponse": "iwanjax.dynamics",
    "simulate": "iwanjax.dynamics",
    "modal_test": "iwanjax.modal_analysis",
    "plot": "iwanjax.plotting",
    "ForceLoop": "iwanjax.signals",
    "Recording": "iwanjax.signals",
    "band_pass": "iwanjax.signals",
    "merge_curves": "iwanjax.signals",
    "modal_filter": "iwanjax.signals",
    "read_curves": "iwanjax.signals",
    "read_recording": "iwanjax.signals",
    "read_recordings": "iwanjax.signals",
    "ringdown": "iwanjax.signals",
    "ringdown_curves": "iwanjax.signals",
    "brake_reuss_beam": "iwanjax.structures.fem.brake_reuss",
    "brake_reuss_joints": "iwanjax.structures.fem.brake_reuss",
    "brake_reuss_springs": "iwanjax.structures.fem.brake_reuss",
    "sumali_beam": "iwanjax.structures.fem.sumali",
    "sumali_joints": "iwanjax.structures.fem.sumali",
    "sumali_springs": "iwanjax.structures.fem.sumali",
    "FitSolution": "iwanjax.updating",
    "update_linear": "iwanjax.updating",
    "positive_parameter": "iwanjax.updating",
    "MeasuredModes": "iwanjax.updating",
    "LogNormal": "iwanjax.estimation",
    "LogUniform": "iwanjax.estimation",
    "Normal": "iwanjax.estimation",
    "Parameter": "iwanjax.estimation",
    "Posterior": "iwanjax.updating",
    "Uniform": "iwanjax.estimation",
    "fit": "iwanjax.updating",
    "modal_parameters": "iwanjax.updating",
    "pareto_front": "iwanjax.updating",
    "sample_fits": "iwanjax.updating",
    "sample_posterior": "iwanjax.updating.sampling",
    "structural_parameters": "iwanjax.updating",
}

__all__ = [
    "AbstractJoint",
    "AccuracyError",
    "AffineStructure",
    "BilinearSpring",
    "CubicSpring",
    "Dashpot",
    "Diagnosis",
    "FitSolution",
    "ForceLoop",
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
    "Maxwell",
    "MeasuredModes",
    "Measurement",
    "ModalCurves",
    "ModalOscillator",
    "Normal",
    "Parameter",
    "Posterior",
    "PrecisionError",
    "QsmaSolution",
    "QuadraticDrag",
    "QuadraticSpring",
    "Recording",
    "Result",
    "SimulatedResponse",
    "Study",
    "Tabulated",
    "Term",
    "Uniform",
    "as_recording",
    "band_pass",
    "base_input",
    "brake_reuss_beam",
    "brake_reuss_joints",
    "brake_reuss_springs",
    "compare_modes",
    "compile_quickly",
    "controlled_response",
    "coupled_modes",
    "diagnose",
    "fit",
    "half_sine",
    "harmonic_response",
    "hysteresis",
    "load_study",
    "merge_curves",
    "modal_assurance",
    "modal_decays",
    "modal_filter",
    "modal_input",
    "modal_parameters",
    "modal_test",
    "nonlinear_modes",
    "oscillator",
    "pareto_front",
    "plot",
    "point_input",
    "positive_parameter",
    "qsma",
    "ramp",
    "read_curves",
    "read_recording",
    "read_recordings",
    "register_joint",
    "ringdown",
    "ringdown_curves",
    "sample_fits",
    "sample_posterior",
    "simulate",
    "sine",
    "spring",
    "structural_parameters",
    "sumali_beam",
    "sumali_joints",
    "sumali_springs",
    "sweep",
    "three_mass",
    "update_linear",
]


def _draw(result: Any, **options: Any) -> Any:
    from iwanjax.plotting import plot

    return plot(result, **options)


draw_with(_draw)


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
