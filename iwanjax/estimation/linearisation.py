"""Residuals of groups of data at some values, with their derivatives."""

from typing import NamedTuple

import numpy as np


class Linearisation(NamedTuple):
    """Residuals at some values, group by group.

    Attributes
    ----------
    misfit : (groups,) array
        Sums of the residuals' squares.
    moment : (groups, directions) array
        J^T e.
    normal : (groups, directions, directions) array
        J^T J.
    residual : (groups, N, sensors) array
        e, weighted.
    slopes : (groups, directions, N, sensors) array or None
        J, its derivatives; None where they are too many to be kept.
    """

    misfit: np.ndarray
    moment: np.ndarray
    normal: np.ndarray
    residual: np.ndarray
    slopes: np.ndarray | None

    @classmethod
    def of(cls, residual: np.ndarray, slopes: np.ndarray) -> "Linearisation":
        """What least squares needs of residuals and derivatives."""
        e, J = residual.reshape(len(residual), -1), slopes.reshape(*slopes.shape[:2], -1)
        # A run that breaks down may have derivatives beyond all bounds; no step is taken there.
        with np.errstate(over="ignore", invalid="ignore"):
            moment, normal = (J @ e[:, :, None])[:, :, 0], J @ np.swapaxes(J, 1, 2)
        return cls(np.einsum("rn,rn->r", e, e), moment, normal, residual, slopes)

    def beside(self, move: np.ndarray, residual: np.ndarray) -> "Linearisation":
        r"""What is seen after a move, derivatives corrected only by what it has shown.

        .. math:: J' = J + \frac{(\Delta e - J u)(Wu)^T}{u^T W u},

        Broyden's update (1965) with W the squares of J's columns, so that units do not matter.

        Parameters
        ----------
        move : (groups, directions) array
            u.
        residual : (groups, N, sensors) array
            After it.

        Returns
        -------
        Linearisation
            Without derivatives kept, as foreseen before the move but for the residual.
        """
        if self.slopes is None:
            ahead = np.einsum("rij,rj->ri", self.normal, move)
            square = np.sum(residual**2, axis=(1, 2))
            return Linearisation(square, self.moment + ahead, self.normal, residual, None)
        G, V = move.shape
        J = self.slopes.reshape(G, V, -1)
        weighed = np.einsum("rii->ri", self.normal) * move
        square = np.einsum("ri,ri->r", weighed, move)
        share = weighed / np.where(square > 0, square, np.inf)[:, None]
        e = residual.reshape(G, -1)
        surprise = e - self.residual.reshape(G, -1) - (move[:, None] @ J)[:, 0]
        J = J + share[:, :, None] * surprise[:, None]
        return Linearisation.of(residual, J.reshape(self.slopes.shape))
