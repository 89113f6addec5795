"""Dynamics: jointed structures in time."""

from iwanjax.dynamics.decays import (
    ModalDecays,
    component_rows,
    measured_decays,
    modal_decays,
)
from iwanjax.dynamics.energy import Energies
from iwanjax.dynamics.excitations import (
    base_input,
    half_sine,
    modal_input,
    point_input,
    ramp,
    sine,
    sweep,
)
from iwanjax.dynamics.nonlinear_modes import nonlinear_modes
from iwanjax.dynamics.steady_state import (
    HarmonicResponse,
    controlled_response,
    harmonic_response,
)
from iwanjax.dynamics.transient import SimulatedResponse, simulate

__all__ = [
    "Energies",
    "HarmonicResponse",
    "ModalDecays",
    "SimulatedResponse",
    "base_input",
    "component_rows",
    "controlled_response",
    "half_sine",
    "harmonic_response",
    "measured_decays",
    "modal_decays",
    "modal_input",
    "nonlinear_modes",
    "point_input",
    "ramp",
    "simulate",
    "sine",
    "sweep",
]
