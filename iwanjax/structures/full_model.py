"""A finite element model before its reduction, and what a reduction of it left out."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.structures.assurance import modal_assurance
from iwanjax.structures.reduced_model import ReducedModel, SurfaceShape, check_rows
from iwanjax.structures.reduction import craig_bampton, full_modes
from iwanjax.tables import Block, Grid


@dataclass(frozen=True, eq=False)
class Surface:
    """Quadrilaterals of a mesh's surface.

    Attributes
    ----------
    nodes : (p,) int array
        Nodes of the model at the corners; node i has the DOFs 3i, 3i + 1, 3i + 2.
    points : (p, 3) array
        Their coordinates, length.
    quads : (f, 4) int array
        Corners of each quadrilateral, indices into ``points``.
    patch : (f,) int array
        Contact patch that it belongs to, from 0, or -1.
    """

    nodes: np.ndarray
    points: np.ndarray
    quads: np.ndarray
    patch: np.ndarray


@dataclass(frozen=True, eq=False)
class FullModel:
    """Sparse matrices of a structure without its joints, and its interface.

    Attributes
    ----------
    M, K : (n, n) sparse arrays
        Mass and stiffness, free to float.
    interface : (b, n) sparse array
        Rows of the virtual nodes' motions.
    labels : tuple of str
        Their names, such as "J1A.x".
    joints : dict of str to (b,) array
        Relative deflections in interface motions, such as "J1.x".
    coupled : tuple of str
        Those that are held at zero: one motion is then a coordinate for both.
    rigid : (b, 6) array
        Interface motions when everything moves rigidly about the origin.
    sensors, inputs : dict of str to (1, n) sparse array
        Rows of named points.
    surface : Surface
        For pictures and for comparing shapes.
    """

    M: sp.csc_array
    K: sp.csc_array
    interface: sp.csr_array
    labels: tuple[str, ...]
    joints: dict[str, np.ndarray]
    coupled: tuple[str, ...]
    rigid: np.ndarray
    sensors: dict[str, sp.csr_array]
    inputs: dict[str, sp.csr_array]
    surface: Surface

    def reduce(self, modes: int, *, attach: bool = False) -> ReducedModel:
        """Craig-Bampton model with the interface's motions and fixed-interface modes.

        Parameters
        ----------
        modes : int
            Number of fixed-interface modes.
        attach : bool
            Whether static responses to the inputs join the basis, so that they are exact.

        Returns
        -------
        ReducedModel

        Raises
        ------
        InputError
            As :func:`~iwanjax.structures.reduction.craig_bampton`.
        """
        loads = sp.csr_array(sp.vstack(list(self.inputs.values()))) if self.inputs else None
        full = craig_bampton(self.M, self.K, self.interface, modes, loads, attach=attach)
        merge, kept = self._merge()
        b, k = len(kept), len(full.fixed_frequency)
        T = np.zeros((len(merge) + k, b + k))
        T[: len(merge), :b], T[len(merge) :, b:] = merge, np.eye(k)
        basis = full.basis @ T

        def recovered(rows: Mapping[str, sp.csr_array]) -> dict[str, np.ndarray]:
            return {name: (row @ basis)[0] for name, row in rows.items()}

        surface = self.surface
        corners = 3 * surface.nodes[:, None] + np.arange(3)
        return ReducedModel(
            M=T.T @ full.M @ T,
            K=T.T @ full.K @ T,
            coordinates=tuple(self.labels[i] for i in kept),
            rows={
                name: np.concatenate([row @ merge, np.zeros(k)])
                for name, row in self.joints.items()
                if name not in self.coupled
            },
            sensors=recovered(self.sensors),
            inputs=recovered(self.inputs),
            shape=SurfaceShape(surface.points, surface.quads, surface.patch, basis[corners]),
            fixed_frequency=full.fixed_frequency,
            effective_mass=full.effective_mass(self.rigid),
            residual_flexibility=dict(
                zip(self.inputs, full.residual_flexibility.tolist(), strict=True)
            ),
        )

    def modes(
        self, springs: Mapping[str, float], count: int, *, shift: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Lowest modes of the unreduced structure with linear springs at its joints.

        Parameters
        ----------
        springs : mapping of str to float
            Stiffness on named deflections, force/length or force length.
        count : int
            Number of modes, the rigid ones included.
        shift : float
            As for :func:`~iwanjax.structures.reduction.full_modes`, Hz.

        Returns
        -------
        frequency : (count,) array
            Hz.
        shapes : (n, count) array
            Mass-normalised.
        """
        check_rows(springs, set(self.joints) - set(self.coupled))
        stiff = {**springs, **dict.fromkeys(self.coupled, np.inf)}
        rows = {
            name: (sp.csr_array(sp.csr_array(self.joints[name][None]) @ self.interface), k)
            for name, k in stiff.items()
        }
        return full_modes(self.M, self.K, rows, count, shift)

    def _merge(self) -> tuple[np.ndarray, list[int]]:
        """Interface motions in terms of those kept, (b, kept), and which those are."""
        keeper = np.arange(len(self.labels))
        for name in self.coupled:
            row = self.joints[name]
            keeper[np.argmax(row)] = np.argmin(row)
        kept = np.unique(keeper)
        return (keeper[:, None] == kept).astype(float), kept.tolist()


