"""What imported matrices say about their structure, in plain sentences."""

from dataclasses import dataclass

import numpy as np

from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.structures.exchange.contents import Matrix
from iwanjax.structures.exchange.matrices import ImportedMatrices
from iwanjax.structures.exchange.node_map import listed
from iwanjax.structures.exchange.spectrum import (
    definiteness,
    lowest_eigenvalues,
)
from iwanjax.structures.exchange.units import frequency_warning, mass_sentence, mix_up_sentence
from iwanjax.tables import Block

# A soft suspension leaves the six lowest eigenvalues below the seventh by this at least.
_SOFT = 1e-2
# Total masses in different directions agree so well, unless supports take some away.
_SAME_MASS = 0.02


@dataclass(frozen=True, eq=False)
class MatrixReport(AbstractResult):
    """What :func:`check_matrices` found; ``print(report)`` tells it.

    Attributes
    ----------
    size : int
        Number of coordinates n.
    total_mass : dict of str to float
        Mass that moves in ux, uy, uz; empty without a node map.
    massless : tuple of str
        DOFs without mass.
    rigid_bodies : int or None
        Motions without stiffness; None where frequencies could not be computed.
    frequency : (modes,) array
        Lowest elastic frequencies, Hz.
    sentences : tuple of str
        What is there and what was changed.
    warnings : tuple of str
        What should be looked at first.
    """

    size: int
    total_mass: dict[str, float]
    massless: tuple[str, ...]
    rigid_bodies: int | None
    frequency: np.ndarray
    sentences: tuple[str, ...]
    warnings: tuple[str, ...]

    def _blocks(self) -> tuple[Block, ...]:
        return (str(self),)

    def __str__(self) -> str:
        return "\n".join((*self.sentences, *(f"Warning: {text}" for text in self.warnings)))


def check_matrices(
    matrices: ImportedMatrices, *, modes: int = 6, expected: float | None = None
) -> MatrixReport:
    """Whether M and K can be believed: definiteness, supports, mass, frequencies, units.

    Parameters
    ----------
    matrices : ImportedMatrices
        From :func:`read_matrices`.
    modes : int
        How many elastic frequencies to compute.
    expected : float, optional
        First elastic frequency that you expect, Hz: tells mixed-up units apart.

    Returns
    -------
    MatrixReport

    Raises
    ------
    InputError
        For a number of modes or an expected frequency that is not positive, and when some
        motion has neither mass nor stiffness.
    """
    if modes < 1 or (expected is not None and not expected > 0):
        raise InputError(f"modes = {modes}, expected = {expected}; expected positive numbers")
    M, K = matrices.M, matrices.K
    sentences = [f"M and K have {matrices.size} rows, both symmetric.", *matrices.notes]
    warnings: list[str] = []
    empty_M, empty_K = (np.ravel(abs(matrix).sum(axis=0)) == 0 for matrix in (M, K))
    massless = tuple(matrices.label(int(i)) for i in np.flatnonzero(empty_M))
    bare = np.flatnonzero(empty_M & empty_K)
    if massless:
        warnings.append(
            f"{len(massless)} of {matrices.size} DOFs have no mass: {listed(massless)}; condense "
            "them out before the matrices become a model."
        )
    if len(bare):
        warnings.append(
            f"{len(bare)} DOFs have neither mass nor stiffness and are passed over below: "
            f"{listed([matrices.label(int(i)) for i in bare])}; leave them out of the export."
        )
        M, K = (_part(matrix, ~(empty_M & empty_K)) for matrix in (M, K))
    total = _total_mass(matrices)
    if total:
        sentences.append(mass_sentence(max(total.values())))
        if max(total.values()) - min(total.values()) > _SAME_MASS * max(total.values()):
            told = ", ".join(f"{name} {value:.4g}" for name, value in total.items())
            warnings.append(f"The mass that moves is not the same in all directions: {told}.")
    rigid, frequency = None, np.empty(0)
    fault = _mass_fault(matrices, empty_M)
    if fault:
        warnings.append(fault)
    else:
        if definiteness(_part(matrices.M, ~empty_M)) == "singular":
            warnings.append(
                "M is singular beyond DOFs without mass: some motion of several DOFs has none; "
                "reduce the matrices before they become a model."
            )
        spectrum = lowest_eigenvalues(K, M, max(modes, 7))
        if spectrum.negative:
            warnings.append(
                f"K is not positive semidefinite: {spectrum.negative} eigenvalue(s) of (K, M) are "
                "negative; check signs, and whether K holds preload."
            )
        else:
            rigid = spectrum.rigid
            frequency = np.sqrt(spectrum.elastic) / (2 * np.pi)
            sentences.append(_support(rigid, _free(matrices), warnings))
            warnings += [] if rigid else _soft(frequency)
            frequency = frequency[:modes]
    if len(frequency):
        sentences.append(mix_up_sentence(float(frequency[0])))
        warning = frequency_warning(float(frequency[0]), expected)
        warnings += [warning] if warning else []
    return MatrixReport(
        matrices.size, total, massless, rigid, frequency, tuple(sentences), tuple(warnings)
    )


