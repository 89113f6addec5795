"""Several hits in one curve, and how well they repeat each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.results import AbstractResult

# Levels on either side that share their repeatability: too few hits reach each alone.
_NEIGHBOURS = 2


@dataclass(frozen=True, eq=False)
class MergedCurves(AbstractResult):
    r"""Result of :func:`merge_curves`; all arrays are (levels,), amplitudes rise.

    Attributes
    ----------
    curves : ModalCurves
        The hits' common curve with the standard deviation of that mean,
        :math:`\sqrt{\tau^2/n + 1/\sum w}`.
    count : array of int
        Hits n that reach the level.
    frequency_repeatability, damping_repeatability : array
        Deviation :math:`\tau` from hit to hit that the estimators' own does not explain,
        Hz and 1.
    frequency_estimator, damping_estimator : array
        Median over the hits of one estimate's deviation at the level, from its noise alone.
    frequency_spread, damping_spread : array
        Root mean square of the hits about the common curve, both kinds together.
    hits : tuple of ModalCurves
        What was merged.
    """

    curves: ModalCurves
    count: np.ndarray
    frequency_repeatability: np.ndarray
    damping_repeatability: np.ndarray
    frequency_estimator: np.ndarray
    damping_estimator: np.ndarray
    frequency_spread: np.ndarray
    damping_spread: np.ndarray
    hits: tuple[ModalCurves, ...]

    _shown = (
        "curves",
        "count",
        "frequency_repeatability",
        "damping_repeatability",
        "frequency_estimator",
        "damping_estimator",
        "hits",
    )
    _units: ClassVar = {
        "frequency_repeatability": "Hz",
        "damping_repeatability": "1",
        "frequency_estimator": "Hz",
        "damping_estimator": "1",
    }

    @property
    def next_hit(self) -> ModalCurves:
        """The common curve with the deviations of one more hit: repeatability and estimator."""
        c = self.curves
        return ModalCurves(
            c.amplitude,
            c.frequency,
            c.damping,
            amplitude_std=c.amplitude_std,
            frequency_std=np.hypot(self.frequency_repeatability, self.frequency_estimator),
            damping_std=np.hypot(self.damping_repeatability, self.damping_estimator),
            quantity=c.quantity,
            unit=c.unit,
            name=c.name,
            largest=c.largest,
        )

    @property
    def weighted_hits(self) -> tuple[ModalCurves, ...]:
        """The hits, each level's deviation with the repeatability added: what a fit should weigh.

        Beyond the levels that two hits share the repeatability is that of the nearest.
        """
        return tuple(self.weighted(hit) for hit in self.hits)

    def weighted(self, hit: ModalCurves) -> ModalCurves:
        """A hit of the mode with the repeatability added to its deviations."""
        at, known = (np.log(np.asarray(c.amplitude)) for c in (hit, self.curves))
        return ModalCurves(
            hit.amplitude,
            hit.frequency,
            hit.damping,
            amplitude_std=hit.amplitude_std,
            frequency_std=np.hypot(
                np.asarray(hit.frequency_std), np.interp(at, known, self.frequency_repeatability)
            ),
            damping_std=np.hypot(
                np.asarray(hit.damping_std), np.interp(at, known, self.damping_repeatability)
            ),
            quantity=hit.quantity,
            unit=hit.unit,
            name=hit.name,
            largest=hit.largest,
        )


def merge_curves(curves: Sequence[ModalCurves], levels: int | None = None) -> MergedCurves:
    r"""One curve from several hits, at amplitudes that at least two of them reach.

    At each level hit h gives :math:`y_h \pm s_h`, linear in the logarithm of the amplitude
    between its points. Its weight is :math:`w_h = 1/(s_h^2 + \tau^2)`; the variance
    :math:`\tau^2` from hit to hit is the part of the scatter that the :math:`s_h` do not
    explain (DerSimonian and Laird 1986), averaged over neighbouring levels.

    With a joint that remembers its largest amplitude (:class:`iwanjax.Iwan5`) hits of different
    strength have curves of their own: fit those side by side instead.

    Parameters
    ----------
    curves : sequence of ModalCurves
        At least two, of one quantity and unit, with standard deviations.
    levels : int, optional
        Number of levels; by default as dense as the hits' own points.

    Returns
    -------
    MergedCurves

    Raises
    ------
    InputError
        For fewer than two curves, different quantities, missing deviations, or hits that
        share no amplitude.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> q, one = np.geomspace(1e-3, 1e-1, 20), np.ones(20)
    >>> std = {"frequency_std": 1e-2 * one, "damping_std": 1e-4 * one}
    >>> hits = [ij.ModalCurves(k * q, 10.0 - k * q, 1e-3 * one, **std) for k in (1.0, 2.0)]
    >>> merged = ij.merge_curves(hits, levels=8)
    >>> merged.curves.frequency.shape
    (8,)
    """
    hits = tuple(curves)
    _check(hits)
    logs = [np.sort(np.log(np.asarray(hit.amplitude))) for hit in hits]
    lows, highs = np.sort([x[0] for x in logs]), np.sort([x[-1] for x in logs])
    low, high = lows[1], highs[-2]
    if high <= low:
        raise _shares_nothing(logs)
    if levels is not None and levels < 2:
        raise InputError(f"merge_curves: levels = {levels}; expected at least 2")
    step = float(np.median(np.concatenate([np.diff(x) for x in logs])))
    count = levels or max(3, round((high - low) / step) + 1)
    at = np.linspace(low, high, count)
    frequency = _merged(hits, at, "frequency")
    damping = _merged(hits, at, "damping")
    reached = np.isfinite(frequency.values).sum(axis=0)
    keep = reached >= 2
    if np.count_nonzero(keep) < 2:
        # Between the second lowest beginning and the second highest end each may be alone.
        raise _shares_nothing(logs)
    first = hits[0]
    known = [float(hit.largest) for hit in hits if hit.largest is not None]
    merged = ModalCurves(
        np.exp(at[keep]),
        frequency.mean[keep],
        damping.mean[keep],
        frequency_std=frequency.mean_std[keep],
        damping_std=damping.mean_std[keep],
        quantity=first.quantity,
        unit=first.unit,
        name=first.name,
        largest=max(known) if len(known) == len(hits) else None,
    )
    return MergedCurves(
        merged,
        reached[keep],
        frequency.between[keep],
        damping.between[keep],
        frequency.within[keep],
        damping.within[keep],
        frequency.spread[keep],
        damping.spread[keep],
        hits,
    )


def _shares_nothing(logs: Sequence[np.ndarray]) -> InputError:
    """Of hits by their ordered logarithms of amplitude."""
    ranges = ", ".join(f"{np.exp(x[0]):.3g} to {np.exp(x[-1]):.3g}" for x in logs)
    return InputError(
        f"merge_curves: no amplitude is reached by two hits (they reach {ranges}); analyse them "
        "one by one"
    )


@dataclass(frozen=True)
class _Merged:
    values: np.ndarray
    mean: np.ndarray
    mean_std: np.ndarray
    between: np.ndarray
    within: np.ndarray
    spread: np.ndarray


def _merged(hits: Sequence[ModalCurves], at: np.ndarray, name: str) -> _Merged:
    """Means and variances of one quantity over the hits, at each level."""
    pairs = [_interpolated(hit, at, name) for hit in hits]
    values, variances = (np.stack(column) for column in zip(*pairs, strict=True))
    reached = np.isfinite(values)
    n = np.maximum(reached.sum(axis=0), 1)

    def weighted(weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        total = np.maximum(weight.sum(axis=0), np.finfo(float).tiny)
        return np.nansum(weight * np.nan_to_num(values), axis=0) / total, total, weight

    mean, total, weight = weighted(np.where(reached, 1.0 / variances, 0.0))
    scatter = np.nansum(weight * (np.nan_to_num(values) - mean) ** 2, axis=0)
    scale = total - (weight**2).sum(axis=0) / total
    excess = np.where(n > 1, (scatter - (n - 1)) / np.where(scale > 0, scale, 1.0), 0.0)
    between = np.maximum(_smoothed(excess, n - 1.0), 0.0)
    mean, total, _ = weighted(np.where(reached, 1.0 / (variances + between), 0.0))
    deviation = np.where(reached, np.nan_to_num(values) - mean, 0.0)
    return _Merged(
        values,
        mean,
        np.sqrt(1.0 / total),
        np.sqrt(between),
        np.sqrt(np.nanmedian(np.where(reached | ~reached.any(axis=0), variances, np.nan), axis=0)),
        np.sqrt((deviation**2).sum(axis=0) / np.maximum(n - 1, 1)),
    )


def _interpolated(hit: ModalCurves, at: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Values and variances of a hit at levels of ln(amplitude); NaN and 1 beyond its range."""
    x = np.log(np.asarray(hit.amplitude))
    order = np.argsort(x)
    x, y, s = x[order], *(np.asarray(getattr(hit, n))[order] for n in (name, f"{name}_std"))
    inside = (at >= x[0]) & (at <= x[-1])
    i = np.clip(np.searchsorted(x, at) - 1, 0, x.size - 2)
    share = (at - x[i]) / (x[i + 1] - x[i])
    value = (1.0 - share) * y[i] + share * y[i + 1]
    variance = ((1.0 - share) * s[i]) ** 2 + (share * s[i + 1]) ** 2
    return np.where(inside, value, np.nan), np.where(inside, variance, 1.0)


