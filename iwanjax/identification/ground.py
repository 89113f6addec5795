"""The ground that moves: what its acceleration, an input of its own, carries along."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from iwanjax.dynamics.coordinates import ModalCoordinates


class Ground(NamedTuple):
    r"""Rigid-body motion with the ground.

    With r the motion of all coordinates when the ground moves by 1 and nothing deforms, an
    acceleration a of the ground acts as the force -M r a on the motion relative to it; sensors of
    acceleration, and whatever has inertia, follow the absolute one, r a more. Chopra, Dynamics of
    Structures (2017), Sec. 9.4.

    Attributes
    ----------
    inputs : (inputs, base) array
        1 at the input that is the acceleration of the ground; no column where there is none.
    modes : (modes, base) array
        r on all modes.
    sensors : (sensors, base) array
        What the sensors see of r.
    """

    inputs: Float[Array, "inputs base"]
    modes: Float[Array, "modes base"]
    sensors: Float[Array, "sensors base"]


class Pushed(NamedTuple):
    """Parts of a push of :class:`~.predictor.Data`, each with its leading axes.

    Attributes
    ----------
    state : (..., 2 kept) array
        What it does to q and v over a step.
    modal, left : (..., kept), (..., modes - kept) array
        Modal forces at the end of the step.
    ground : (..., base) array
        Acceleration of the ground then.
    """

    state: Any
    modal: Any
    left: Any
    ground: Any


def ground_of(modal: ModalCoordinates, base: int | None) -> Ground:
    """What moves with the ground, by the force that its acceleration makes.

    Parameters
    ----------
    modal : ModalCoordinates
        All modes.
    base : int or None
        Which input it is; its row is -M r.
    """
    W, which = np.asarray(modal.W), [] if base is None else [base]
    motion = -W[:, which]
    whole = np.eye(W.shape[1])[:, which], motion, np.asarray(modal.Y) @ motion
    return Ground(*jax.device_put(whole))
