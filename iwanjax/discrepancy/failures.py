"""Stages after the verdict: what fails there is named, and costs nothing but itself."""

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


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