def _smoothed(value: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Mean over neighbouring levels, weighted."""
    i = np.arange(value.size)
    near = (np.abs(np.subtract.outer(i, i)) <= _NEIGHBOURS) * weight
    total = near.sum(axis=1)
    return near @ value / np.where(total > 0, total, 1.0)


def _check(hits: Sequence[ModalCurves]) -> None:
    if len(hits) < 2:
        raise InputError(f"merge_curves: got {len(hits)} curve(s); expected at least two hits")
    kinds = {(hit.quantity, hit.unit) for hit in hits}
    if len(kinds) > 1:
        raise InputError(
            f"merge_curves: the hits are of different amplitudes {sorted(kinds)}; bring them to "
            "one with ModalCurves.as_quantity"
        )
    for i, hit in enumerate(hits):
        if hit.frequency_std is None or hit.damping_std is None:
            raise InputError(f"merge_curves: hit {i} has no standard deviations")
        if not (
            np.all(np.asarray(hit.frequency_std) > 0) and np.all(np.asarray(hit.damping_std) > 0)
        ):
            raise InputError(f"merge_curves: hit {i} has deviations of zero; expected positive")
        if hit.amplitude.ndim != 1 or hit.amplitude.size < 2:
            raise InputError(
                f"merge_curves: hit {i} has shape {hit.amplitude.shape}; expected (levels,)"
            )
