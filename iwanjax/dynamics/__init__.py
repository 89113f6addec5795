"""Dynamics: jointed structures in time."""

from iwanjax.dynamics.transient import Energies, Transient, simulate

__all__ = ["Energies", "Transient", "simulate"]
