"""Faults that are in the joints as well: one left out, one that sticks."""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax

from iwanjax.discrepancy.effects import ForceKind, JointKind
from iwanjax.discrepancy.evidence import INDULGENCE
from iwanjax.discrepancy.histories import hypotheses as suspicion
from iwanjax.discrepancy.histories.kernels import joints_of
from iwanjax.discrepancy.histories.likelihood import left_by_noise
from iwanjax.discrepancy.histories.multistart import SHORT, Fitted, fit_all, foreseen
from iwanjax.discrepancy.histories.places import Place
from iwanjax.discrepancy.histories.problem import Search, Start
from iwanjax.discrepancy.histories.ranking import (
    MIDDLE,
    MISFIT,
    RACE,
    STEPS,
    Entry,
    Grounds,
    again,
    cost_of,
    distinct,
    least,
    placed,
)
from iwanjax.discrepancy.histories.score_test import Candidate
from iwanjax.joints import Iwan4

# Ratios of kinetic to static friction to begin with: near one what it does is nearly linear.
_THETAS = (0.7, 0.4, 0.95)
# Starts of a hypothesis that are fitted, those that promise most.
_TRIED = 2
# Places where a whole joint is tried, and how many starts; slips to begin with, of the largest
# deflection, or of a slider's own.
_JOINT_PLACES, _GUESSES, _SLIPS, _SLIPPED = 2, 6, (0.1, 1.0), (1.0, 4.0)
# Places where the joint found is tried again, scaled to what they do.
_ELSEWHERE = 4
# Pairs of suspects in which a joint may stand for one.
_PAIRS = 2
# Squared residual over the noise's from which on a force explains too little on its own, and how
# many times a joint that sticks beside it has to lessen what is more than noise.
_FAR, _FALL = 3.0, 3.0
# Times the best cost with a short memory from which on a joint's fault is fitted no further.
_AHEAD = 1.3
_LIKE_A_JOINT = {"viscoelastic", "coulomb_friction", "stiffness_error"}


class Limits(NamedTuple):
    """Costs to compare with: the best one so far, and what has to be foreseen to be tried."""

    best: float
    worth: float


def limited(search: Search, nominal: Fitted, best: float, cycles: float) -> Limits:
    """One step of the nominal model, and what must be gained beside it to be worth a fit."""
    return Limits(best, (1.0 - INDULGENCE) * foreseen(search, [nominal.start], cycles)[0])


def like_a_joint(fitted: Fitted) -> bool:
    """Whether a joint left out is a rival of what was found in any case."""
    return bool({kind.name for kind in fitted.hypothesis.kinds} & _LIKE_A_JOINT)


def with_joints_left_out(
    search: Search,
    nominal: Fitted,
    shorts: Sequence[Entry],
    entries: list[Entry],
    candidates: Sequence[Candidate],
    grounds: Grounds,
) -> list[Entry]:
    """A joint more, where simple forces leave something or look much like one."""
    best = least(nominal, entries)
    left = best.cost > MISFIT * left_by_noise(search)
    if not left and not like_a_joint(best):
        return entries
    known = [*(e.fitted.start for e in entries), *(c.start for c in candidates)]
    grounds.progress("refitting joints left out")
    limits = limited(search, nominal, best.cost, SHORT)
    found = _joints_left_out(search, known, limits, grounds, _JOINT_PLACES if left else 1)
    found += _rivals(search, found, known, limits, grounds)
    return _compared(shorts, entries, found, grounds)


def with_joint_faults(
    search: Search,
    nominal: Fitted,
    shorts: Sequence[Entry],
    entries: list[Entry],
    grounds: Grounds,
) -> list[Entry]:
    """Of pairs either with a joint in its place; and joints that stick, where much is left."""
    best = least(nominal, entries)
    left = best.cost > MISFIT * left_by_noise(search)
    pairs = [e.fitted for e in sorted(entries, key=cost_of) if len(e.fitted.hypothesis.kinds) == 2]
    if not left and not (pairs and like_a_joint(best)):
        return entries
    grounds.progress("refitting joints of other kinds")
    limits = limited(search, nominal, best.cost, SHORT)
    found = _beside_another(search, pairs[:_PAIRS], limits, grounds)
    found += stuck(search, nominal, limits, grounds) if left else []
    single = _explaining_too_little(search, best, found)
    if single is not None:
        found += _beside_stiction(search, single, limits, grounds)
    return _compared(shorts, entries, found, grounds)


