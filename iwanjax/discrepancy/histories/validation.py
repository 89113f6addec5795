"""Validation in the free run: errors, what noise leaves, and what held-out recordings refuse."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy.findings import Refused
from iwanjax.discrepancy.histories.ranking import RankedFit, doubted, missing, ranked
from iwanjax.discrepancy.histories.selection import ModelSelection
from iwanjax.discrepancy.judgement import Misfit, worse
from iwanjax.identification.conditioning import ConditionedRecordings
from iwanjax.identification.force_noise import mean_and_scatter, moved_by_force_noise
from iwanjax.identification.free_values import drifting_values, elapsed, free_values, rates
from iwanjax.identification.likelihood import covariance
from iwanjax.identification.linearise import linearise, residuals_at
from iwanjax.identification.macroslip import Alternative
from iwanjax.identification.multistart import HypothesisFit, with_states_of_decays
from iwanjax.identification.problem import HistoryProblem
from iwanjax.settings.stages import settings
from iwanjax.signals.comparison_band import CORRELATION, OF_NOISE, over_pairs
from iwanjax.signals.noise import exceeded


class FreeRun(NamedTuple):
    """A free run against some recordings.

    Attributes
    ----------
    names : tuple of str
        Of the recordings.
    error : (recordings, N, sensors) array
        Measured less predicted; zero where nothing was measured.
    measured : (recordings, N, sensors) array
        As recorded, zero likewise.
    noise : (recordings,) array
        Mean square that the sensors' noise and the forces' leave, summed over the samples.
    scatter : (recordings,) array
        Variance of that sum: the forces' noise goes a few ways only, and so may leave much more
        than its mean; that of the sensors varies by the number of their samples.
    unsure : (recordings,) array
        The same of what the fitted recordings leave open of the parameters: linearised, and of
        where macroslip begins.
    estimated : (recordings, sensors + 1) array
        Deviation of each sensor's part of ``noise``, as its noise was estimated, and of that of
        forces that last. One sensor's error counts as the same in all recordings.
    """

    names: tuple[str, ...]
    error: np.ndarray
    measured: np.ndarray
    noise: np.ndarray
    scatter: np.ndarray
    unsure: np.ndarray
    estimated: np.ndarray

    @property
    def relative(self) -> float:
        """Root mean square of the error over that of what was measured; infinite if it diverges."""
        return math.sqrt(float(np.sum(_squares(self.error)) / np.sum(self.measured**2)))

    @property
    def floor(self) -> float:
        """The same of a perfect model."""
        return math.sqrt(float(np.sum(self.noise) / np.sum(self.measured**2)))

    @property
    def floor_95(self) -> float:
        """What a perfect model exceeds in one case of twenty."""
        doubt = np.sum(np.sum(self.estimated, axis=0) ** 2)
        square = _quantile(np.sum(self.noise), np.sum(self.scatter), doubt)
        return math.sqrt(float(square / np.sum(self.measured**2)))

    @property
    def spread(self) -> float:
        """The same of what uncertain parameters leave."""
        return math.sqrt(float(np.sum(self.unsure) / np.sum(self.measured**2)))

    def by_recording(self) -> Mapping[str, float]:
        """Relative errors, one for each recording."""
        square, whole = (_squares(x) for x in (self.error, self.measured))
        return dict(zip(self.names, np.sqrt(square / whole).tolist(), strict=True))

    def floors(self) -> Mapping[str, float]:
        """The same of a perfect model."""
        return self._by_name(self.noise)

    def floors_95(self) -> Mapping[str, float]:
        """What a perfect model exceeds in one case of twenty."""
        doubt = np.sum(self.estimated**2, axis=1)
        return self._by_name(_quantile(self.noise, self.scatter, doubt))

    def _by_name(self, square: np.ndarray) -> Mapping[str, float]:
        shares = np.sqrt(square / np.sum(self.measured**2, axis=(1, 2)))
        return dict(zip(self.names, shares.tolist(), strict=True))


def _squares(x: np.ndarray) -> np.ndarray:
    """Sum over each recording; infinite where a prediction has left the numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = np.sum(x**2, axis=(1, 2))
    return np.where(np.isnan(square), math.inf, square)


