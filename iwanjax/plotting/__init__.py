"""Figures of joints, curves and analyses; matplotlib is loaded with this package only."""

from functools import singledispatch
from typing import Any

from matplotlib.figure import Figure

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.plotting.curves import plot_curves
from iwanjax.plotting.joints import plot_joint
from iwanjax.plotting.quasistatic import plot_qsma
from iwanjax.quasistatic import QsmaSolution

__all__ = ["plot", "plot_curves", "plot_joint", "plot_qsma"]


@singledispatch
def plot(obj: Any, **options: Any) -> Figure:
    """The figure that suits an object.

    Parameters
    ----------
    obj : joint, ModalCurves or QsmaSolution
        What to draw.
    **options
        Passed to :func:`plot_joint`, :func:`plot_curves` or :func:`plot_qsma`.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For an object that has no figure.
    """
    raise InputError(
        f"plot: no figure for a {type(obj).__name__}; expected a joint, ModalCurves or QsmaSolution"
    )


plot.register(AbstractJoint, plot_joint)
plot.register(ModalCurves, plot_curves)
plot.register(QsmaSolution, plot_qsma)