def _explaining_too_little(search: Search, best: Fitted, found: Sequence[Entry]) -> Fitted | None:
    """The best suspect, if it is one force that leaves much, and so do all joints' faults."""
    kinds, much = best.hypothesis.kinds, _FAR * left_by_noise(search)
    single = len(kinds) == 1 and isinstance(kinds[0], ForceKind)
    return best if single and min([best.cost, *map(cost_of, found)]) > much else None


def _beside_stiction(
    search: Search, single: Fitted, limits: Limits, grounds: Grounds
) -> list[Entry]:
    """A joint that sticks beside a force, where it takes most of what the force leaves."""
    (short,) = fit_all(search, [single.start], SHORT, STEPS, in_time=grounds.in_time)
    noise = left_by_noise(search)
    pairs = stuck(search, short, Limits(short.cost, limits.worth), grounds, beside=short.start)
    return [each for each in pairs if _FALL * (cost_of(each) - noise) < short.cost - noise]


def _compared(
    shorts: Sequence[Entry], entries: list[Entry], found: list[Entry], grounds: Grounds
) -> list[Entry]:
    """What was found with a short memory among others: what is near refitted as they were."""
    everything = placed([*shorts, *found])
    faults = [e for e in everything if all(e.fitted is not short.fitted for short in shorts)]
    near = [e for e in faults if e.fitted.cost < _AHEAD * everything[0].fitted.cost]
    others = [e for e in faults if e not in near]
    return distinct([*entries, *others, *again(near, [], MIDDLE, grounds)])


def stuck(
    search: Search,
    nominal: Fitted,
    limits: Limits,
    grounds: Grounds,
    cycles: float = SHORT,
    beside: Start | None = None,
) -> list[Entry]:
    """Stiction of every joint, where it promises something.

    Parameters
    ----------
    search : Search
        Predictor and data.
    nominal : Fitted
        The model with its joints refitted, to start from.
    limits : Limits
        Costs to compare with.
    grounds : Grounds
        What may be suspected.
    cycles : float
        Memory of the observer.
    beside : Start, optional
        A suspect that acts as well.
    """
    z = nominal.theta.mean(axis=0)[: search.parameters]
    made = [
        suspicion.with_stiction(search, kind, j, label, _THETAS, z, beside)
        for kind in grounds.kinds
        if isinstance(kind, JointKind) and kind.name == "stiction"
        for j, label in enumerate(grounds.joints)
        if type(search.joints[j].given) is Iwan4
    ]
    return _best_of_each(made, limits, grounds, cycles)


def _joints_left_out(
    search: Search, known: Sequence[Start], limits: Limits, grounds: Grounds, most: int
) -> list[Entry]:
    """A joint more where the best suspects are."""
    by_label = {place.label: place for place in grounds.places}
    labels = dict.fromkeys(start.hypothesis.where[-1] for start in known)
    places = [by_label[label] for label in labels if label in by_label][:most]
    made = []
    for kind in grounds.kinds:
        if isinstance(kind, JointKind) and kind.name == "iwan_joint":
            for place in places:
                guesses = _guesses(search, known, place)
                if guesses:
                    made.append(suspicion.with_joint(search, kind, place, guesses))
    return _best_of_each(made, limits, grounds)


def _rivals(
    search: Search,
    found: Sequence[Entry],
    known: Sequence[Start],
    limits: Limits,
    grounds: Grounds,
) -> list[Entry]:
    """The best joint left out at other places, scaled to what they do.

    From where its fit has ended, for springs and sliders alone tell too little of where the
    other joints are beside it: a rival that is fitted less well is no evidence.
    """
    best = min(found, key=cost_of, default=None)
    if best is None or cost_of(best) > _AHEAD * limits.best:
        return []
    by_label = {place.label: place for place in grounds.places}
    (kind,), (where,) = best.fitted.hypothesis.kinds, best.fitted.hypothesis.where
    here, p = by_label[where], search.parameters
    z = best.fitted.theta.mean(axis=0)
    joint = joints_of(best.search.joints, jax.device_put(z[: best.search.parameters]))[-1]
    assert isinstance(joint, Iwan4)
    assert isinstance(kind, JointKind)
    F_S, K_T = float(joint.F_S), float(joint.K_T)
    labels = dict.fromkeys(start.hypothesis.where[-1] for start in known)
    made = []
    for place in [by_label[each] for each in labels if each in by_label and each != where]:
        ratio = here.scales.deflection / place.scales.deflection
        guess = suspicion.Guess(K_T * ratio**2, F_S / K_T / ratio, z[:p])
        made.append(suspicion.with_joint(search, kind, place, [guess]))
    near = Limits(cost_of(best), min(limits.worth, _AHEAD * cost_of(best)))
    return _best_of_each(made[:_ELSEWHERE], near, grounds)


