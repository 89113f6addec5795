"""Which verdict evidences and misfits allow: one rule for structures, modes, curves and loops."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from iwanjax.errors import InputError
from iwanjax.estimation.evidence import (
    AS_LIKELY_WRONG,
    MODEL_ERROR_ALLOWANCE,
    misspecification_probability,
    shares,
)
from iwanjax.settings.stages import settings

VerdictName = Literal["nothing_missing", "something_missing", "undecided"]

# Of sums of probabilities.
_ROUNDING = 1e-9


class Misfit(NamedTuple):
    """Errors of a model over what noise, and what a right model may be off by, leave.

    Attributes
    ----------
    fit, hold_out : float
        1 for a model that is right; infinite for one that diverges, NaN without recordings.
    units : (float, float)
        Errors, relative to what was recorded, at which either is 1: they differ from model to model
        by what its parameters leave open.
    """

    fit: float
    hold_out: float
    units: tuple[float, float] = (1.0, 1.0)

    @property
    def ratios(self) -> tuple[float, float]:
        """Of the fitted recordings and of those held out."""
        return self.fit, self.hold_out

    @property
    def largest(self) -> float:
        """Of the recordings that there are."""
        return max((each for each in self.ratios if not math.isnan(each)), default=0.0)


@dataclass(frozen=True)
class Verdict:
    """One of three verdicts, and the probabilities that it rests on.

    Attributes
    ----------
    name : {"nothing_missing", "something_missing", "undecided"}
        The verdict.
    detected : bool
        Whether something is missing, known or not: ``something_missing``, or ``undecided`` with a
        misfit well above the noise.
    nothing, something_else : float
        Probabilities that nothing is missing, and that the truth is none of what was tried.
    named : tuple of float
        Probabilities of what was tried, the largest first. All of them add up to one.
    misfit : float
        Error of the model without any of it over what a right model leaves.

    Raises
    ------
    InputError
        For a state that contradicts itself.
    """

    name: VerdictName
    detected: bool
    nothing: float
    something_else: float
    named: tuple[float, ...]
    misfit: float

    def __post_init__(self) -> None:
        """Refuse what contradicts itself."""
        every = (self.nothing, self.something_else, *self.named)
        if not all(-_ROUNDING <= each <= 1.0 + _ROUNDING for each in every):
            raise InputError(f"verdict: probabilities {every}; expected 0 to 1")
        if abs(sum(every) - 1.0) > len(every) * _ROUNDING:
            raise InputError(f"verdict: probabilities add up to {sum(every)}; expected 1")
        if any(a < b - _ROUNDING for a, b in zip(self.named, self.named[1:], strict=False)):
            raise InputError(f"verdict: {self.named} is not in order; expected the largest first")
        if self.name != _named(self.nothing, self.named):
            raise InputError(
                f"verdict: {self.name} with probabilities {self.nothing:.3g} of nothing and "
                f"{sum(self.named):.3g} of what was tried; expected "
                f"{_named(self.nothing, self.named)}"
            )
        if self.detected != _detected(self.name, self.misfit):
            raise InputError(
                f"verdict: detected is {self.detected} for {self.name} and a misfit of "
                f"{self.misfit:.3g} times the noise"
            )
        if self.name == "nothing_missing" and self.misfit > AS_LIKELY_WRONG:
            raise InputError(f"verdict: nothing missing, {self.misfit:.3g} times the noise off")

    @property
    def found(self) -> bool:
        """Whether what is missing has a name."""
        return self.name == "something_missing"

    @property
    def untold(self) -> bool:
        """Whether nothing and something were left as likely as each other (:func:`stopped`)."""
        return self.nothing == self.something_else


def judged(
    nothing: float, candidates: Sequence[float], before: Misfit, after: Misfit | None = None
) -> Verdict:
    r"""The verdict of evidences and misfits.

    With :math:`s_i` the shares that evidence alone gives to nothing (0) and to each candidate,

    .. math:: P_0 = (1 - u_0)\, s_0, \quad
              P_i = (1 - u_1)\, s_i\left(1 + (1 - v)\frac{u_0 s_0}{\sum_{j>0} s_j}\right), \quad
              P_{else} = 1 - P_0 - \textstyle\sum P_i .

    Evidence compares what was tried; :math:`u` says that the truth is none of it. Nothing is
    refuted by its own misfit alone
    (:func:`~iwanjax.estimation.evidence.misspecification_probability`), whatever its rivals do. Of
    what was tried :math:`u_1` is at most what the share r of the misfit tells, root mean square
    beyond the noise, that it leaves,

    .. math:: \frac{u}{1-u} = \left(\frac{r}{0.1}\right)^4 :

    real recordings hold more than any model, and a correction that takes 93 % of a large misfit is
    one, though the rest is well above the noise; a neighbour of the truth leaves more. The relative
    errors of fitted and held-out recordings, beyond the noise of each, are added as squares: the
    truth leaves a small share of all that is unexplained. Nothing missing has to hold for each.
    Where its misfit refutes nothing, :math:`u_0 > 1/2`, and few values say so little that evidence
    alone does not, what was tried inherits its probability as far as it takes that misfit away: v
    is the same bound, and 1 elsewhere.

    The verdict is *nothing missing* or *something missing* where that has more than half of the
    probability (the latter also where the first candidate is likelier than nothing), else
    *undecided*.

    Parameters
    ----------
    nothing : float
        Log evidence that nothing is missing, and how much likelier it is before the data.
    candidates : sequence of float
        Log evidences of what may be missing, the largest first.
    before : Misfit
        Of the model without any of them.
    after : Misfit, optional
        Of the model with the first; as before where that is not known.

    Returns
    -------
    Verdict
    """
    odds = shares(np.array([nothing, *candidates]))
    refuted = max(map(misspecification_probability, before.ratios))
    doubt = _unexplained(before, before if after is None else after)
    p_nothing = (1.0 - refuted) * float(odds[0])
    named = (1.0 - doubt) * odds[1:]
    if after is not None and candidates and refuted > 0.5:
        inherited = refuted * float(odds[0]) * (1.0 - _neighbouring(before, after))
        named = named + (1.0 - doubt) * inherited * shares(np.asarray(candidates))
    named = tuple(named.tolist())
    name = _named(p_nothing, named)
    return Verdict(
        name,
        _detected(name, before.largest),
        p_nothing,
        max(0.0, 1.0 - p_nothing - sum(named)),
        named,
        before.largest,
    )


def stopped(verdict: Verdict, fitted: bool) -> Verdict:
    """The verdict of a search that had no time for any suspect.

    Where the joints of the model without suspects were still being fitted, a misfit does not tell
    what is missing from it from what they will take away; that there is none says as much as ever.

    Parameters
    ----------
    verdict : Verdict
        By the misfit as it stands.
    fitted : bool
        Whether the search of the model's own joints had ended.
    """
    if fitted or not verdict.detected:
        return verdict
    return Verdict("undecided", True, 0.5, 0.5, (), verdict.misfit)


def cut_short(verdict: Verdict, left: Misfit) -> Verdict:
    """The verdict of a search that ended before all was tried.

    Where the best of what was tried leaves more than noise (``left``), what was not tried is as
    likely as that: names keep half of their probabilities.
    """
    if left.largest <= AS_LIKELY_WRONG:
        return verdict
    return _with_less(verdict, 0.5)


def beside_general_law(
    verdict: Verdict, named: Misfit, general: Misfit, elsewhere: float = 0.0
) -> Verdict:
    r"""The verdict where a general law, with no name, was fitted as well.

    The names lose what the general law says against them: by the share of the misfit of the best
    of them (or of the model without any) that it leaves, they are no more than neighbours of the
    truth, as :func:`judged` has it. Names at several places suppose more than one law at one
    place does, and a law that was tried where the names are is no richer elsewhere: as far as it
    acts elsewhere, with what they leave, a, and what it leaves, b, root mean square beyond the
    noise, they keep the share

    .. math:: \frac{b^4}{a^4 + b^4},

    one half where neither leaves anything. And names that leave more than noise are none where the
    law leaves no more: with :math:`p = 1/(1 + ((r^2 - 1)/0.06)^2)` for what either leaves of the
    noise at most, r, and 0.06 what is allowed for errors of models, no more is kept than

    .. math:: 1 - p_{law}\,(1 - p_{names}) .

    Parameters
    ----------
    verdict : Verdict
        On the names.
    named : Misfit
        With the best of them.
    general : Misfit
        With the general law.
    elsewhere : float
        Probability that the law acts elsewhere than the best of them; 1 where these act at several
        places.
    """
    kept = (1.0 - elsewhere) * _neighbouring(named, general)
    kept += elsewhere * _beside_one(named, general)
    kept = min(kept, 1.0 - _as_right(general) * (1.0 - _as_right(named)))
    return _with_less(verdict, kept)


def acting(verdict: Verdict, before: Misfit, general: Misfit, placed: float) -> float:
    """Probability that something acts where a general law was fitted.

    That something is missing, that it is there of all places that were tried, and that what the law
    takes away comes from there: the share of the squared misfit that it explains.

    Parameters
    ----------
    verdict : Verdict
        With the general law.
    before, general : Misfit
        Without the law and with it.
    placed : float
        Probability of the place among those that were tried.
    """
    explained = max(0.0, 1.0 - _left(before, general) ** 2)
    return (1.0 - verdict.nothing) * placed * explained


class Whole(NamedTuple):
    """The verdict on several parts: modes, joints.

    Attributes
    ----------
    name : {"nothing_missing", "something_missing", "undecided"}
        Something is missing where it is from any part; nothing where it is from none, and that
        is likelier than not of all of them together.
    detected : bool
        Of any part.
    nothing : float
        Probability that nothing is missing from any part.
    something_else : float
        Probability that the truth is none of what was tried in any part, in one of them at least.
        Beside ``something_missing`` it may exceed one half: what is missing from one part has a
        name then, what is missing from another has none.
    """

    name: VerdictName
    detected: bool
    nothing: float
    something_else: float


def together(parts: Sequence[Verdict]) -> Whole:
    r"""Verdicts on several parts as one.

    With :math:`P_0` and :math:`P_{else}` of each part,

    .. math:: P_0 = \prod_i P_{0,i}, \qquad P_{else} = 1 - \prod_i (1 - P_{else,i}) .

    The parts count as independent: each was judged by its own values. Modes that share recordings
    and a structure are not quite. Whatever their dependence, Fréchet's bounds hold,

    .. math:: \max_i P_{else,i} \le P_{else} \le \min(1, \textstyle\sum_i P_{else,i}), \quad
              P_0 \le \min_i P_{0,i},

    and the products keep them: a whole is never surer of its names than its least sure part is.
    """
    nothing = math.prod(each.nothing for each in parts)
    unknown = 1.0 - math.prod(1.0 - each.something_else for each in parts)
    detected = any(each.detected for each in parts)
    if any(each.found for each in parts):
        return Whole("something_missing", True, nothing, unknown)
    name = "nothing_missing" if nothing > 0.5 and not detected else "undecided"
    return Whole(name, detected, nothing, unknown)


def worse(before: float, after: float, floor: float) -> bool:
    """Whether a correction predicts held-out recordings worse than the model without it.

    One that predicts them to within their noise does not, whatever chance makes of the rest; one
    that diverges always does.

    Parameters
    ----------
    before, after : float
        Relative errors without and with it; NaN without recordings.
    floor : float
        What noise alone exceeds in one case of twenty.
    """
    if math.isnan(before):
        return False
    return not after <= max(before, floor)


def _with_less(verdict: Verdict, kept: float) -> Verdict:
    """The same with a share of the names' probabilities; what they lose is something else's."""
    names = tuple(kept * each for each in verdict.named)
    name, other = _named(verdict.nothing, names), max(0.0, 1.0 - verdict.nothing - sum(names))
    seen = _detected(name, verdict.misfit)
    return replace(verdict, name=name, detected=seen, something_else=other, named=names)


def _named(nothing: float, named: Sequence[float]) -> VerdictName:
    if nothing > 0.5:
        return "nothing_missing"
    if named and sum(named) > 0.5 and named[0] >= nothing:
        return "something_missing"
    return "undecided"


def _detected(name: VerdictName, misfit: float) -> bool:
    return name == "something_missing" or (name == "undecided" and misfit > AS_LIKELY_WRONG)


def _unexplained(before: Misfit, after: Misfit) -> float:
    """Probability that a correction is not the truth, by the share of the misfit that it leaves."""
    if _excess(after) == 0.0:
        return 0.0
    refuted = max(map(misspecification_probability, after.ratios))
    return min(refuted, _neighbouring(before, after))


def _neighbouring(before: Misfit, after: Misfit) -> float:
    """The same by that share alone."""
    known, share = settings().judgement, _left(before, after)
    odds = (share / known.neighbour) ** known.sharpness
    return odds / (1.0 + odds) if math.isfinite(odds) else 1.0


def _beside_one(named: Misfit, general: Misfit) -> float:
    """Share that names keep beside a law elsewhere, or at one of several places of theirs."""
    a, b = _excess(named), _excess(general)
    if a == b or not math.isfinite(a):
        return 0.5 if a == b else 0.0
    half = settings().judgement.sharpness / 2.0
    odds = (b / a) ** half if a > 0.0 else math.inf
    return odds / (1.0 + odds) if math.isfinite(odds) else 1.0


def _as_right(misfit: Misfit) -> float:
    """How far what a model leaves may be what errors that are allowed of any model do."""
    more = max(misfit.largest**2 - 1.0, 0.0) / MODEL_ERROR_ALLOWANCE
    return 1.0 / (1.0 + more**2)


def _left(before: Misfit, after: Misfit) -> float:
    """Share of the misfit beyond the noise that is left, root mean square."""
    there, left = _excess(before), _excess(after)
    if left == 0.0:
        return 0.0
    share = math.sqrt(left / there) if there > 0.0 else math.inf
    return math.inf if math.isnan(share) else share


def _excess(misfit: Misfit) -> float:
    """Squared error beyond the noise, of fitted and held-out recordings together."""
    pairs = zip(misfit.ratios, misfit.units, strict=True)
    return sum(max(r**2 - 1.0, 0.0) * unit**2 for r, unit in pairs if not math.isnan(r))