def _total_mass(matrices: ImportedMatrices) -> dict[str, float]:
    """Mass r^T M r that moves with the structure translated by r."""
    if matrices.nodes is None or matrices.T is not None:
        return {}
    dofs = np.array(matrices.nodes.dofs)
    found = {}
    for name in ("ux", "uy", "uz"):
        r = (dofs == name).astype(float)
        if np.any(r):
            found[name] = float(r @ (matrices.M @ r))
    return found


def _mass_fault(matrices: ImportedMatrices, empty: np.ndarray) -> str:
    """Why the mass is none, or nothing."""
    diagonal = matrices.M.diagonal()
    if np.all(empty):
        return "M is zero everywhere: was the density left out?"
    bad = np.flatnonzero((diagonal <= 0) & ~empty)
    if len(bad):
        where = listed([matrices.label(int(i)) for i in bad])
        return f"M is not positive definite: its diagonal is not positive at {where}."
    if definiteness(_part(matrices.M, ~empty)) == "indefinite":
        return "M is not positive definite: some motion has negative mass; check the export."
    return ""


def _part(matrix: Matrix, wanted: np.ndarray) -> Matrix:
    """The rows and columns that are wanted."""
    kept = np.flatnonzero(wanted)
    return matrix[kept][:, kept]


def _free(matrices: ImportedMatrices) -> int:
    """Rigid-body modes of a structure that nothing holds: 6, in a plane 3, in a line 1."""
    dofs = set() if matrices.nodes is None or matrices.T is not None else set(matrices.nodes.dofs)
    translations = len(dofs & {"ux", "uy", "uz"})
    # A beam that only bends in a plane moves and turns.
    alone = 2 if dofs & {"rx", "ry", "rz"} else 1
    return {1: alone, 2: 3}.get(translations, 6)


def _support(rigid: int, free: int, warnings: list[str]) -> str:
    """What the number of rigid-body modes says about the supports."""
    if rigid == 0:
        return "No rigid-body modes: the structure is supported."
    if rigid == free:
        return f"{rigid} rigid-body mode(s): the structure is free."
    cause = (
        "it is partly supported, or has mechanisms."
        if rigid < free
        else f"{rigid - free} mechanism(s): something is not connected."
    )
    warnings.append(
        f"{rigid} rigid-body mode(s) where a free structure has {free} and a supported one 0: "
        f"{cause}"
    )
    return f"{rigid} rigid-body mode(s)."


def _soft(frequency: np.ndarray) -> list[str]:
    """A free structure that does not quite look it."""
    if len(frequency) < 7 or (frequency[5] / frequency[6]) ** 2 > _SOFT:
        return []
    return [
        f"The six lowest frequencies end at {frequency[5]:.3g} Hz, far below the seventh, "
        f"{frequency[6]:.3g} Hz: a soft suspension, or a free structure written with few digits."
    ]
