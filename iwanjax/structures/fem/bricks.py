r"""Blocks of quadratic bricks: stiffness, mass and geometry of bodies cut from one grid.

Every cell of a rectangular grid is empty or belongs to one body. Cells of one body share their
nodes; two bodies share nodes only where they are welded, so that faces in contact may slide.
The elements are 20-node serendipity bricks, which bend without the shear locking of 8-node
bricks (3 to 4 % on a bar, 43 to 60 % on a thin strip of the thesis's proportions).

.. math::
    K_{ia,jb} = \lambda H_{ia,jb} + \mu\,(H_{ib,ja} + \delta_{ab}\textstyle\sum_c H_{ic,jc}),
    \qquad H_{ia,jb} = \int \partial_a N_i\,\partial_b N_j\,dV, \qquad
    M_{ia,jb} = \rho\,\delta_{ab} \int N_i N_j\,dV
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.checks import instance_of, positive_number
from iwanjax.structures.fem.library import skfem

# Exact for the mass of a rectangular brick but for its highest products; 2 leaves false zero
# modes, skfem's default takes ten times as long and changes no frequency by 1e-6.
_QUADRATURE = 4
# Factors of more would not fit into the memory of a desktop.
_MOST_CELLS = 30_000
EMPTY = -1
"""Label of a cell that no body fills."""


@dataclass(frozen=True)
class Material:
    """Isotropic linear elasticity.

    Parameters
    ----------
    E : float
        Young's modulus, force/length².
    nu : float
        Poisson's ratio, 1; above -1 and below 1/2.
    rho : float
        Density, mass/length³.

    Raises
    ------
    InputError
        For a value outside its range.
    """

    E: float
    nu: float
    rho: float

    def __post_init__(self) -> None:
        positive_number(self.E, "E")
        positive_number(self.rho, "rho")
        if not -1.0 < self.nu < 0.5:
            raise InputError(f"nu = {self.nu:g} must lie between -1 and 0.5 (steel: 0.29)")

    @property
    def lame(self) -> tuple[float, float]:
        """λ and μ, force/length²."""
        mu = self.E / (2 * (1 + self.nu))
        return 2 * mu * self.nu / (1 - 2 * self.nu), mu


@dataclass(frozen=True, eq=False)
class Bricks:
    """Bodies of bricks and their free-free matrices; node i has the DOFs 3i, 3i + 1, 3i + 2.

    Attributes
    ----------
    basis : skfem.Basis
        Scalar shape functions on the mesh.
    body : (cells,) int array
        Body of each cell.
    M, K : (3 nodes, 3 nodes) sparse arrays
        Consistent mass; stiffness.
    """

    basis: Any
    body: np.ndarray
    M: sp.csc_array
    K: sp.csc_array

    @property
    def size(self) -> int:
        """Number of degrees of freedom."""
        return 3 * self.basis.N

    @property
    def nodes(self) -> np.ndarray:
        """(nodes, 3) coordinates, mid-side nodes among them."""
        return self.basis.doflocs.T

    @cached_property
    def corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of each cell, (cells, 3) each."""
        p, t = self.basis.mesh.p, self.basis.mesh.t
        # Vertices 7 and 0 of the reference cell are (0, 0, 0) and (1, 1, 1).
        return p[:, t[7]].T, p[:, t[0]].T

    def rows(self, point: Sequence[float], body: int) -> sp.csr_array | None:
        """Motion of a material point, (3, size): shape functions of the cell that holds it.

        Parameters
        ----------
        point : (3,) sequence of float
            Coordinates, length.
        body : int
            Label of the body it belongs to.

        Returns
        -------
        (3, size) sparse array or None
            None for a point outside the body.
        """
        low, high = self.corners
        slack = 1e-9 * np.ptp(self.nodes)
        inside = np.all((low - slack <= point) & (point <= high + slack), axis=1)
        cells = np.flatnonzero(inside & (self.body == body))
        if not len(cells):
            return None
        cell = cells[0]
        X = ((np.asarray(point) - low[cell]) / (high[cell] - low[cell]))[:, None]
        N = np.array([self.basis.elem.lbasis(X, i)[0][0] for i in range(self.basis.Nbfun)])
        columns = 3 * self.basis.element_dofs[:, cell] + np.arange(3)[:, None]
        rows = np.repeat(np.arange(3), len(N))
        return sp.csr_array((np.tile(N, 3), (rows, columns.ravel())), shape=(3, self.size))


def grid_lines(breaks: Sequence[float], size: float) -> np.ndarray:
    """Coordinates that include every break, no further apart than ``size``.

    Parameters
    ----------
    breaks : sequence of float
        Places where a grid line has to be, in any order, length.
    size : float
        Largest distance, length.
    """
    ordered = np.unique(np.round(np.asarray(breaks, float), 9))
    pieces = [
        np.linspace(a, b, int(np.ceil((b - a) / size - 1e-9)) + 1)[:-1]
        for a, b in pairwise(ordered)
    ]
    return np.concatenate([*pieces, ordered[-1:]])