def _quantile(mean: np.ndarray, variance: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    r"""Exceeded in one case of twenty by a sum of squares whose mean is an estimate.

    Over it the sum has an F distribution with :math:`2 m^2/v` and :math:`2 m^2/v_d` degrees of
    freedom (Satterthwaite 1946), of its variance and that of the estimate; a gamma distribution
    where the mean is known.
    """
    # Infinite where nothing is uncertain.
    with np.errstate(divide="ignore", invalid="ignore"):
        own, estimate = (2.0 * np.square(mean) / np.asarray(x) for x in (variance, doubt))
    share = np.where(np.isfinite(mean) & (mean > 0), exceeded(own, estimate, 0.05), 1.0)
    return share * mean


def free_run(
    problem: HistoryProblem,
    fitted: HypothesisFit,
    other: Sequence[Alternative],
    batches: Sequence[tuple[ConditionedRecordings, Sequence[int]]],
) -> FreeRun:
    """A fitted model against recordings, integrated from rest under the measured forces.

    A free decay is integrated from the state that suits it best.

    Parameters
    ----------
    problem : HistoryProblem
        That the model was fitted with.
    fitted : HypothesisFit
        The model.
    other : sequence of Alternative
        Joints that the fitted recordings leave open as well.
    batches : sequence of (ConditionedRecordings, places)
        Recordings, as many to a batch as were fitted, with their places in the study, by which
        a joint's drift is told.
    """
    # A model that diverges beyond what it was fitted to says so by its error.
    with np.errstate(over="ignore", invalid="ignore"):
        parts = [_free(problem, fitted, other, each, places) for each, places in batches]
    return joined(parts)


def joined(parts: Sequence[FreeRun]) -> FreeRun:
    """Recordings one after the other, the shorter ones filled up with zeros."""
    names = tuple(name for part in parts for name in part.names)
    longest = max(part.error.shape[1] for part in parts)

    def filled(x: np.ndarray) -> np.ndarray:
        missing = longest - x.shape[1] if x.ndim > 2 else 0
        return np.pad(x, [(0, 0), (0, missing), (0, 0)]) if missing else x

    arrays = zip(*(map(filled, part[1:]) for part in parts), strict=True)
    return FreeRun(names, *(np.concatenate(each) for each in arrays))


def _free(
    problem: HistoryProblem,
    fitted: HypothesisFit,
    other: Sequence[Alternative],
    those: ConditionedRecordings,
    places: Sequence[int],
) -> FreeRun:
    here = replace(problem, data=those.data, forces=those.forces)
    count = len(those.names)
    theta = _expected(problem, fitted, places)
    R = problem.recordings
    rows = problem.still(np.stack([theta[min(i, count - 1)] for i in range(R)]))
    weight, y = (np.asarray(x)[:count] for x in (those.data.weight, those.data.response))
    safe = np.where(weight > 0, weight, np.inf)
    decays = np.asarray(those.data.kick)[:, 0] > 0
    if np.any(decays):
        rows = with_states_of_decays(here, fitted.hypothesis, rows, decays)
    (seen,) = linearise(here, [(fitted.hypothesis, rows)], math.inf)
    compared, variance = (weight > 0).astype(float), np.nan_to_num(those.noise) ** 2
    sensors = OF_NOISE**2 * np.sum(compared, axis=1) * variance
    own, estimated = np.sum(sensors, axis=1), sensors * np.sqrt(2.0 / those.freedom)
    # What the forces' noise does to the state after the pulse, of deviation 1 each.
    kicked = np.asarray(seen.slopes)[:count, fitted.values :] / safe[:, None]
    # A decay's state was estimated from itself: noise leaves it little to be wrong by.
    kicked[decays[:count]] = 0.0
    gram = np.einsum("rins,rjns->rij", kicked, kicked)
    own = own + np.einsum("rii->r", gram)
    # Of Gaussian errors with covariance S the variance of the sum of squares is 2 tr(S S); here
    # S is that of the sensors' noise, which the band correlates, plus that of the kicks.
    alone = np.sum(over_pairs(compared, CORRELATION**2) * variance**2, axis=1)
    both = np.sum(over_pairs(kicked, CORRELATION) * variance[:, None, :], axis=(1, 2))
    scatter = 2.0 * (alone + 2.0 * both + np.sum(gram**2, axis=(1, 2)))
    # The same of forces that act throughout.
    draws = problem.settings.conditioning.force_draws
    driven = moved_by_force_noise(here, fitted.hypothesis, rows, math.inf, draws)
    driven = driven[:, :count] / safe
    doubt = np.zeros(count)
    if len(driven):
        mean, of_mean = mean_and_scatter(driven)
        beside = np.sum(over_pairs(driven, CORRELATION) * variance, axis=2).mean(axis=0)
        own, scatter = own + mean, scatter + of_mean + 4.0 * beside
        doubt = np.sqrt(of_mean / len(driven))
    estimated = np.column_stack([estimated, doubt])
    known, slopes = _open(problem, fitted, places, np.asarray(seen.slopes)[:count])
    slopes = slopes / safe[:, None]
    open_to = np.einsum("rins,rjns->rij", slopes, slopes)
    unsure = np.einsum("rij,ij->r", open_to, known)
    p = problem.parameters
    moved = [np.hstack([rows[:, :p] + each.change, rows[:, p:]]) for each in other]
    residuals = residuals_at(here, [(fitted.hypothesis, each) for each in moved], math.inf)
    for each, residual in zip(other, residuals, strict=True):
        change = (residual - seen.residual)[:count] / safe
        unsure = unsure + each.weight * np.sum(change**2, axis=(1, 2))
    error, measured = seen.residual[:count] / safe, np.where(weight > 0, y, 0.0)
    return FreeRun(those.names, error, measured, own, scatter, unsure, estimated)


def _open(
    problem: HistoryProblem, fitted: HypothesisFit, places: Sequence[int], slopes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of what the recordings have in common, and derivatives in it at these places."""
    hypothesis = fitted.hypothesis
    shared, along = free_values(problem, hypothesis), rates(problem, hypothesis)
    columns = [slopes[:, shared]]
    if hypothesis.drifting is not None:
        own = slopes[:, drifting_values(problem, hypothesis.drifting)]
        columns.append(own * elapsed(problem, places)[: len(own), None, None, None])
    which = [*range(len(shared)), *along]
    known = covariance(problem, fitted)[np.ix_(which, which)]
    return known, np.concatenate(columns, axis=1)


def _expected(problem: HistoryProblem, fitted: HypothesisFit, places: Sequence[int]) -> np.ndarray:
    """Values for recordings at these places in the study: what drifts goes on in line."""
    theta, order = fitted.theta[:, : fitted.values], problem.order
    rows = np.tile(theta.mean(axis=0), (len(places), 1))
    if fitted.hypothesis.drifting is None:
        return rows
    if all(place in order for place in places):
        return theta[[order.index(place) for place in places]]
    values = drifting_values(problem, fitted.hypothesis.drifting)
    for value, rate in zip(values, rates(problem, fitted.hypothesis), strict=True):
        rows[:, value] = theta[0, value] + fitted.x[rate] * elapsed(problem, places)
    return rows


def zeros_off(run: FreeRun, sensors: Sequence[str]) -> list[str]:
    """Sensors of which a constant is more than half of what is left, in words.

    Parameters
    ----------
    run : FreeRun
        Of the best model.
    sensors : sequence of str
        Names of its columns.
    """
    # A run that has left the numbers shows no constant.
    with np.errstate(over="ignore", invalid="ignore"):
        samples = np.maximum(np.sum(run.measured != 0.0, axis=1), 1)
        mean, square = (np.sum(run.error**power, axis=1) / samples for power in (1, 2))
        most = np.isfinite(square) & (mean**2 > 0.5 * square)
    told = []
    for sensor, constants, shown in zip(sensors, mean.T, most.T, strict=True):
        pairs = zip(run.names, constants, strict=True)
        where = [f"{name} {own:+.2g}" for (name, own), on in zip(pairs, shown, strict=True) if on]
        if where:
            told.append(
                f"{sensor} is off by a constant, more than half of what is left there "
                f"({', '.join(where)}): if that is its zero, say response: {{offset: mean}}"
            )
    return told


Runs = tuple[FreeRun, FreeRun | None]


def misfit(run: Runs, best: Runs, model_error: float) -> Misfit:
    """Errors over what noise, an error that a right model may have, and open parameters leave.

    Noise by the model that fits best; one in which it grows beyond the signal predicts nothing.
    """
    (fitted, held_out), (noise, noise_held_out) = run, best
    allowed = math.hypot(noise.floor, model_error)
    of_fit = fitted.relative / allowed if noise.floor < 1.0 else math.inf
    if held_out is None or noise_held_out is None:
        return Misfit(of_fit, math.nan, (allowed, math.nan))
    spread = settings().judgement.uncertain * held_out.spread if best is run else 0.0
    foreseen = math.hypot(noise_held_out.floor_95, spread, model_error)
    of_held_out = held_out.relative / foreseen if foreseen < 1.0 else math.inf
    return Misfit(of_fit, of_held_out, (allowed, foreseen))


class Compared(NamedTuple):
    """What is left of a competition after the held-out recordings were looked at.

    Attributes
    ----------
    table : ModelSelection
        Without what was refused.
    before, after : (FreeRun, FreeRun or None)
        Free runs of the fitted and the held-out recordings: of the nominal model, and of the best
        that is left (the same where nothing is).
    refused : tuple of Refused
        What explains the fitted recordings and predicts those held out worse, the best first.
    """

    table: ModelSelection
    before: Runs
    after: Runs
    refused: tuple[Refused, ...]


def compared(table: ModelSelection, run: Callable[[RankedFit, bool], Runs]) -> Compared:
    """The best suspect that does not predict held-out recordings worse than the model without it.

    Held-out recordings do not choose: the order is that of the evidence of fitted ones, and each
    in turn is held against the nominal model alone. What they refute is out, and so is its
    evidence; where nothing is left nothing that was tried explains the recordings. The error told
    for the second in order was looked at once more than that of the first, which is why refusals
    are told with it.

    Parameters
    ----------
    table : ModelSelection
        How the competition ended.
    run : function
        Of an entry, and whether another one takes its place: its free runs.
    """
    before = run(table.nominal, table.detected)
    refused: list[Refused] = []
    while table.detected:
        after = run(table.best, False)
        if before[1] is None or after[1] is None:
            # One side alone, where the other's run failed, compares nothing.
            return Compared(table, (before[0], None), (after[0], None), ())
        errors = before[1].relative, after[1].relative
        if not worse(*errors, before[1].floor_95):
            return Compared(table, before, after, tuple(refused))
        refused.append(Refused(table.best.fitted.hypothesis.label, *errors))
        table = _without_the_best(table)
    if refused:
        before = run(table.nominal, False)
    return Compared(table, before, before, tuple(refused))


def _without_the_best(table: ModelSelection) -> ModelSelection:
    """The others, placed anew."""
    base, entries = ranked(table.nominal, table.entries[1:])
    same = [e for e in entries if e.fitted.time_constant == base.fitted.time_constant]
    if same:
        entries = [*doubted(base.problem, same), *entries[len(same) :]]
    detected = bool(same) and missing(base, entries[0])
    return table._replace(detected=detected, nominal=base, entries=tuple(entries))


def left_over(fitted: FreeRun, detected: bool, unknown: float, sensors: Sequence[str]) -> list[str]:
    """What to think of a residual that stays well above the noise."""
    ratio = fitted.relative / fitted.floor if fitted.floor < 1.0 else math.inf
    if ratio < settings().judgement.unexplained:
        return []
    off = f"The fitted recordings are still {ratio:.2g} times the noise off"
    if not detected:
        thought = f", but nothing that was tried explains it (probability {unknown:.2f})"
    elif unknown > settings().judgement.likely:
        thought = (
            ", so something else is missing as well, or what is missing is only like this "
            f"(probability {unknown:.2f})"
        )
    else:
        thought = ": the rest of the model is not exact, or something small is missing as well"
    return [off + thought, *zeros_off(fitted, sensors)]


def unforeseen(held_out: FreeRun) -> list[str]:
    """What to think of held-out recordings that are off by more than anything accounts for."""
    known = settings().judgement
    ratio = held_out.relative / math.hypot(held_out.floor_95, known.uncertain * held_out.spread)
    if ratio < known.unforeseen:
        return []
    return [
        f"The held-out recordings are off by {ratio:.2g} times what noise and uncertain parameters "
        "account for: either something acts only there, or the joints were fitted to the wrong "
        "end; hold out others and compare"
    ]
