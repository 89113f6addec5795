"""A general law where no named one explains the recordings: where it acts, and what it is like."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.discrepancy.findings import Suspect, UnnamedForce
from iwanjax.discrepancy.histories.likeness import described, nearest
from iwanjax.discrepancy.histories.ranking import STEPS, TIME_CONSTANT, RankedFit, Scope
from iwanjax.discrepancy.histories.restarts import FAR
from iwanjax.discrepancy.histories.score_test import by_evidence
from iwanjax.discrepancy.histories.selection import ModelSelection
from iwanjax.discrepancy.histories.validation import Runs, misfit
from iwanjax.discrepancy.judgement import Verdict, acting, beside_general_law, worse
from iwanjax.effects.kinds import ForceKind, UnnamedKind
from iwanjax.estimation.evidence import AS_LIKELY_WRONG, shares
from iwanjax.estimation.settings import SEARCH
from iwanjax.identification.innovations import AtSamples
from iwanjax.identification.kernels import observed
from iwanjax.identification.likelihood import covariance, evidence, left_by_noise, scale
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.unnamed_law import UnnamedFit, fit_unnamed_law
from iwanjax.joints import PlaceMotion, UnnamedLaw, hysteresis
from iwanjax.joints.unnamed_terms import PARTS
from iwanjax.settings.stages import settings

# Of the logarithm of a largest deflection: a quarter of the outermost interval of the spring.
_TO_SCALE = 0.05


class PlacedLaw(NamedTuple):
    """The general law at the best of some places.

    Attributes
    ----------
    fit : UnnamedFit
        In the free run.
    probability : float
        Of its place among those that were tried.
    """

    fit: UnnamedFit
    probability: float

    @property
    def entry(self) -> RankedFit:
        """As the other hypotheses are."""
        return RankedFit(self.fit.problem, self.fit.fitted)


def unnamed_law(table: ModelSelection, problem: HistoryProblem, scope: Scope) -> PlacedLaw:
    """The general law where it explains most, fitted to the free run.

    Each of the places where something acts most likely, by all laws there at once, is tried with
    the shortest memory, for a few steps from the joints of the nominal fit and as given. The best
    is gone on with, and the others as well where it leaves much more than noise.

    Parameters
    ----------
    table : ModelSelection
        How the named hypotheses ended.
    problem : HistoryProblem
        Of the model without any of them.
    scope : Scope
        Places, and how long there is time.
    """
    known = problem.settings.selection
    z = table.nominal.fitted.theta.mean(axis=0)[: problem.parameters]
    joints, short = [z, problem.with_given_joints(z)], (SHORT_TIME_CONSTANT,)
    tried: list[UnnamedFit] = []
    for place in by_evidence(table.places, scope.places)[: known.finalists]:
        if tried and not scope.in_time():
            break
        scope.progress(f"a general law at {place.label}")
        begun = problem, UnnamedKind(), place, joints, short
        tried.append(fit_unnamed_law(*begun, SEARCH.head_start, scope.in_time))
    first, *others = sorted(tried, key=lambda each: each.fitted.cost)
    ended = [first.onward(short, STEPS, scope.in_time)]
    if ended[0].fitted.cost > FAR * left_by_noise(problem):
        others = [each.onward(short, STEPS, scope.in_time) for each in others]
    ended += others
    odds = _odds(ended)
    best = int(np.argmax(odds))
    memories = (TIME_CONSTANT, known.long_time_constant, math.inf)
    scope.progress(f"the general law at {ended[best].place.label}, to the free run")
    found = _to_scale(ended[best], problem, scope)
    found = found.onward(memories, known.polish, scope.in_time)
    return PlacedLaw(found, float(odds[best]))


def _to_scale(found: UnnamedFit, problem: HistoryProblem, scope: Scope) -> UnnamedFit:
    """The fit with a law of the motions that it has itself, where those differ from the law's.

    What a place has seen was told by a model without the law. Of terms beyond what it has really
    seen the recordings say nothing.
    """
    motion = _motion(found, float(problem.predictor.dt) * problem.predictor.substeps)
    largest, fastest = (float(jnp.max(jnp.abs(x))) for x in (motion.d, motion.v))
    if abs(math.log(largest / float(found.law.deflection))) < _TO_SCALE or not scope.in_time():
        return found
    seen = found.place.scales._replace(deflection=largest, period=2.0 * math.pi * largest / fastest)
    z = found.fitted.theta.mean(axis=0)[: problem.parameters]
    begun = problem, UnnamedKind(), replace(found.place, scales=seen), [z]
    return fit_unnamed_law(*begun, (SHORT_TIME_CONSTANT,), STEPS, scope.in_time)


class Ended(NamedTuple):
    """How the named hypotheses ended.

    Attributes
    ----------
    verdict : Verdict
        On them.
    before, after : (FreeRun, FreeRun or None)
        Of the nominal model, and with the best of them.
    allowed : float
        Relative error that a right model may have.
    """

    verdict: Verdict
    before: Runs
    after: Runs
    allowed: float

    @property
    def best(self) -> Runs:
        """Of the model that fits better."""
        return min(self.before, self.after, key=lambda run: run[0].relative)


class Beyond(NamedTuple):
    """A verdict with a law that has no name.

    Attributes
    ----------
    verdict : Verdict
        What is left of the names.
    kept : float
        Share of the names' probabilities that is left to them.
    probability : float
        That something acts at the law's place.
    after : (FreeRun, FreeRun or None)
        Of the model with the law.
    entry : RankedFit
        That model.
    force : UnnamedForce
        The law, and what it is like.
    """

    verdict: Verdict
    kept: float
    probability: float
    after: Runs
    entry: RankedFit
    force: UnnamedForce

    def among(self, named: Sequence[Suspect]) -> list[Suspect]:
        """The law and the names, by probability; where that is the same the law first."""
        own = Suspect(UnnamedKind(), self.force.where, self.probability, 0.0, ())
        behind = math.log(max(self.kept, 1e-300))
        others = [
            each._replace(
                probability=self.kept * each.probability, log_evidence=each.log_evidence + behind
            )
            for each in named
        ]
        return sorted([own, *others], key=lambda each: -each.probability)


def beyond_names(
    table: ModelSelection,
    problem: HistoryProblem,
    scope: Scope,
    ended: Ended,
    sampling_rate: float,
    free: Callable[[RankedFit, list[str]], Runs],
) -> Beyond | None:
    """A general law where the best name leaves more than noise, and what then remains of the names.

    Held-out recordings refuse it as they refuse every name.

    Parameters
    ----------
    table, problem, scope
        As for :func:`unnamed_law`.
    ended : Ended
        How the names ended.
    sampling_rate : float
        Hz.
    free : function
        Of an entry, and what fails on the way: its free runs.

    Returns
    -------
    Beyond or None
        None where a name explains the recordings, or the law explains less than the names do.
    """
    verdict, best, allowed = ended.verdict, ended.best, ended.allowed
    named = misfit(best, best, allowed)
    if not verdict.detected or named.largest <= AS_LIKELY_WRONG or not scope.in_time():
        return None
    placed = unnamed_law(table, problem, scope)
    failures: list[str] = []
    after = free(placed.entry, failures)
    if failures:
        raise RuntimeError(failures[0])
    held, with_it = ended.before[1], after[1]
    if held is not None and with_it is not None:
        refused = worse(held.relative, with_it.relative, held.floor_95)
    else:
        refused = False
    if refused:
        return None
    general = misfit(after, after, allowed)
    now = beside_general_law(verdict, named, general)
    before = misfit(ended.before, after, allowed)
    probability = acting(now, before, general, placed.probability)
    if now.found or probability < settings().judgement.likely:
        return None
    kinds = [kind for kind in scope.kinds if isinstance(kind, ForceKind)]
    force = characterised(placed, kinds, sampling_rate)
    kept = sum(now.named) / max(sum(verdict.named), 1e-300)
    return Beyond(now, kept, probability, after, placed.entry, force)


def _odds(tried: Sequence[UnnamedFit]) -> np.ndarray:
    """Probabilities of places, by what the law leaves there, the best one's own error allowed."""
    fits = [each.fitted for each in tried]
    first = min(tried, key=lambda each: each.fitted.cost)
    unit = scale(first.problem, first.fitted)
    known = evidence(first.problem, fits)
    return shares(known.values * (known.temperature * known.tau / max(unit, 1.0)))