@dataclass(frozen=True, eq=False)
class ReductionCheck(AbstractResult):
    """Modes of the full model beside those of its reduction; prints as a table.

    Attributes
    ----------
    full, reduced : (modes,) arrays
        Natural frequencies of elastic modes, Hz: the full model's, and of each the reduced
        mode that resembles it most.
    assurance : (modes,) array
        Modal assurance of the two shapes on the surface, 1.
    highest_fixed : float
        Highest fixed-interface mode kept, Hz.
    """

    full: np.ndarray
    reduced: np.ndarray
    assurance: np.ndarray
    highest_fixed: float

    @property
    def error(self) -> np.ndarray:
        """Relative error of the reduced frequencies, 1; not negative but for round-off."""
        return self.reduced / self.full - 1.0

    def enough(self, tolerance: float = 1e-3, assurance: float = 0.99) -> bool:
        """Whether every mode's frequency and shape are met."""
        return bool(np.all(np.abs(self.error) <= tolerance) and np.all(self.assurance > assurance))

    def _blocks(self) -> tuple[Block, ...]:
        columns = zip(self.full, self.reduced, 100 * self.error, self.assurance, strict=True)
        rows = tuple((f"{f:.3f}", f"{r:.3f}", f"{e:.4f}", f"{mac:.4f}") for f, r, e, mac in columns)
        return (
            Grid(("full Hz", "reduced Hz", "error %", "MAC"), rows),
            f"fixed-interface modes kept up to {self.highest_fixed:.1f} Hz",
        )

    def __str__(self) -> str:
        return self.summary()


def check_reduction(
    full: FullModel, reduced: ReducedModel, springs: Mapping[str, float], limit: float
) -> ReductionCheck:
    """Whether enough fixed-interface modes were kept for a frequency range.

    Parameters
    ----------
    full : FullModel
        The model before its reduction.
    reduced : ReducedModel
        The reduction of it.
    springs : mapping of str to float
        Linear springs at the joints, the same for both.
    limit : float
        Modes up to this frequency are compared, Hz.

    Returns
    -------
    ReductionCheck

    Raises
    ------
    InputError
        When no elastic mode lies below the limit, or the models do not belong together.
    """
    if reduced.shape is None or len(reduced.shape.points) != len(full.surface.points):
        raise InputError("check_reduction: the reduced model is not a reduction of this full model")
    omega, Phi = map(np.asarray, reduced.model(springs).structure.modes())
    hertz = omega / (2 * np.pi)
    if not np.any(hertz <= limit):
        raise InputError(
            f"no elastic mode below limit = {limit:g} Hz; the first is at {hertz[0]:.6g} Hz"
        )
    rigid = len(reduced.M) - len(hertz)
    # A reduction never loses a mode: it only finds it too high.
    count = rigid + int(np.sum(hertz <= limit))
    frequency, shapes = full.modes(springs, count + 4, shift=0.1 * hertz[0])
    elastic = (np.arange(count + 4) >= rigid) & (frequency <= limit)
    a = shapes[3 * full.surface.nodes[:, None] + np.arange(3)][..., elastic]
    b = np.tensordot(reduced.shape.recovery, Phi, axes=1)
    a, b = (x.reshape(-1, x.shape[-1]) for x in (a, b))
    assurance = np.asarray(modal_assurance(a, b))
    best = np.argmax(assurance, axis=1)
    return ReductionCheck(
        frequency[elastic],
        hertz[best],
        np.max(assurance, axis=1),
        float(reduced.fixed_frequency.max()),
    )
