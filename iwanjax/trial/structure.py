"""The linear structure that effects are concealed in, as a model file has it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

Array = NDArray[np.float64]
Iwan = tuple[float, float, float, float]
"""F_S, K_T, chi and beta of Segalman's four-parameter Iwan joint."""


@dataclass(frozen=True, kw_only=True)
class TrialStructure:
    """A linear structure without its joints, its places, and how its tests are sampled.

    Attributes
    ----------
    name : str
    M, C, K : (n, n) array
        Of the structure without its joints.
    rows, sensors, inputs : mapping of str to (n,) array
        Where forces may act, what sensors see, where forces are measured.
    joints : mapping of str to (F_S, K_T, chi, beta)
        Named as the rows along which they lie.
    rate : float
        Sampling rate, Hz.
    samples : int
        Of each recording.
    steps : int
        Of the integration within a sampling interval.
    """

    name: str
    M: Array
    C: Array
    K: Array
    rows: Mapping[str, Array]
    sensors: Mapping[str, Array]
    inputs: Mapping[str, Array]
    joints: Mapping[str, Iwan]
    rate: float
    samples: int
    steps: int = 16


def tangent_stiffness(structure: TrialStructure) -> Array:
    """Stiffness (n, n) at vanishing amplitude: K and every joint stuck."""
    K = structure.K.copy()
    for name, (_, K_T, _, _) in structure.joints.items():
        row = structure.rows[name]
        K += K_T * np.outer(row, row)
    return K


def inexact(
    structure: TrialStructure, stuck: Array, frequencies: Array, dampings: Array
) -> tuple[Array, Array]:
    """K and C of a model whose modes are off, with the true shapes.

    `stuck` (n, n) is the stiffness of the true modes; `frequencies` and `dampings` (n,) are the
    relative deviations of the model's frequencies and damping ratios from those of the truth.
    C is scaled from both sides, so that it stays positive where it is not modal.
    """
    squared, shapes = eigh(stuck, structure.M)
    back = structure.M @ shapes
    rise = (1 + frequencies) ** 2 - 1
    K = structure.K + (back * (squared * rise)) @ back.T
    ratio = np.sqrt((1 + dampings) * (1 + frequencies))
    scaled = back * ratio @ shapes.T
    return 0.5 * (K + K.T), scaled @ structure.C @ scaled.T
