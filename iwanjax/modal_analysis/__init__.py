"""Modal analysis of recordings: poles, mode shapes and a linear model, each with deviations."""

from iwanjax.modal_analysis.analysis import modal_test
from iwanjax.modal_analysis.result import ModalTest

__all__ = ["ModalTest", "modal_test"]
