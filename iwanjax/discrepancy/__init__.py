"""Discrepancy: where models and recordings differ, and why."""

from iwanjax.discrepancy.single_mode import ModeComparison, compare_modes

__all__ = ["ModeComparison", "compare_modes"]
