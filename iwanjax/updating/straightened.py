"""Variables in which the curved ridges that a walk has found are straight."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import emcee
import numpy as np
from jaxtyping import Float

# A parabola says nothing beyond the points that it was fitted to, in deviations.
_REACH = 4.0
# Of the points' weight, what speaks for a ridge that is straight: few points fit any parabola.
_STRAIGHT = 1e-3
# More would tell no more of some hundred coefficients.
_POINTS = 20_000

_Points = Float[np.ndarray, "points variables"]


class Straightened(NamedTuple):
    r"""Principal coordinates p, less the parabolas that each follows in those before it.

    .. math:: u_k = p_k - \sum_{i \le j < k} c_{kij}\, p_i p_j - \sum_{j < k} b_{kj}\, p_j - a_k,

    the coordinates in the order of their deviations, the widest first: what is thin follows what
    is wide. The map has a constant volume, so that a density of y is one of u. Of the triangular
    maps of Parno and Marzouk (SIAM/ASA J. Uncertainty Quantification 6, 2018) the simplest.

    Attributes
    ----------
    mean : (variables,) array
        Of the points.
    root, inverse : (variables, variables) array
        Principal directions, each as long as the points' deviation along it; and back.
    curved : (monomials, variables) array
        Coefficients of 1, p_j and p_i p_j, those of each p_k in column k.
    """

    mean: np.ndarray
    root: np.ndarray
    inverse: np.ndarray
    curved: np.ndarray

    @classmethod
    def of(cls, points: _Points) -> "Straightened":
        """As some points lie, by least squares."""
        points = points[:: -(-len(points) // _POINTS)]
        mean, size = points.mean(axis=0), points.std(axis=0)
        size = np.where(size > 0.0, size, 1.0)
        _, deviation, V = np.linalg.svd((points - mean) / size, full_matrices=False)
        deviation = np.maximum(deviation / np.sqrt(len(points)), 1e-12 * deviation[0])
        root = size[:, None] * V.T * deviation
        p = ((points - mean) / size) @ V.T / deviation
        made = _monomials(p)
        products, along = made.T @ made / len(p), made.T @ p / len(p)
        # Of each coordinate the monomials of those before it: others are set to zero.
        own = np.arange(len(products))[:, None] < [_count(k) for k in range(p.shape[1])]
        both = own.T[:, :, None] & own.T[:, None, :]
        least = (
            np.where(both, products, 0.0)
            + np.eye(len(products)) * np.where(own.T, _STRAIGHT, 1.0)[:, None, :]
        )
        curved = np.linalg.solve(least, np.where(own, along, 0.0).T[:, :, None])[..., 0].T
        return cls(mean, root, V / size / deviation[:, None], curved)

    def straight(self, y: _Points) -> _Points:
        """Points of the variables as the walk has them, in these."""
        p = (y - self.mean) @ self.inverse.T
        return p - _monomials(p) @ self.curved

    def as_given(self, u: _Points) -> _Points:
        """The inverse of :meth:`straight`."""
        p, known = np.empty_like(u), np.ones((len(u), u.shape[1] + 1))
        made = np.ones((len(u), len(self.curved)))
        for k in range(u.shape[1]):
            before, after = _count(k), _count(k + 1)
            p[:, k] = u[:, k] + made[:, :before] @ self.curved[:before, k]
            # As in _monomials, a coordinate after the other.
            known[:, k + 1] = np.minimum(np.maximum(p[:, k], -_REACH), _REACH)
            made[:, before:after] = known[:, k + 1, None] * known[:, : k + 2]
        return self.mean + p @ self.root.T


class AlongRidges(emcee.moves.RedBlueMove):
    """A move of emcee's, proposed in straightened variables."""

    def __init__(self, move: emcee.moves.RedBlueMove, known: Straightened):
        super().__init__()
        self.move, self.known = move, known

    def setup(self, coords: np.ndarray) -> None:
        """The move's own."""
        self.move.setup(coords)

    def get_proposal(
        self,
        sample: np.ndarray,
        complement: Sequence[np.ndarray],
        random: np.random.RandomState,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where some walkers would go by the places of the others."""
        others = [self.known.straight(each) for each in complement]
        straight = self.known.straight(sample)
        proposed, factors = self.move.get_proposal(straight, others, random)
        return self.known.as_given(proposed), factors


def _monomials(p: _Points) -> Float[np.ndarray, "points monomials"]:
    """1, then of each coordinate in turn itself and its products with those up to it."""
    known = np.column_stack([np.ones(len(p)), np.clip(p, -_REACH, _REACH)])
    i, j = _pairs(known.shape[1])
    return known[:, i] * known[:, j]


@cache
def _pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Of numbers up to a count, each with those up to itself."""
    return np.tril_indices(count)


def _count(variables: int) -> int:
    """Monomials of so many."""
    return (variables + 1) * (variables + 2) // 2