def bricks(
    lines: Sequence[np.ndarray],
    body: np.ndarray,
    material: Material,
    welds: Sequence[tuple[int, int]] = (),
) -> Bricks:
    """Assemble bodies cut from a rectangular grid.

    Parameters
    ----------
    lines : three arrays
        Ascending grid coordinates along x, y and z, length.
    body : (nx, ny, nz) int array
        Label of each cell, from 0; ``EMPTY`` for none.
    material : Material
        Of all bodies.
    welds : sequence of (int, int)
        Pairs of bodies that share the nodes of their common faces.

    Returns
    -------
    Bricks

    Raises
    ------
    InputError
        For a mesh that is too fine to factorise, and where scikit-fem is missing.
    """
    instance_of(material, Material, "material")
    count = int(np.sum(body != EMPTY))
    if count > _MOST_CELLS:
        raise InputError(
            f"the mesh would have {count} elements, about {12 * count} degrees of freedom; choose "
            f"a larger element size ({_MOST_CELLS} elements at most)"
        )
    mesh, label = _mesh(lines, body, welds)
    fe = skfem()
    element = fe.ElementHexS2()
    low, high = mesh.p[:, mesh.t[7]], mesh.p[:, mesh.t[0]]
    # Bricks of one size have the same matrices: integrate each size once.
    sizes = np.round((high - low).T / np.max(high - low), 9)
    _, typical, kind = np.unique(sizes, axis=0, return_index=True, return_inverse=True)
    kind = kind.ravel()
    sample = fe.Basis(mesh, element, intorder=_QUADRATURE, elements=typical)
    stiffness, mass = _element_matrices(sample, material)
    basis = fe.Basis(mesh, element, quadrature=(np.full((3, 1), 0.5), np.ones(1)))
    nodes = basis.element_dofs.T
    dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
    K = _assemble(stiffness[kind], dofs, 3 * basis.N)
    M = sp.kron(_assemble(mass[kind], nodes, basis.N), sp.eye_array(3), format="csc")
    return Bricks(basis, label, sp.csc_array(M), K)


def _mesh(
    lines: Sequence[np.ndarray], body: np.ndarray, welds: Sequence[tuple[int, int]]
) -> tuple[Any, np.ndarray]:
    """Mesh of the filled cells, with the body of each."""
    fe = skfem()
    shape = np.array([len(line) for line in lines])
    cells = np.argwhere(body != EMPTY)
    label = body[tuple(cells.T)]
    offsets = fe.ElementHex1.refdom.p.T.astype(int)
    vertices = np.ravel_multi_index(tuple((cells[:, None] + offsets).transpose(2, 0, 1)), shape)
    bodies = int(label.max()) + 1
    copies, index = np.unique(vertices * bodies + label[:, None], return_inverse=True)
    place, owner = np.divmod(copies, bodies)
    merged = _merge(place, owner, welds)
    coordinates = np.zeros((3, merged.max() + 1))
    coordinates[:, merged] = [
        line[i] for line, i in zip(lines, np.unravel_index(place, shape), strict=True)
    ]
    t = np.ascontiguousarray(merged[index.reshape(vertices.shape)].T)
    return fe.MeshHex(coordinates, t), label


def _merge(place: np.ndarray, owner: np.ndarray, welds: Sequence[tuple[int, int]]) -> np.ndarray:
    """Number of the node that each body's copy of a grid point becomes."""
    import scipy.sparse.csgraph

    first, second = [], []
    for a, b in welds:
        _, i, j = np.intersect1d(place[owner == a], place[owner == b], return_indices=True)
        first.append(np.flatnonzero(owner == a)[i])
        second.append(np.flatnonzero(owner == b)[j])
    ends = np.concatenate([[], *first]).astype(int), np.concatenate([[], *second]).astype(int)
    graph = sp.coo_array((np.ones(len(ends[0])), ends), shape=(len(place), len(place)))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]


def _element_matrices(basis: Any, material: Material) -> tuple[np.ndarray, np.ndarray]:
    """(cells, 60, 60) stiffness and (cells, 20, 20) mass of one direction."""
    shapes = range(basis.Nbfun)
    N = np.array([np.broadcast_to(np.asarray(basis.basis[i][0]), basis.dx.shape) for i in shapes])
    mass = material.rho * np.einsum("iep,jep,ep->eij", N, N, basis.dx, optimize=True)
    G = np.stack([basis.basis[i][0].grad for i in shapes])  # (20, 3, cells, points)
    n = len(G)
    rows = G.transpose(2, 0, 1, 3).reshape(basis.nelems, 3 * n, -1)
    H = (rows * basis.dx[:, None]) @ rows.transpose(0, 2, 1)
    H = H.reshape(-1, n, 3, n, 3)
    lam, mu = material.lame
    shear = H.transpose(0, 1, 4, 3, 2) + np.einsum("eicjc,ab->eiajb", H, np.eye(3))
    stiffness = (lam * H + mu * shear).reshape(-1, 3 * n, 3 * n)
    return 0.5 * (stiffness + stiffness.transpose(0, 2, 1)), mass


def _assemble(blocks: np.ndarray, dofs: np.ndarray, size: int) -> sp.csc_array:
    """Sum of element matrices (cells, k, k) at their DOFs (cells, k)."""
    dofs = dofs.astype(np.int32)
    rows = np.broadcast_to(dofs[:, :, None], blocks.shape).ravel()
    columns = np.broadcast_to(dofs[:, None, :], blocks.shape).ravel()
    return sp.csc_array(sp.coo_array((blocks.ravel(), (rows, columns)), shape=(size, size)))
