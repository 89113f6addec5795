"""Faults that are in the joints as well: one left out, one that sticks."""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax

from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
    again,
    cost_of,
    distinct,
    least,
    placed,
)
from iwanjax.discrepancy.histories.score_test import Candidate
from iwanjax.effects.kinds import ForceKind, JointKind
from iwanjax.estimation.evidence import MODEL_ERROR_ALLOWANCE
from iwanjax.identification import hypotheses
from iwanjax.identification.joint_priors import joints_of
from iwanjax.identification.likelihood import left_by_noise, left_by_right_model
from iwanjax.identification.multistart import (
    SHORT_TIME_CONSTANT,
    HypothesisFit,
    foreseen,
    multistart,
)
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.joints import Iwan4

_LIKE_A_JOINT = {"viscoelastic", "coulomb_friction", "stiffness_error"}


class Limits(NamedTuple):
    """Costs to compare with: the best one so far, and what has to be foreseen to be tried."""

    best: float
    worth: float


def limited(
    problem: HistoryProblem, nominal: HypothesisFit, best: float, time_constant: float
) -> Limits:
    """One step of the nominal model, and what must be gained beside it to be worth a fit."""
    return Limits(
        best, (1.0 - MODEL_ERROR_ALLOWANCE) * foreseen(problem, [nominal.start], time_constant)[0]
    )


def like_a_joint(fitted: HypothesisFit) -> bool:
    """Whether a joint left out is a rival of what was found in any case."""
    return bool({kind.name for kind in fitted.hypothesis.kinds} & _LIKE_A_JOINT)


def with_joints_left_out(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    shorts: Sequence[RankedFit],
    entries: list[RankedFit],
    candidates: Sequence[Candidate],
    scope: Scope,
) -> list[RankedFit]:
    """A joint more, where simple forces leave something or look much like one."""
    best, settings = least(nominal, entries), problem.settings
    left = best.cost > settings.selection.misfit * left_by_right_model(problem)
    if not left and not like_a_joint(best):
        return entries
    known = [*(e.fitted.start for e in entries), *(c.start for c in candidates)]
    scope.progress("refitting joints left out")
    limits = limited(problem, nominal, best.cost, SHORT_TIME_CONSTANT)
    found = _joints_left_out(
        problem, known, limits, scope, settings.joint_faults.places if left else 1
    )
    found += _rivals(problem, found, known, limits, scope)
    return compared(shorts, entries, found, scope)


def with_joint_faults(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    shorts: Sequence[RankedFit],
    entries: list[RankedFit],
    scope: Scope,
) -> list[RankedFit]:
    """Of pairs either with a joint in its place; and joints that stick, where much is left."""
    best, settings = least(nominal, entries), problem.settings
    left = best.cost > settings.selection.misfit * left_by_right_model(problem)
    pairs = [e.fitted for e in sorted(entries, key=cost_of) if len(e.fitted.hypothesis.kinds) == 2]
    if not left and not (pairs and like_a_joint(best)):
        return entries
    scope.progress("refitting joints of other kinds")
    limits = limited(problem, nominal, best.cost, SHORT_TIME_CONSTANT)
    found = _beside_another(problem, pairs[: settings.joint_faults.pairs], limits, scope)
    found += stuck(problem, nominal, limits, scope) if left else []
    single = explaining_too_little(problem, best, found)
    if single is not None:
        found += beside_stiction(problem, single, limits, scope)
    return compared(shorts, entries, found, scope)


def explaining_too_little(
    problem: HistoryProblem, best: HypothesisFit, found: Sequence[RankedFit]
) -> HypothesisFit | None:
    """The best suspect, if it is one force that leaves much, and so do all joints' faults."""
    kinds, much = best.hypothesis.kinds, problem.settings.pairs.far * left_by_noise(problem)
    single = len(kinds) == 1 and isinstance(kinds[0], ForceKind)
    return best if single and min([best.cost, *map(cost_of, found)]) > much else None


def beside_stiction(
    problem: HistoryProblem, single: HypothesisFit, limits: Limits, scope: Scope
) -> list[RankedFit]:
    """A joint that sticks beside a force, where it takes most of what the force leaves."""
    (short,) = multistart(
        problem, [single.start], SHORT_TIME_CONSTANT, STEPS, in_time=scope.in_time
    )
    noise = left_by_noise(problem)
    pairs = stuck(problem, short, Limits(short.cost, limits.worth), scope, beside=short.start)
    fall = problem.settings.pairs.fall
    return [each for each in pairs if fall * (cost_of(each) - noise) < short.cost - noise]


