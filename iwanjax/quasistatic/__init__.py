"""Quasi-static modal analysis: one static solve a level instead of a ring-down."""

from iwanjax.quasistatic.coupled import CoupledModes, coupled_modes
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.quasistatic.qsma import QsmaSolution, qsma
from iwanjax.quasistatic.work import work_dissipation

__all__ = [
    "CoupledModes",
    "ModalOscillator",
    "QsmaSolution",
    "coupled_modes",
    "qsma",
    "work_dissipation",
]
