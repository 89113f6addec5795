"""A general law where something acts most likely."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.discrepancy.histories.likeness import SizedLaw
from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
)
from iwanjax.discrepancy.histories.restarts import FAR, linear_law, linear_laws
from iwanjax.effects.kinds import ForceKind, JointKind, UnnamedKind
from iwanjax.estimation.evidence import MODEL_ERROR_ALLOWANCE, shares
from iwanjax.estimation.settings import SEARCH
from iwanjax.identification import hypotheses
from iwanjax.identification.innovations import AtSamples
from iwanjax.identification.kernels import observed
from iwanjax.identification.likelihood import evidence, left_by_noise, scale
from iwanjax.identification.linearise import squares_at
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, HypothesisFit
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.unnamed_law import (
    SHAPED,
    UnnamedFit,
    blank_at,
    fit_unnamed_law,
    force_in,
    nearest_strengths,
    resonating,
)
from iwanjax.joints import AttachedOscillator, PlaceMotion
from iwanjax.joints.duhem import nearest_branch, scaled
from iwanjax.joints.unnamed_terms import BENDS, DUHEM, FEW, LINEAR, PARTS, POWERS, RESONATES

# Terms of a force that depends on where the motion has been.
_HYSTERESIS = ("sliders", "yielding", "bristles")
# Of the logarithm of a largest deflection: a quarter of the outermost interval of the spring.
_TO_SCALE = 0.05


class PlacedLaw(NamedTuple):
    """The general law at the best of some places.

    Attributes
    ----------
    fit : UnnamedFit
        As far as it got.
    probability : float
        Of its place among those that were tried, or that there was no time for.
    coarse : bool
        Whether steps between samples may be too long for the law at one of them: the best named
        force stops it within a step.
    tried : frozenset of str
        Those places.
    """

    fit: UnnamedFit
    probability: float
    coarse: bool
    tried: frozenset[str]

    @property
    def entry(self) -> RankedFit:
        """As the other hypotheses are."""
        return RankedFit(self.fit.problem, self.fit.fitted)

    def or_rather(self, other: "PlacedLaw") -> "PlacedLaw":
        """The better of two, with all the places that were tried for either."""
        both = self, other
        odds = _odds([each.fit for each in both])
        best = int(np.argmax(odds))
        return both[best]._replace(
            probability=float(odds[best]) * both[best].probability,
            coarse=self.coarse or other.coarse,
            tried=self.tried | other.tried,
        )


def general_law(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    entries: Sequence[RankedFit],
    places: Sequence[Place],
    scope: Scope,
    further: Sequence[Place] = (),
) -> PlacedLaw:
    """The general law where it explains most, fitted with the shortest memory.

    The place of the best name (slopes may point to one that looks like it, and a law that is not
    tried there says nothing against the name) and those where something acts most likely, by all
    laws there at once, are tried for a few steps: from the joints of the nominal fit and as given,
    from what the best named force there does, for from no force there may be no way to a large one,
    and where that is no name from an attached oscillator. The best is gone on with, as it is or
    with a spring that yields along a curve in place of other hysteresis; where it leaves more than
    noise the next one is as well, and that goes on which leaves least with a longer memory.

    Parameters
    ----------
    problem : HistoryProblem
        Of the model without any suspect.
    nominal : HypothesisFit
        That model.
    entries : sequence of RankedFit
        Named suspects, the best first.
    places : sequence of Place
        The likeliest first.
    scope : Scope
        How long there is time.
    further : sequence of Place
        Less likely ones, where the law explains little at those, or is nothing but linear.
    """
    most, far = problem.settings.selection.finalists, FAR * left_by_noise(problem)
    named = [place for each in entries[:1] for place in where_a_law_acts(each, scope.places)]
    other = [place for place in places if place.label not in {each.label for each in named}]
    likely, tried = [*named, *other][:most], list[tuple[UnnamedFit, bool]]()
    there = {place.label: place for place in [*likely, *further]}
    for place in list(there.values())[:most]:
        # Columns about joints that are bent tell less of where something acts than a fit does.
        enough = len(tried) >= len(likely) and min(each.fitted.cost for each, _ in tried) < far
        if tried and (enough or not scope.in_time()):
            break
        tried.append(_begun_at(place, problem, nominal, entries, scope))
    fits = [each for each, _ in tried]
    if min(fits, key=lambda each: each.fitted.cost).joint.free == LINEAR:
        # Columns exclude no place of what is linear: joints have been bent to do most of it.
        known = {each.place.label for each in fits}
        every = {place.label: place for place in [*other, *further] if place.label not in known}
        fits = linear_laws(problem, nominal, list(every.values()), scope, fits)
    begun, ways = sorted(fits, key=lambda each: each.fitted.cost), list[_Way]()
    explained = problem.settings.selection.misfit * left_by_noise(problem, TIME_CONSTANT)
    for each in begun:
        # A few steps from where they begin costs differ by chance, unless one explains it all.
        ways.append(_best_way(each, problem, nominal, scope))
        if ways[-1].left < explained or not scope.in_time():
            break
    odds = _odds([way.lasting for way in ways])
    best = int(np.argmax(odds))
    found = ways[best].fit
    rest = _odds([found, *begun[len(ways) :]])
    # What there was no time for is as likely as what was tried.
    sure = float(odds[best] * rest[0]) / (1 + max(len(likely) - len(tried), 0))
    coarse, known = any(stopped for _, stopped in tried), frozenset(x.place.label for x, _ in tried)
    return PlacedLaw(_to_scale(found, problem, scope), sure, coarse, known)


def where_a_law_acts(entry: RankedFit, places: Sequence[Place]) -> list[Place]:
    """Places of what is suspected, where all of it are laws of the motion there; else none."""
    hypothesis = entry.fitted.hypothesis
    laws = all(
        isinstance(k, ForceKind) or (isinstance(k, JointKind) and (k.law or k.element))
        for k in hypothesis.kinds
    )
    there = [place for place in places if place.label in hypothesis.where]
    return there if laws and len(there) == len(set(hypothesis.where)) else []


def _begun_at(
    place: Place,
    problem: HistoryProblem,
    nominal: HypothesisFit,
    entries: Sequence[RankedFit],
    scope: Scope,
) -> tuple[UnnamedFit, bool]:
    """The law at a place after a few steps, and whether the best named force there stops it."""
    scope.progress(f"a general law at {place.label}")
    z = nominal.theta.mean(axis=0)[: problem.parameters]
    forces = [e for e in entries if e.problem is problem and _forces_at(e.fitted, place)]
    beside, blank, stopped = problem.begun_beside(z), blank_at(place), False
    short, in_time = (SHORT_TIME_CONSTANT,), scope.in_time
    linear = linear_law(place, problem, nominal, scope)
    joints = linear.fitted.theta.mean(axis=0)[: problem.parameters]
    starts = [hypotheses.LawStart(linear.law, joints)]
    for each in forces[:1]:
        motion, force = _named_force(each.fitted, problem, place)
        stopped = place.stopped(motion.v, force, float(problem.predictor.dt))
        own = each.fitted.theta.mean(axis=0)[: problem.parameters]
        # A spring of splines, or one of powers.
        for less in (POWERS, BENDS):
            near = nearest_strengths(place, motion, force, np.setdiff1d(FEW, less))
            starts.append(hypotheses.LawStart(blank.with_strengths(near), own))
    if not any(isinstance(k, JointKind) and k.law is AttachedOscillator for k in scope.kinds):
        starts.append(resonating(problem, place, beside, STEPS, in_time))
    found = fit_unnamed_law(
        problem, UnnamedKind(), place, starts, short, SEARCH.head_start, in_time
    )
    return found if found.gains_on(linear) else linear, stopped


class _Way(NamedTuple):
    """A law at a place with the shortest memory, and what becomes of it with the next one."""

    fit: UnnamedFit
    lasting: UnnamedFit

    @classmethod
    def of(cls, found: UnnamedFit, scope: Scope) -> "_Way":
        """A few steps on."""
        return cls(found, found.onward((TIME_CONSTANT,), STEPS, scope.in_time))

    @property
    def left(self) -> float:
        """Squared residual, with the longer memory."""
        return self.lasting.fitted.cost


def _best_way(
    first: UnnamedFit, problem: HistoryProblem, nominal: HypothesisFit, scope: Scope
) -> _Way:
    """Gone on with as it is, or with a spring that yields along a curve: what lasts.

    With a short memory of the observer either comes near to what the other does. Where hysteresis
    does more to the recordings than is left of them the curve goes first, as it has a third of the
    parameters; where only what is linear takes part it comes after, for with that memory pinched
    hysteresis in a joint looks like relaxation.
    """
    curves = (_gone_on_with(each, scope) for each in _along_a_curve(first, problem, scope))
    if _done_by_hysteresis(first, problem, nominal):
        ways = itertools.chain(curves, (_gone_on_with(each, scope) for each in [first]))
    else:
        found = _gone_on_with(first, scope)
        if found.joint.free != LINEAR and not _done_by_hysteresis(found, problem, nominal):
            return _Way.of(found, scope)
        ways = itertools.chain([found], curves)
    noise, tried = left_by_noise(problem, TIME_CONSTANT), list[_Way]()
    for each in ways:
        tried.append(_Way.of(each, scope))
        if tried[-1].left < (1.0 + MODEL_ERROR_ALLOWANCE) * noise:
            break
    return min(tried, key=lambda way: way.left)


def _done_by_hysteresis(found: UnnamedFit, problem: HistoryProblem, nominal: HypothesisFit) -> bool:
    """Whether hysteresis does more to the recordings than is left of them.

    That is its share of the force's share in what a law takes away.
    """
    point, memory = (nominal.hypothesis, nominal.theta), found.fitted.time_constant
    (before,), noise = squares_at(problem, [point], memory), left_by_noise(problem, memory)
    motion = _first(motion_of(found), problem)
    whole = np.asarray(force_in(found.law, motion))
    part = np.asarray(force_in(found.law.alone(*_HYSTERESIS), motion))
    share = np.linalg.norm(part) / max(np.linalg.norm(whole), 1e-300)
    left = max(found.fitted.cost - noise, MODEL_ERROR_ALLOWANCE * noise)
    return bool(share**2 * (before - found.fitted.cost) > left)


def _along_a_curve(
    found: UnnamedFit, problem: HistoryProblem, scope: Scope
) -> Iterator[UnnamedFit]:
    """Fits with a spring that yields along a curve, which begins as the force that is known.

    From the joints as given and from those of that fit each by itself: after a few steps joints
    that are bent leave less, and never find back.
    """
    place = found.place
    scope.progress(f"a general law at {place.label}, which yields along a curve")
    law, motion = found.law, _first(motion_of(found), problem)
    begun, seen = [], (np.asarray(motion.d), np.asarray(motion.v))
    # What it yields with: all of the force, or what of it is hysteresis.
    for part, others in ((law, 0.0), (law.alone(*_HYSTERESIS), 1.0)):
        strength, branch = nearest_branch(*seen, np.asarray(force_in(part, motion)))
        strengths = others * np.stack(law.strengths)
        strengths[PARTS["duhem"]] = strength
        shape = scaled(branch, float(law.deflection))
        begun.append(law.with_strengths(strengths).with_branch(shape))
    known = (SHORT_TIME_CONSTANT,), SEARCH.head_start, scope.in_time, DUHEM
    beside = problem.begun_beside(found.fitted.theta.mean(axis=0)[: problem.parameters])
    for z in reversed(beside):
        starts = [hypotheses.LawStart(each, z) for each in begun]
        yield fit_unnamed_law(problem, UnnamedKind(), place, starts, *known)


def _gone_on_with(found: UnnamedFit, scope: Scope) -> UnnamedFit:
    """The fit with the shortest memory, its steps taken again while much is left and they help."""
    known, enough = found.problem.settings.selection, FAR * left_by_noise(found.problem)
    for _ in range(1 + known.repeats):
        before = found.fitted.cost
        found = found.onward((SHORT_TIME_CONSTANT,), STEPS, scope.in_time)
        gained = found.fitted.cost < (1.0 - known.rough) * before
        if found.fitted.converged or found.fitted.cost < enough or not gained:
            break
    return found


def _odds(tried: Sequence[UnnamedFit]) -> np.ndarray:
    """Probabilities of places, by what the law leaves there, the best one's own error allowed."""
    fits = [each.fitted for each in tried]
    first = min(tried, key=lambda each: each.fitted.cost)
    unit = scale(first.problem, first.fitted)
    known = evidence(first.problem, fits)
    return shares(known.values * (known.temperature * known.tau / max(unit, 1.0)))


