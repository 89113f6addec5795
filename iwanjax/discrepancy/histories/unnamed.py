"""A general law where no named one explains the recordings: where it acts, and what it is like."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.discrepancy.findings import Suspect, UnnamedForce
from iwanjax.discrepancy.histories.general_law import (
    PlacedLaw,
    general_law,
    motion_of,
    where_a_law_acts,
)
from iwanjax.discrepancy.histories.likeness import described, nearest
from iwanjax.discrepancy.histories.place_test import like_no_linear_error, more_there
from iwanjax.discrepancy.histories.ranking import (
    TIME_CONSTANT,
    RankedFit,
    Scope,
    contains,
    doubted,
    least,
    linear,
    missing,
    ranked,
)
from iwanjax.discrepancy.histories.score_test import by_evidence, left_likely
from iwanjax.discrepancy.histories.selection import ModelSelection
from iwanjax.discrepancy.histories.validation import Runs, misfit
from iwanjax.discrepancy.judgement import Verdict, acting, beside_general_law, worse
from iwanjax.effects.kinds import Kind, UnnamedKind
from iwanjax.estimation.evidence import AS_LIKELY_WRONG
from iwanjax.identification.likelihood import covariance, left_by_noise
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.unnamed_law import UnnamedFit, force_in
from iwanjax.joints.unnamed_terms import PARTS
from iwanjax.settings.stages import settings


def unnamed_law(
    table: ModelSelection,
    problem: HistoryProblem,
    scope: Scope,
    there: Sequence[Place] = (),
) -> PlacedLaw:
    """The general law where it explains most, fitted to the free run.

    Parameters
    ----------
    table : ModelSelection
        How the named hypotheses ended.
    problem : HistoryProblem
        Of the model without any of them.
    scope : Scope
        Places, and how long there is time.
    there : sequence of Place
        The only places to try; by default where something acts most likely.
    """
    begun, law = table.general, partial(general_law, problem, table.nominal.fitted, table.entries)
    if begun and there and begun.fit.place.label not in {place.label for place in there}:
        begun = None
    # The best name may have come from elsewhere since.
    missed = {place.label for place in where_a_law_acts(table.best, scope.places)}
    missed -= begun.tried if begun else set()
    if begun is None or (missed and begun.fit.problem.data is not problem.data):
        likely, every = (by(table.places, scope.places) for by in (left_likely, by_evidence))
        begun = law(there, scope) if there else law(likely, scope, every)
    elif missed:
        begun = begun.or_rather(law([], scope))
    memories = (TIME_CONSTANT, problem.settings.selection.long_time_constant, math.inf)
    scope.progress(f"the general law at {begun.fit.place.label}, to the free run")
    fit = replace(begun.fit, problem=begun.fit.problem.with_steps_of(problem))
    return begun._replace(
        fit=fit.onward(memories, problem.settings.selection.polish, scope.in_time)
    )


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
    free: Callable[[RankedFit, list[str]], Runs],
) -> Beyond | None:
    """A general law where the best name leaves more than noise, and what then remains of the names.

    Also where no more is left than a linear model may be off by: where that is more than noise, for
    it may as well be what the name lacks, and where it is little more, but what no error of a
    linear model does and other laws at that place do
    (:func:`~iwanjax.discrepancy.histories.place_test.more_there`): a joint that hardly slips looks
    like a spring. And where names at several places explain the recordings, which one law at one of
    these may as well. Held-out recordings refuse the law where it predicts them worse than the best
    name, or the model without any.

    Parameters
    ----------
    table, problem, scope
        As for :func:`unnamed_law`.
    ended : Ended
        How the names ended.
    free : function
        Of an entry, and what fails on the way: its free runs.

    Returns
    -------
    Beyond or None
        None where a name at one place explains the recordings, be it but those fitted, of which
        alone a law can learn; or where the law explains less than the names do.
    """
    verdict, best, allowed, there = ended.verdict, ended.best, ended.allowed, list[Place]()
    if not verdict.detected or not scope.in_time():
        return None
    named = misfit(best, best, allowed)
    enough = problem.settings.selection.misfit * left_by_noise(problem)
    explained = least(table.nominal.fitted, table.entries).cost < enough
    if named.largest <= AS_LIKELY_WRONG or explained:
        found = _where_else(table, scope) if verdict.found else None
        if found is None:
            return None
        there = found
        # What a linear model may be off by is no part of this: only by how much noise scatters.
        allowed = math.sqrt(max(best[0].floor_95 ** 2 - best[0].floor ** 2, 0.0))
        named = misfit(best, best, allowed)
    placed = unnamed_law(table, problem, scope, there)
    failures: list[str] = []
    after = free(placed.entry, failures)
    if failures:
        raise RuntimeError(failures[0])
    # Names that the law contains predict better where it has learnt from noise.
    held, with_it = best[1], after[1]
    if held is not None and with_it is not None:
        refused = worse(held.relative, with_it.relative, held.floor_95)
    else:
        refused = False
    if refused:
        return None
    general = misfit(after, after, allowed)
    where = [place.label for place in where_a_law_acts(table.best, scope.places)]
    other = placed.probability if where and placed.fit.place.label not in where else 0.0
    elsewhere = 1.0 if len(where) > 1 else other
    now = beside_general_law(verdict, named, general, elsewhere)
    before = misfit(ended.before, after, allowed)
    probability = acting(now, before, general, placed.probability)
    if now.found or probability < settings().judgement.likely:
        return None
    force = characterised(placed, scope.kinds)
    kept = sum(now.named) / max(sum(verdict.named), 1e-300)
    return Beyond(now, kept, probability, after, placed.entry, force)


def _where_else(table: ModelSelection, scope: Scope) -> list[Place] | None:
    """Where another law may take off what names leave: no places for any, None for nowhere."""
    best, there = table.best, where_a_law_acts(table.best, scope.places)
    left = best.fitted.cost / left_by_noise(best.problem)
    share = settings().judgement.more_there
    # About what is far from the truth slopes do not tell what a law would take off, nor is the
    # place known: a fractional damper at the tip looks like an oscillator beside it.
    if not there or left > best.problem.settings.selection.misfit:
        return [] if there else None
    # One law at one place may be all that two names at two are: at one of these, where rivals are,
    # or, if it is linear, anywhere.
    if len(there) > 1:
        rivals = (where_a_law_acts(entry, scope.places) for entry in table.entries)
        every = [*there, *itertools.chain(*rivals), *scope.places]
        return list({place.label: place for place in every}.values())
    if left < 1.0 + share:
        return None
    scope.progress(f"what {best.fitted.hypothesis.label} leaves at its place")
    more = more_there(best.problem, best.fitted, there[0], scope.places).reduction
    return there if more > share * left_by_noise(best.problem) else None


def beside_linear(table: ModelSelection, scope: Scope) -> ModelSelection:
    """The same where nothing or a linear name is best and a law does what no linear error does.

    Beside these a law was ranked by what it takes off more than the model's own errors may be worth
    (:func:`~iwanjax.discrepancy.histories.ranking.ranked`). Where it leaves less than they do with
    any errors of mass, damping and stiffness, it is ranked by all that it takes off: a joint that
    hardly slips is no spring, though a spring leaves little; one that sticks a little is not
    nothing.

    Parameters
    ----------
    table : ModelSelection
        How the named hypotheses ended.
    scope : Scope
        Places where the linear model may be wrong, and how long there is time.
    """
    best, memory = table.best, table.nominal.fitted.time_constant
    if (table.detected and not linear(best)) or not scope.in_time():
        return table
    laws = [e for e in table.entries if e.fitted.time_constant == memory and not linear(e)]
    costs = [e.fitted.cost for e in laws if not table.detected or contains(e, best)]
    if min(costs, default=math.inf) >= best.fitted.cost:
        return table
    scope.progress(f"what {best.fitted.hypothesis.label} leaves to errors of the linear model")
    if not like_no_linear_error(best.problem, best.fitted, scope.places, min(costs)):
        return table
    base, entries = ranked(table.nominal, table.entries, beside_linear=False)
    found = missing(base, entries[0])
    entries = doubted(best.problem, entries) if found else entries
    return table._replace(detected=found, nominal=base, entries=tuple(entries))


def characterised(placed: PlacedLaw, kinds: Sequence[Kind]) -> UnnamedForce:
    """What the law does in the recordings: in words, by the names nearest to it, as curves.

    Parameters
    ----------
    placed : PlacedLaw
        As fitted.
    kinds : sequence of Kind
        Names to compare it with.
    """
    fit, motion = placed.fit, motion_of(placed.fit)
    parts = {name: np.asarray(force_in(fit.law.alone(name), motion)) for name in PARTS}
    force = np.sum(list(parts.values()), axis=0)
    hardest = int(np.argmax(np.max(np.abs(motion.d), axis=1)))
    backbone, deviation = _backbone(fit)
    return UnnamedForce(
        where=fit.place.label,
        law=fit.law,
        description=described(fit.law, motion, parts),
        nearest=nearest(kinds, fit.place.scales, motion, force),
        terms=float(np.sum(fit.determined)),
        path=np.stack([motion.d[hardest], force[hardest]]),
        backbone=backbone,
        deviation=deviation,
    )


def _backbone(fit: UnnamedFit) -> tuple[np.ndarray, np.ndarray]:
    """Virgin curve over the motion's range, (2, points), and its deviation.

    Linear in what the law is fitted by, with the covariance of the fit.
    """
    law, joint, last = fit.law, fit.problem.joints[-1], fit.problem.parameters
    reach = float(law.deflection)
    d = np.linspace(-reach, reach, 201)
    own = slice(last - joint.count, last)
    z = jnp.asarray(fit.fitted.theta.mean(axis=0)[own])
    slopes = np.asarray(jax.jacfwd(lambda z: joint.at(z).backbone(d))(z))
    known = covariance(fit.problem, fit.fitted)[own, own]
    variance = np.einsum("di,ij,dj->d", slopes, known, slopes)
    return np.stack([d, np.asarray(law.backbone(d))]), np.sqrt(np.maximum(variance, 0.0))