def compared(
    shorts: Sequence[RankedFit], entries: list[RankedFit], found: list[RankedFit], scope: Scope
) -> list[RankedFit]:
    """What was found with a short memory among others: what is near refitted as they were."""
    everything = placed([*shorts, *found])
    sensor_faults = [e for e in everything if all(e.fitted is not short.fitted for short in shorts)]
    ahead = everything[0].problem.settings.joint_faults.ahead if everything else 0.0
    near = [e for e in sensor_faults if e.fitted.cost < ahead * everything[0].fitted.cost]
    others = [e for e in sensor_faults if e not in near]
    return distinct([*entries, *others, *again(near, [], TIME_CONSTANT, scope)])


def stuck(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    limits: Limits,
    scope: Scope,
    time_constant: float = SHORT_TIME_CONSTANT,
    beside: Start | None = None,
) -> list[RankedFit]:
    """Stiction of every joint, where it promises something.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    nominal : HypothesisFit
        The model with its joints refitted, to start from.
    limits : Limits
        Costs to compare with.
    scope : Scope
        What may be suspected.
    time_constant : float
        Memory of the observer.
    beside : Start, optional
        A suspect that acts as well.
    """
    z = nominal.theta.mean(axis=0)[: problem.parameters]
    made = [
        hypotheses.with_stiction(
            problem, kind, j, label, problem.settings.joint_faults.thetas, z, beside
        )
        for kind in scope.kinds
        if isinstance(kind, JointKind) and kind.name == "stiction"
        for j, label in enumerate(scope.joints)
        if type(problem.joints[j].given) is Iwan4 and label not in scope.excluded
    ]
    return best_of_each(made, limits, scope, time_constant)


def _joints_left_out(
    problem: HistoryProblem, known: Sequence[Start], limits: Limits, scope: Scope, most: int
) -> list[RankedFit]:
    """A joint more where the best suspects are."""
    by_label = {place.label: place for place in scope.places}
    labels = dict.fromkeys(start.hypothesis.where[-1] for start in known)
    places = [by_label[label] for label in labels if label in by_label][:most]
    made = []
    for kind in scope.kinds:
        if isinstance(kind, JointKind) and kind.name == "iwan_joint":
            for place in places:
                guesses = _guesses(problem, known, place, kind)
                if guesses:
                    made.append(hypotheses.with_joint(problem, kind, place, guesses))
    return best_of_each(made, limits, scope)


def _rivals(
    problem: HistoryProblem,
    found: Sequence[RankedFit],
    known: Sequence[Start],
    limits: Limits,
    scope: Scope,
) -> list[RankedFit]:
    """The best joint left out at other places, scaled to what they do.

    From where its fit has ended, for springs and sliders alone tell too little of where the
    other joints are beside it: a rival that is fitted less well is no evidence.
    """
    best, settings = min(found, key=cost_of, default=None), problem.settings.joint_faults
    if best is None or cost_of(best) > settings.ahead * limits.best:
        return []
    by_label = {place.label: place for place in scope.places}
    (kind,), (where,) = best.fitted.hypothesis.kinds, best.fitted.hypothesis.where
    here, p = by_label[where], problem.parameters
    z = best.fitted.theta.mean(axis=0)
    joint = joints_of(best.problem.joints, jax.device_put(z[: best.problem.parameters]))[-1]
    assert isinstance(joint, Iwan4)
    assert isinstance(kind, JointKind)
    F_S, K_T = float(joint.F_S), float(joint.K_T)
    labels = dict.fromkeys(start.hypothesis.where[-1] for start in known)
    made = []
    for place in [by_label[each] for each in labels if each in by_label and each != where]:
        ratio = here.scales.deflection / place.scales.deflection
        guess = hypotheses.JointStart(K_T * ratio**2, F_S / K_T / ratio, z[:p])
        made.append(hypotheses.with_joint(problem, kind, place, [guess]))
    near = Limits(cost_of(best), min(limits.worth, settings.ahead * cost_of(best)))
    return best_of_each(made[: settings.elsewhere], near, scope)


