"""Reports: one HTML file each, with all that belongs to it."""

from iwanjax.report.fit import FitEntry, HeldOut, fit_report
from iwanjax.report.page import Callout, Named, Section, Table, render

__all__ = ["Callout", "FitEntry", "HeldOut", "Named", "Section", "Table", "fit_report", "render"]
