"""Which kinds of force at which places would explain what the joints cannot."""

from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy.catalogue import Scales
from iwanjax.discrepancy.prediction import Suspects
from iwanjax.discrepancy.refit import Refit, Search, replace_suspects

# Columns shorter than this share of the longest say nothing.
_SILENT = 1e-9


class Candidate(NamedTuple):
    """A suspected force, judged at size zero.

    Attributes
    ----------
    kind, place : int
        Which.
    size, shape : float
        Size that the linearised residuals ask for, and the shape it was judged with.
    drop : float
        Share of the squared residual that it would take away, the joints refitted.
    """

    kind: int
    place: int
    size: float
    shape: float
    drop: float


def screen(search: Search, nominal: Refit, scales: list[Scales]) -> list[Candidate]:
    r"""Score every kind at every place by what it would take off the residual.

    With the column h of a force's size at zero and the residual e, both less what the joints'
    parameters explain, the squared residual falls by :math:`(h^Te)^2/(h^Th)`. Shapes are
    tried on the small grids of the catalogue.

    Parameters
    ----------
    search : Search
        Predictor and data.
    nominal : Refit
        The model with its joints refitted, no suspected force.
    scales : list of Scales
        What each place has seen.

    Returns
    -------
    list of Candidate
        For each kind and place the best shape, the largest drop first.
    """
    kinds = search.predictor.kinds
    places = len(scales)
    grids = [[kind.shapes(scale) for scale in scales] for kind in kinds]
    gain = search.gain(nominal.z, nominal.suspects, nominal.cycles)
    e = search.residuals(nominal.z, nominal.suspects, gain)
    blank = np.zeros((len(kinds), places))
    known = search.slopes(
        nominal.z,
        nominal.suspects,
        gain,
        [(row, blank, blank) for row in np.eye(search.parameters)],
    )
    basis, _ = np.linalg.qr(np.vstack([known, np.eye(search.parameters)]))
    n = e.size
    e = np.concatenate([e, nominal.z])
    left = e - basis @ (basis.T @ e)
    total = float(left @ left)
    best: dict[tuple[int, int], Candidate] = {}
    for trial in range(max(len(grid) for rows in grids for grid in rows)):
        shape = np.array([[grid[min(trial, len(grid) - 1)] for grid in rows] for rows in grids])
        suspects = replace_suspects(blank, shape)
        those = [
            (i, p)
            for i, kind in enumerate(kinds)
            for p in range(places)
            if trial == 0 or (kind.shape is not None and trial < len(grids[i][p]))
        ]
        along = []
        for i, p in those:
            one = blank.copy()
            one[i, p] = 1.0
            along.append((np.zeros(search.parameters), one, blank))
        columns = search.slopes(nominal.z, suspects, gain, along)
        for (i, p), h in zip(those, columns.T, strict=True):
            h = np.concatenate([h, np.zeros(e.size - n)])
            h = h - basis @ (basis.T @ h)
            size2 = float(h @ h)
            if not np.isfinite(size2) or size2 <= 0:
                continue
            size = -float(h @ left) / size2
            if kinds[i].positive and size < 0:
                continue
            drop = float(h @ left) ** 2 / size2 / total
            found = Candidate(i, p, size, float(shape[i, p]), drop)
            if (i, p) not in best or drop > best[i, p].drop:
                best[i, p] = found
    return sorted(best.values(), key=lambda each: -each.drop)


def suspects_of(search: Search, candidate: Candidate, share: float) -> Suspects:
    """A candidate's force at a share of the size it asks for, alone."""
    none = search.none()
    size, shape = np.array(none.size), np.array(none.shape)
    size[candidate.kind, candidate.place] = share * candidate.size
    shape[candidate.kind, candidate.place] = candidate.shape
    return replace_suspects(size, shape)
