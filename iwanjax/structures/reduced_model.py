"""A reduced finite element model: small dense matrices, named deflections and points."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.structures.checks import finite_array
from iwanjax.structures.linear import LinearStructure
from iwanjax.structures.model_file import Model


@dataclass(frozen=True, eq=False)
class SurfaceShape:
    """A surface that pictures of shapes are drawn on.

    Attributes
    ----------
    points : (p, 3) array
        Coordinates at rest, length.
    quads : (f, 4) int array
        Corners of each quadrilateral, in order around it.
    patch : (f,) int array
        Contact patch that it belongs to, from 0, or -1.
    recovery : (p, 3, n) array
        Displacement of the points per unit of each coordinate.
    """

    points: np.ndarray
    quads: np.ndarray
    patch: np.ndarray
    recovery: np.ndarray


@dataclass(frozen=True, eq=False)
class ReducedModel(AbstractResult):
    """Craig-Bampton model of a structure without its joints.

    Attributes
    ----------
    M, K : (n, n) arrays
        Mass and stiffness; the structure floats, and parts may hang together by joints only.
    coordinates : tuple of str
        Names of the first coordinates, the interface's motions, such as "J1A.x"; the others
        are amplitudes of fixed-interface modes.
    rows : dict of str to (n,) array
        Relative deflections across each joint, upper minus lower: "J1.x" ... "J1.rz".
    sensors, inputs : dict of str to (n,) array
        What named sensors see; where named forces act.
    shape : SurfaceShape or None
        For pictures.
    fixed_frequency : (k,) array
        Natural frequencies with the interface held, Hz.
    effective_mass : (k, 6) array
        Mass (moment of inertia) that each of these modes moves when the interface moves
        rigidly along (about) x, y, z through the origin.
    residual_flexibility : dict of str to float
        Share of each input's static flexibility, interface held, that these modes lack.
    """

    M: np.ndarray
    K: np.ndarray
    coordinates: tuple[str, ...]
    rows: dict[str, np.ndarray]
    sensors: dict[str, np.ndarray]
    inputs: dict[str, np.ndarray]
    shape: SurfaceShape | None
    fixed_frequency: np.ndarray
    effective_mass: np.ndarray
    residual_flexibility: dict[str, float]

    _shown = ("coordinates", "fixed_frequency", "effective_mass", "residual_flexibility")
    _units: ClassVar = {"fixed_frequency": "Hz", "residual_flexibility": "1"}

    def model(self, springs: Mapping[str, float] | None = None) -> Model:
        """The structure with linear springs at some of its joints.

        Parameters
        ----------
        springs : mapping of str to float, optional
            Stiffness on named rows, force/length (translation) or force length (rotation).

        Returns
        -------
        Model
            Undamped; with all rows, sensors, inputs and named coordinates.

        Raises
        ------
        InputError
            For a row that does not exist or a stiffness that is negative or not finite.
        """
        springs = springs or {}
        check_rows(springs, self.rows)
        K = self.K.copy()
        for name, stiffness in springs.items():
            K += stiffness * np.outer(self.rows[name], self.rows[name])
        structure = LinearStructure(self.M, None, K)
        return Model(
            structure, dict(self.rows), dict(self.sensors), dict(self.inputs), self.coordinates
        )


def check_rows(springs: Mapping[str, float], rows: Collection[str]) -> None:
    """Refuse springs on rows that are not there, or without a stiffness.

    Raises
    ------
    InputError
        Naming the row, and those there are.
    """
    for name, stiffness in springs.items():
        if name not in rows:
            raise InputError(
                f"no joint row is called {name!r}; there are {', '.join(sorted(rows))}"
            )
        value = finite_array(stiffness, f"stiffness of {name}")
        if value.ndim or value < 0:
            raise InputError(f"stiffness of {name} = {stiffness!r}; expected a number, 0 or more")
