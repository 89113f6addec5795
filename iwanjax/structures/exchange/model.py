"""A model out of imported matrices and the places on them that have names."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from iwanjax.errors import InputError
from iwanjax.structures.checks import finite_array
from iwanjax.structures.exchange.contents import full
from iwanjax.structures.exchange.matrices import ImportedMatrices
from iwanjax.structures.exchange.node_map import Dof, listed
from iwanjax.structures.linear import LinearStructure
from iwanjax.structures.model_file import Model

# Its modes, by a dense eigenproblem, take some ten seconds.
_LARGEST = 2000

Place: TypeAlias = Dof | tuple[Dof, Dof] | np.ndarray | Sequence[float]
"""``(12, "ux")``, or ``((12, "ux"), (40, "ux"))``: the first relative to the second; or a row."""


def to_model(
    matrices: ImportedMatrices,
    *,
    rows: Mapping[str, Place] | None = None,
    sensors: Mapping[str, Place] | None = None,
    inputs: Mapping[str, Place] | None = None,
) -> Model:
    """A model of small matrices; large ones have to be reduced first.

    Parameters
    ----------
    matrices : ImportedMatrices
        From :func:`read_matrices`; C is zero where there is none.
    rows, sensors, inputs : mapping of str to place, optional
        By name, where joints sit or forces may act, what sensors see, and where measured
        forces act: a DOF ``(12, "ux")``, a pair of them (the first relative to the second),
        or an (n,) row.

    Returns
    -------
    Model
        Coordinates with a node map are called ``"12 ux"``.

    Raises
    ------
    InputError
        For matrices too large to be dense, DOFs without mass, and places that are not there.
    """
    if matrices.size > _LARGEST:
        raise InputError(
            f"the matrices have {matrices.size} rows; a model holds dense ones of up to "
            f"{_LARGEST}: reduce them first (Craig-Bampton, interface DOFs kept)"
        )
    M, K = full(matrices.M), full(matrices.K)
    C = None if matrices.C is None else full(matrices.C)
    massless = [matrices.label(int(i)) for i in np.flatnonzero(~np.any(M, axis=0))]
    if massless:
        raise InputError(
            f"{len(massless)} DOFs have no mass: {listed(massless)}; condense them out, or give "
            "them mass"
        )
    structure = LinearStructure(M, C, K)

    def named(places: Mapping[str, Place] | None) -> dict[str, np.ndarray]:
        return {name: _row(matrices, name, place) for name, place in (places or {}).items()}

    nodes = matrices.nodes if matrices.T is None else None
    return Model(
        structure,
        named(rows),
        named(sensors),
        named(inputs),
        tuple(f"{node} {dof}" for node, dof in nodes.labels()) if nodes is not None else (),
    )


def _row(matrices: ImportedMatrices, name: str, place: Place) -> np.ndarray:
    """The (n,) row of a place."""
    try:
        match place:
            case (int(node), str(dof)):
                return matrices.row((node, dof))
            case ((int(node), str(dof)), (int(other), str(motion))):
                return matrices.row((node, dof), (other, motion))
    except InputError as error:
        raise InputError(f"{name!r}: {error}") from None
    row = finite_array(place, f"row {name!r}")
    if row.shape != (matrices.size,):
        raise InputError(
            f"row {name!r} has shape {row.shape}; expected ({matrices.size},), (node, DOF) or two "
            "of these"
        )
    return row
