"""The errors a user can meet, and late stages whose failure costs nothing but themselves."""

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


class IwanjaxError(Exception):
    """Base of every error raised on purpose; the command line prints it as one line.

    Examples
    --------
    >>> import iwanjax as ij
    >>> try:
    ...     ij.load_study("nowhere.yaml")
    ... except ij.IwanjaxError as error:
    ...     print(type(error).__name__)
    InputError
    """


class InputError(IwanjaxError, ValueError):
    """An argument, array or file that cannot be used as it is.

    Examples
    --------
    >>> import iwanjax as ij
    >>> try:
    ...     ij.Jenkins(F_S=-1.0, K_T=2.0)
    ... except ij.InputError as error:
    ...     print(error)
    Jenkins: F_S = -1 (slip force) lies outside (0, inf)
    """


class AccuracyError(InputError):
    """A step, or a grid, at which a result would not be what it claims to be.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> hammering = 100.0 * np.tile([1.0, -1.0], 100)
    >>> try:
    ...     ij.simulate(ij.three_mass(), hammering, 2000.0, inputs=[0, 0, 1])
    ... except ij.AccuracyError as error:
    ...     print("try steps of" in str(error))
    True
    """


class PrecisionError(IwanjaxError, RuntimeError):
    """A computation that needs float64 in a session that computes in float32.

    Examples
    --------
    >>> import jax
    >>> import iwanjax as ij
    >>> chain = ij.three_mass()
    >>> jax.config.update("jax_enable_x64", False)
    >>> try:
    ...     ij.qsma(chain, 0, [1.0])
    ... except ij.PrecisionError as error:
    ...     print(type(error).__name__)
    ... finally:
    ...     jax.config.update("jax_enable_x64", True)
    PrecisionError
    """


def missing_library(what: str, library: str, extra: str) -> InputError:
    """The error where a library is not installed that only some users need.

    Parameters
    ----------
    what : str
        What needs it, for the beginning of the message.
    library, extra : str
        Its name, and the extra of iwanjax that brings it.
    """
    return InputError(
        f"{what} need {library}, which is not installed; try pip install 'iwanjax[{extra}]'"
    )


def attempted(stage: str, run: Callable[[], T], otherwise: T, failures: list[str]) -> T:
    """What a late stage gives, or what to go on with where it fails.

    A verdict that took minutes is worth more than its picture: whatever goes wrong here, the
    rest is told, and what failed with it.

    Parameters
    ----------
    stage : str
        What the failure is called.
    run : function
        The stage.
    otherwise : object
        What there is without it.
    failures : list of str
        Gets a line where the stage fails.
    """
    try:
        return run()
    except Exception as error:
        told = " ".join(str(error).split())
        failures.append(f"{stage} failed ({type(error).__name__}{': ' * bool(told)}{told})")
        return otherwise