def characterised(
    placed: PlacedLaw, kinds: Sequence[ForceKind], sampling_rate: float
) -> UnnamedForce:
    """What the law does in the recordings: in words, by the names nearest to it, as curves.

    Parameters
    ----------
    placed : PlacedLaw
        As fitted.
    kinds : sequence of ForceKind
        Names to compare it with.
    sampling_rate : float
        Hz.
    """
    fit, dt = placed.fit, 1.0 / sampling_rate
    motion = _motion(fit, dt)
    parts = {name: _force(fit.law.alone(name), motion) for name in PARTS}
    force = np.sum(list(parts.values()), axis=0)
    hardest = int(np.argmax(np.max(np.abs(motion.d), axis=1)))
    backbone, deviation = _backbone(fit)
    return UnnamedForce(
        where=fit.place.label,
        law=fit.law,
        description=described(fit.law, motion, parts),
        nearest=nearest(kinds, motion, force),
        terms=float(np.sum(fit.determined)),
        path=np.stack([motion.d[hardest], force[hardest]]),
        backbone=backbone,
        deviation=deviation,
    )


def _motion(fit: UnnamedFit, dt: float) -> PlaceMotion:
    """What the place did in the fitted recordings, by the model with the law: (recordings, N)."""
    problem, fitted = fit.problem, fit.fitted
    here = fitted.hypothesis.suspects._replace(row=jnp.asarray(fit.place.row)[None])
    gain = problem.gains(
        [here], fitted.theta.mean(axis=0)[None], fitted.time_constant, slopes=False
    ).gain[0]
    varied = jax.device_put((fitted.theta, gain))
    seen = AtSamples(*observed(problem.predictor, problem.joints, here, *varied, problem.data))
    d, v, a = (np.asarray(x)[..., 0] for x in (seen.d, seen.v, seen.a))
    moved = np.diff(d, axis=1, prepend=0.0)
    return PlaceMotion(*jax.device_put((d, v, a, moved, np.asarray(dt))))


def _force(law: UnnamedLaw, motion: PlaceMotion) -> np.ndarray:
    return np.asarray(hysteresis(law, motion.d, dt=float(motion.dt)))


def _backbone(fit: UnnamedFit) -> tuple[np.ndarray, np.ndarray]:
    """Virgin curve over the motion's range, (2, points), and its deviation.

    Linear in the strengths, whose covariance is that of the fit.
    """
    law, last = fit.law, fit.problem.parameters
    reach = float(law.deflection)
    d = np.linspace(-reach, reach, 201)
    strengths = jnp.stack(law.strengths)
    slopes = np.asarray(jax.jacfwd(lambda s: law.with_strengths(s).backbone(d))(strengths))
    slopes = slopes * np.asarray(fit.problem.joints[-1].loose)
    own = slice(last - slopes.shape[1], last)
    known = covariance(fit.problem, fit.fitted)[own, own]
    variance = np.einsum("di,ij,dj->d", slopes, known, slopes)
    return np.stack([d, np.asarray(law.backbone(d))]), np.sqrt(np.maximum(variance, 0.0))