def _beside_another(
    problem: HistoryProblem, pairs: Sequence[HypothesisFit], limits: Limits, scope: Scope
) -> list[RankedFit]:
    """A joint in place of either of two suspects, the other kept."""
    by_label = {place.label: place for place in scope.places}
    made: dict[tuple[str, str, str], tuple[HistoryProblem, list[Start]]] = {}
    kinds = [k for k in scope.kinds if isinstance(k, JointKind) and k.name == "iwan_joint"]
    for kind, pair, slot in itertools.product(kinds, pairs, (0, 1)):
        place = by_label.get(pair.hypothesis.where[slot])
        guesses = _guesses_of(problem, pair.start, slot, place, kind) if place else []
        kept = hypotheses.alone(problem, pair.start, 1 - slot)
        key = (kind.variant, pair.hypothesis.where[slot], kept.hypothesis.label)
        if place and guesses and key not in made:
            made[key] = hypotheses.with_joint(problem, kind, place, guesses, kept)
    found = best_of_each(list(made.values()), limits, scope)
    return found + without_the_other(found, scope)


def without_the_other(pairs: Sequence[RankedFit], scope: Scope) -> list[RankedFit]:
    """Joints alone from where they are beside another, which may only have led there."""
    best = min(map(cost_of, pairs), default=math.inf)
    of_place: dict[str, RankedFit] = {}
    for pair in sorted(pairs, key=cost_of):
        if cost_of(pair) < pair.problem.settings.joint_faults.ahead * best:
            of_place.setdefault(pair.fitted.hypothesis.where[0], pair)
    starts = [
        (e.problem, hypotheses.alone(e.problem, e.fitted.start, 0)) for e in of_place.values()
    ]
    return [
        RankedFit(own, each)
        for own, start in starts
        for each in multistart(
            own,
            [start],
            SHORT_TIME_CONSTANT,
            STEPS,
            give_up=own.settings.selection.give_up,
            best=best,
            in_time=scope.in_time,
        )
    ]


def best_of_each(
    made: Sequence[tuple[HistoryProblem, list[Start]]],
    limits: Limits,
    scope: Scope,
    time_constant: float = SHORT_TIME_CONSTANT,
) -> list[RankedFit]:
    """The best fit of each hypothesis that has a search of its own and promises something."""
    found, best = [], limits.best
    for own, starts in made:
        if not scope.in_time():
            break
        costs = foreseen(own, starts, time_constant)
        order = sorted(range(len(starts)), key=costs.__getitem__)
        if costs[order[0]] > limits.worth:
            continue
        chosen = [starts[i] for i in order[: own.settings.joint_faults.tried]]
        fits = multistart(
            own,
            chosen,
            time_constant,
            STEPS,
            give_up=own.settings.selection.give_up,
            best=best,
            in_time=scope.in_time,
        )
        best = min(best, *(each.cost for each in fits))
        found.append(RankedFit(own, min(fits, key=lambda each: each.cost)))
    return found


def _guesses(
    problem: HistoryProblem, known: Sequence[Start], place: Place, joint: JointKind
) -> list[hypotheses.JointStart]:
    """What the best springs and sliders at a place say of a joint there."""
    singles = [s for s in known if s.hypothesis.where == (place.label,)]
    return [g for s in singles for g in _guesses_of(problem, s, 0, place, joint)][
        : problem.settings.joint_faults.guesses
    ]


def _guesses_of(
    problem: HistoryProblem, start: Start, slot: int, place: Place, joint: JointKind
) -> list[hypotheses.JointStart]:
    """What a spring or slider says of a joint in its place; too much of one, where K holds it."""
    hypothesis, p = start.hypothesis, problem.parameters
    kind = hypothesis.kinds[slot]
    if not isinstance(kind, ForceKind) or kind.size.dimension != "force/length":
        return []
    stiffness, shape = hypothesis.physical(start.common, problem.map, slot)
    if joint.within and not kind.within:
        stiffness = -stiffness
    if stiffness <= 0 or (kind.within and not joint.within):
        return []
    settings = problem.settings.joint_faults
    slips = [share * place.scales.deflection for share in settings.slips]
    if kind.shape is not None and kind.shape.dimension == "length":
        slips = [factor * shape for factor in settings.slipped]
    return [hypotheses.JointStart(stiffness, slip, start.common[:p]) for slip in slips]
