"""Reports: one HTML file each, with all that belongs to it."""

from iwanjax.report.fit import FitEntry, HeldOut, fit_report
from iwanjax.report.page import Callout, NamedParagraph, PageSection, PageTable, render

__all__ = [
    "Callout",
    "FitEntry",
    "HeldOut",
    "NamedParagraph",
    "PageSection",
    "PageTable",
    "fit_report",
    "render",
]