def _to_scale(found: UnnamedFit, problem: HistoryProblem, scope: Scope) -> UnnamedFit:
    """The fit with a law of the motions that it has itself, where those differ from the law's.

    What a place has seen was told by a model without the law. Of terms beyond what it has really
    seen the recordings say nothing.
    """
    motion, reach = motion_of(found), float(found.law.deflection)
    largest, fastest = (float(jnp.max(jnp.abs(x))) for x in (motion.d, motion.v))
    if not (0.0 < largest < math.inf and 0.0 < fastest < math.inf and scope.in_time()):
        return found
    if abs(math.log(largest / reach)) < _TO_SCALE:
        return found
    period = 2.0 * math.pi * largest / fastest
    seen = found.place.scales._replace(deflection=largest, period=period)
    there, z = replace(found.place, scales=seen), found.fitted.theta.mean(axis=0)
    seen_by = _first(motion, problem)
    joint, law, now = found.joint, found.law, blank_at(there)
    # Some are brought to the scale as they are, other terms by the force that they make.
    as_is = np.stack(law.strengths)
    as_is[POWERS] *= (largest / reach) ** np.array([2.0, 3.0])
    slower = period / float(law.period)
    as_is[RESONATES] *= fastest / float(law.rate) / slower
    others = np.stack(law.strengths)
    kept = np.append(POWERS, SHAPED)
    others[kept] = 0.0
    force = np.asarray(force_in(law.with_strengths(others), seen_by))
    own = nearest_strengths(there, seen_by, force, np.setdiff1d(joint.terms, POWERS))
    own[kept] = as_is[kept]
    now = now.with_strengths(own).with_branch(scaled(np.stack(law.branch), largest / reach))
    now = now.with_resonance(np.stack(law.resonance) + np.log([slower, 1.0]))
    begun = problem, UnnamedKind(), there, [hypotheses.LawStart(now, z[: problem.parameters])]
    short = (SHORT_TIME_CONSTANT,)
    moved = fit_unnamed_law(*begun, short, STEPS, scope.in_time, joint.free)
    # Strengths that are as near as they can be to another scale's may be where no search returns.
    kept = moved.fitted.cost < problem.settings.selection.give_up * found.fitted.cost
    return moved if kept else found