def _beside_another(
    search: Search, pairs: Sequence[Fitted], limits: Limits, grounds: Grounds
) -> list[Entry]:
    """A joint in place of either of two suspects, the other kept."""
    by_label = {place.label: place for place in grounds.places}
    made: dict[tuple[str, str], tuple[Search, list[Start]]] = {}
    kinds = [k for k in grounds.kinds if isinstance(k, JointKind) and k.name == "iwan_joint"]
    for kind, pair, slot in itertools.product(kinds, pairs, (0, 1)):
        place = by_label.get(pair.hypothesis.where[slot])
        guesses = _guesses_of(search, pair.start, slot, place) if place else []
        kept = suspicion.alone(search, pair.start, 1 - slot)
        key = (pair.hypothesis.where[slot], kept.hypothesis.label)
        if place and guesses and key not in made:
            made[key] = suspicion.with_joint(search, kind, place, guesses, kept)
    found = _best_of_each(list(made.values()), limits, grounds)
    return found + without_the_other(found, grounds)


def without_the_other(pairs: Sequence[Entry], grounds: Grounds) -> list[Entry]:
    """Joints alone from where they are beside another, which may only have led there."""
    best = min(map(cost_of, pairs), default=math.inf)
    of_place: dict[str, Entry] = {}
    for pair in sorted(pairs, key=cost_of):
        if cost_of(pair) < _AHEAD * best:
            of_place.setdefault(pair.fitted.hypothesis.where[0], pair)
    starts = [(e.search, suspicion.alone(e.search, e.fitted.start, 0)) for e in of_place.values()]
    return [
        Entry(own, each)
        for own, start in starts
        for each in fit_all(
            own, [start], SHORT, STEPS, race=RACE, best=best, in_time=grounds.in_time
        )
    ]


def _best_of_each(
    made: Sequence[tuple[Search, list[Start]]],
    limits: Limits,
    grounds: Grounds,
    cycles: float = SHORT,
) -> list[Entry]:
    """The best fit of each hypothesis that has a search of its own and promises something."""
    found, best = [], limits.best
    for own, starts in made:
        if not grounds.in_time():
            break
        costs = foreseen(own, starts, cycles)
        order = sorted(range(len(starts)), key=costs.__getitem__)
        if costs[order[0]] > limits.worth:
            continue
        chosen = [starts[i] for i in order[:_TRIED]]
        fits = fit_all(own, chosen, cycles, STEPS, race=RACE, best=best, in_time=grounds.in_time)
        best = min(best, *(each.cost for each in fits))
        found.append(Entry(own, min(fits, key=lambda each: each.cost)))
    return found


def _guesses(search: Search, known: Sequence[Start], place: Place) -> list[suspicion.Guess]:
    """What the best springs and sliders at a place say of a joint there."""
    singles = [s for s in known if s.hypothesis.where == (place.label,)]
    return [g for s in singles for g in _guesses_of(search, s, 0, place)][:_GUESSES]


def _guesses_of(search: Search, start: Start, slot: int, place: Place) -> list[suspicion.Guess]:
    """What a spring or slider says of a joint in its place."""
    hypothesis, p = start.hypothesis, search.parameters
    kind = hypothesis.kinds[slot]
    if not isinstance(kind, ForceKind) or kind.size.dimension != "force/length":
        return []
    size, shape = start.common[p + 2 * slot : p + 2 * slot + 2]
    stiffness = hypothesis.scales[slot] * (math.exp(size) if kind.positive else size)
    if stiffness <= 0:
        return []
    slips = [share * place.scales.deflection for share in _SLIPS]
    if kind.shape is not None and kind.shape.dimension == "length":
        slips = [factor * math.exp(shape) for factor in _SLIPPED]
    return [suspicion.Guess(stiffness, slip, start.common[:p]) for slip in slips]
