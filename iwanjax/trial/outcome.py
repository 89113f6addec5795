"""What came of trials: each verdict beside the truth, and how often it was right."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import betaincinv

from iwanjax.results import AbstractResult
from iwanjax.tables import Block, Grid, without_empty_columns
from iwanjax.trial.foreign_laws import SUM_OF

UNNAMED_LAW, NOTHING, NO_NAME = "unnamed_law", "nothing", "no name fits"
LEFT_OUT, NAMED, EMPTY = "left_out", "named", "empty"
# Probability of the intervals that counted shares are given with.
_INTERVAL = 0.9
NEAR, NEAR_LEFT_OUT = 1.3, 2.0
"""Times the noise that a held-out error may be, with the law in the catalogue and without."""
MOST_OF_A_NAME = 0.5
"""Largest probability that a name may have where the law was left out, and is another one."""


class TrialOutcome(NamedTuple):
    """One trial's verdict beside the truth.

    Attributes
    ----------
    name : str
    sort : str
        empty, named or left_out.
    kind, where, strength : str
        What was concealed; nothing in an empty trial.
    verdict : str
        As in a diagnosis; error where it ended with one.
    said_kind, said_where : str
        What comes first; empty where nothing is named.
    first, nothing, something_else : float
        Probabilities of what comes first, that nothing is missing, that no name is right.
    wrong_name : float
        Probability of the likeliest name that is not that of what was concealed, at its place, nor
        one of several that together are it.
    ratio : float
        Held-out error over the noise's; NaN without.
    seconds : float
    message : str
        Of an error.
    by_its_parts : bool
        Whether all that the law's force is a sum of is named at its place.
    """

    name: str
    sort: str
    kind: str
    where: str
    strength: str
    verdict: str
    said_kind: str = ""
    said_where: str = ""
    first: float = 0.0
    nothing: float = 0.0
    something_else: float = 0.0
    wrong_name: float = 0.0
    ratio: float = float("nan")
    seconds: float = 0.0
    message: str = ""
    by_its_parts: bool = False

    @property
    def alarm(self) -> bool:
        """Whether something is said to be missing where nothing is."""
        return self.sort == EMPTY and self.verdict == "something_missing"

    @property
    def place_right(self) -> bool:
        """Whether what comes first is at the right place."""
        return self.said_where == self.where and bool(self.where)

    @property
    def named(self) -> bool:
        """Whether kind and place come first.

        So may those of a law that was left out: an end of another one's range tells it.
        """
        return self.verdict == "something_missing" and self.first_right

    @property
    def first_right(self) -> bool:
        """Whether the place is right, and the kind or all that it is a sum of."""
        return self.place_right and (self.said_kind == self.kind or self.by_its_parts)

    @property
    def right(self) -> bool:
        """Whether kind and place come first; of a law left out its place, and no other name."""
        if self.sort == EMPTY:
            return self.verdict == "nothing_missing"
        if self.sort == LEFT_OUT:
            return self.place_right and self.wrong_name <= MOST_OF_A_NAME
        return self.named

    @property
    def row(self) -> str:
        """What was concealed, in a table of confusions."""
        return {EMPTY: NOTHING, LEFT_OUT: f"{self.kind} (left out)"}.get(self.sort, self.kind)

    @property
    def column(self) -> str:
        """What was said, in a table of confusions."""
        if self.verdict == "something_missing":
            return NO_NAME if self.said_kind == UNNAMED_LAW else self.said_kind
        return {"nothing_missing": NOTHING}.get(self.verdict, self.verdict)


def jeffreys_interval(hits: int, of: int) -> tuple[float, float]:
    """Ends of a share's 90 % interval by Jeffreys' prior (Brown, Cai and DasGupta 2001)."""
    tail = 0.5 * (1.0 - _INTERVAL)
    low = float(betaincinv(hits + 0.5, of - hits + 0.5, tail)) if hits else 0.0
    high = float(betaincinv(hits + 0.5, of - hits + 0.5, 1.0 - tail)) if hits < of else 1.0
    return low, high


class Counted(NamedTuple):
    """How often something is so.

    Attributes
    ----------
    what : str
    hits, of : int
    low, high : float
        Of the share, with a probability of 0.9 (Jeffreys' interval).
    """

    what: str
    hits: int
    of: int
    low: float
    high: float

    @classmethod
    def among(
        cls, what: str, some: Sequence[TrialOutcome], so: Callable[[TrialOutcome], bool]
    ) -> "Counted":
        """Of outcomes."""
        hits, n = sum(map(so, some)), len(some)
        return cls(what, hits, n, *jeffreys_interval(hits, n))


class Forecast(NamedTuple):
    """Probabilities that one statement was given, and whether it was true.

    Attributes
    ----------
    what : str
    probability : (n,) array
    true : (n,) array of bool
    """

    what: str
    probability: np.ndarray
    true: np.ndarray

    @property
    def brier(self) -> float:
        """Mean squared difference of probability and truth (Brier 1950); NaN of none."""
        if not self.true.size:
            return float("nan")
        return float(np.mean((self.probability - self.true) ** 2))


@dataclass(frozen=True, eq=False)
class TrialResult(AbstractResult):
    """What came of all trials.

    Attributes
    ----------
    name : str
        Of the study that effects were concealed in.
    seed : int
    outcomes : tuple of TrialOutcome
    """

    name: str
    seed: int
    outcomes: tuple[TrialOutcome, ...]

    @property
    def counts(self) -> tuple[Counted, ...]:
        """False alarms, right verdicts and held-out errors, by sort; those of which there are."""
        empty, named, hidden = (
            [each for each in self.outcomes if each.sort == sort]
            for sort in (EMPTY, NAMED, LEFT_OUT)
        )
        judged = [
            Counted.among("nothing concealed: false alarms", empty, lambda o: o.alarm),
            Counted.among("nothing concealed: said so", empty, lambda o: o.right),
            Counted.among("in the catalogue: kind and place right", named, lambda o: o.right),
            Counted.among(
                f"nothing or in the catalogue: held out within {NEAR} floors",
                [*empty, *named],
                lambda o: o.ratio <= NEAR,
            ),
            Counted.among("law left out: place first", hidden, lambda o: o.place_right),
            Counted.among(
                f"law left out: no wrong name above {MOST_OF_A_NAME}",
                hidden,
                lambda o: o.wrong_name <= MOST_OF_A_NAME,
            ),
            Counted.among(
                f"law left out: held out within {NEAR_LEFT_OUT:g} floors",
                hidden,
                lambda o: o.ratio <= NEAR_LEFT_OUT,
            ),
            Counted.among("ended with an error", self.outcomes, lambda o: o.verdict == "error"),
        ]
        return tuple(each for each in judged if each.of)

    @property
    def forecasts(self) -> tuple[Forecast, ...]:
        """Probabilities of three statements, beside the truth."""
        all_of = [each for each in self.outcomes if each.verdict != "error"]
        named = [each for each in all_of if each.said_kind not in ("", UNNAMED_LAW)]
        return (
            _forecast("nothing is missing", all_of, lambda o: (o.nothing, o.sort == EMPTY)),
            _forecast(
                "kind and place that come first",
                named,
                lambda o: (o.first, o.first_right),
            ),
            _forecast(
                "none of the names",
                all_of,
                lambda o: (o.something_else, o.sort == LEFT_OUT and not o.named),
            ),
        )

    @property
    def brier(self) -> float:
        """Of all three statements together."""
        every = self.forecasts
        return Forecast(
            "all",
            np.concatenate([each.probability for each in every]),
            np.concatenate([each.true for each in every]),
        ).brier

    @property
    def confusion(self) -> tuple[tuple[str, ...], tuple[str, ...], np.ndarray]:
        """What was concealed, what was said, and how often (concealed, said)."""
        rows = sorted({each.row for each in self.outcomes}, key=lambda r: (r == NOTHING, r))
        found = {each.column for each in self.outcomes}
        last = [NO_NAME, "undecided", "error", NOTHING]
        columns = [
            *[row for row in rows if row in found and row != NOTHING],
            *sorted(found - set(rows) - set(last)),
            *[each for each in last if each in found],
        ]
        counts = np.zeros((len(rows), len(columns)), int)
        for each in self.outcomes:
            counts[rows.index(each.row), columns.index(each.column)] += 1
        return tuple(rows), tuple(columns), counts

    def _blocks(self) -> tuple[Block, ...]:
        head = ("", "trials", "of", "share", "90 % interval")
        rows = [
            (c.what, str(c.hits), str(c.of), f"{c.hits / c.of:.2f}", f"{c.low:.2f} to {c.high:.2f}")
            for c in self.counts
        ]
        briers = [
            (each.what, str(each.true.size), f"{each.brier:.3f}")
            for each in self.forecasts
            if each.true.size
        ]
        briers.append(("all", str(sum(f.true.size for f in self.forecasts)), f"{self.brier:.3f}"))
        return (
            f"Trial: {self.name}, {len(self.outcomes)} trials, seed {self.seed}",
            Grid(head, tuple(rows)),
            Grid(("probability of", "forecasts", "Brier score"), tuple(briers)),
            without_empty_columns(
                ("trial", "concealed", "strength", "said", "probability", "floors", "s", ""),
                [_line(each) for each in self.outcomes],
            ),
        )


def _forecast(
    what: str,
    some: Sequence[TrialOutcome],
    of: Callable[[TrialOutcome], tuple[float, bool]],
) -> Forecast:
    each = [of(one) for one in some]
    return Forecast(
        what, np.array([p for p, _ in each], float), np.array([so for _, so in each], bool)
    )


def _line(each: TrialOutcome) -> tuple[str, ...]:
    concealed = f"{each.row} @ {each.where}" if each.where else each.row
    said = f"{each.column} @ {each.said_where}" if each.said_where else each.column
    return (
        each.name,
        concealed,
        each.strength,
        said,
        f"{each.first:.2f}" if each.said_where else f"{each.nothing:.2f}",
        f"{each.ratio:.2f}",
        f"{each.seconds:.0f}",
        each.message or ("" if each.right else "place right" if each.place_right else "wrong"),
    )


def judged(name: str, truth: Mapping[str, Any], found: Mapping[str, Any]) -> TrialOutcome:
    """A trial's truth beside what the diagnosis of its study wrote.

    Parameters
    ----------
    name : str
    truth : mapping
        Of :func:`iwanjax.trial.files.truth_of`.
    found : mapping
        ``diagnosis``, the content of ``diagnosis.json``, or ``error``; and ``seconds``.
    """
    concealed = truth["sort"] != EMPTY
    about = TrialOutcome(
        name,
        truth["sort"],
        truth["kind"] if concealed else "",
        truth["where"] or "",
        truth["strength"],
        "error",
        seconds=found["seconds"],
        message=found.get("error", ""),
    )
    said = found.get("diagnosis")
    if said is None:
        return about
    what = said["what"]
    parts = SUM_OF.get(about.kind, ())
    said_there = [
        each["kind"]
        for each in what
        if each["where"] == about.where and each["probability"] > MOST_OF_A_NAME
    ]
    by_its_parts = bool(parts) and set(parts) <= set(said_there)
    right = (about.kind, *(parts if by_its_parts else ()))
    names = [
        each["probability"]
        for each in what
        if each["kind"] != UNNAMED_LAW
        and not (each["where"] == about.where and each["kind"] in right)
    ]
    after, floor = (said["fit"][key]["hold_out"] for key in ("after", "noise_floor"))
    return about._replace(
        verdict=said["verdict"],
        said_kind=what[0]["kind"] if what else "",
        said_where=what[0]["where"] if what else "",
        first=what[0]["probability"] if what else 0.0,
        nothing=said["probability_nothing_missing"],
        something_else=said["probability_something_else"],
        wrong_name=max(names, default=0.0),
        ratio=float("nan") if not floor or after is None else after / floor,
        by_its_parts=by_its_parts,
    )