def _forces_at(fitted: HypothesisFit, place: Place) -> bool:
    """Whether a hypothesis is one named force at a place, or several."""
    hypothesis = fitted.hypothesis
    named = all(isinstance(kind, ForceKind) for kind in hypothesis.kinds)
    return named and set(hypothesis.where) == {place.label}


def _named_force(
    fitted: HypothesisFit, problem: HistoryProblem, place: Place
) -> tuple[PlaceMotion, np.ndarray]:
    """Motion of a place, and what a fit's named forces do there."""
    hypothesis, theta = fitted.hypothesis, fitted.theta.mean(axis=0)
    motion = _first(_motion(problem, fitted, place), problem)
    force = np.zeros(motion.d.shape)
    for slot, kind in enumerate(hypothesis.kinds):
        assert isinstance(kind, ForceKind)
        law = SizedLaw(kind, *hypothesis.physical(theta, problem.map, slot))
        force = force + law.force(motion)
    return motion, force


def motion_of(fit: UnnamedFit) -> PlaceMotion:
    """What the place did in the fitted recordings, by the model with the law: (recordings, N)."""
    return _motion(fit.problem, fit.fitted, fit.place)


def _motion(problem: HistoryProblem, fitted: HypothesisFit, place: Place) -> PlaceMotion:
    suspects = fitted.hypothesis.suspects
    here = suspects._replace(row=jnp.broadcast_to(place.row, suspects.row.shape))
    gain = problem.gains(
        [here], fitted.theta.mean(axis=0)[None], fitted.time_constant, slopes=False
    ).gain[0]
    varied = jax.device_put((fitted.theta, gain))
    seen = AtSamples(*observed(problem.predictor, problem.joints, here, *varied, problem.data))
    d, v, a = (np.asarray(x)[..., 0] for x in (seen.d, seen.v, seen.a))
    dt = float(problem.predictor.dt) * problem.predictor.substeps
    return PlaceMotion(*jax.device_put((d, v, a, np.diff(d, axis=1, prepend=0.0), np.asarray(dt))))


def _first(motion: PlaceMotion, problem: HistoryProblem) -> PlaceMotion:
    """Of long recordings as much as a force is recovered from: every term of a law is as long."""
    most = problem.settings.illustration.longest
    d, v, a, moved = (x[:, :most] for x in motion[:4])
    return PlaceMotion(d, v, a, moved, motion.dt)
