"""A second effect is looked for beside the best suspect, then beside the best one elsewhere."""

from types import SimpleNamespace

import numpy as np
import pytest

from iwanjax.discrepancy.histories import pairs
from iwanjax.discrepancy.histories.ranking import TIME_CONSTANT, RankedFit
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification.problem import Hypothesis
from iwanjax.settings.histories import HISTORIES

N = 1000
SEARCH = SimpleNamespace(
    data=SimpleNamespace(weight=np.ones((1, N, 1))),
    noise=np.array([1.0]),
    driven=0.0,
    predictor=None,
    settings=HISTORIES,
)


def entry(
    cost: float, where: str, time_constant: float = TIME_CONSTANT, problem: object = SEARCH
) -> RankedFit:
    hypothesis = SimpleNamespace(where=(where,), drifting=None)
    return RankedFit(
        problem, SimpleNamespace(hypothesis=hypothesis, cost=cost * N, time_constant=time_constant)
    )


@pytest.fixture
def asked(monkeypatch):
    """Whom a second was looked for beside; only beside m3 one is found that explains all."""
    seen = []

    def beside(problem, first, scope):
        seen.append(first.hypothesis.where[0])
        found = entry(0.3, "m3").fitted if seen[-1] == "m3" else entry(60.0, "m2").fitted
        return [found], []

    monkeypatch.setattr(pairs, "partners_of", beside)
    return seen


def test_where_the_first_and_its_partners_explain_too_little_the_next_place_is_asked(asked):
    singles = [entry(100.0, "m2"), entry(110.0, "m2"), entry(120.0, "m3"), entry(130.0, "m1")]
    found = pairs.doubled(SEARCH, singles, None)
    assert asked == ["m2", "m3"]
    assert min(each.fitted.cost for each in found) < N
    assert found[-4:] == singles


@pytest.mark.parametrize(
    "others",
    [
        [entry(110.0, "m2")],
        [entry(250.0, "m3")],
        [entry(50.0, "m3", time_constant=2.0)],
        [entry(120.0, "m3", problem=None)],
    ],
)
def test_what_is_at_the_same_place_or_explains_much_less_is_not_asked(asked, others):
    pairs.doubled(SEARCH, [entry(100.0, "m2"), *others], None)
    assert asked == ["m2"]


def test_where_the_first_has_a_partner_nobody_else_is_asked(asked):
    pairs.doubled(SEARCH, [entry(100.0, "m3"), entry(110.0, "m2")], None)
    assert asked == ["m3"]


@pytest.mark.parametrize(
    ("names", "where", "same"),
    [
        ("viscoelastic viscoelastic", "m1 m1", True),
        ("viscoelastic viscoelastic", "m1 m2", False),
        ("viscoelastic stiffness_error", "m1 m1", False),
        ("stiffness_error viscoelastic viscoelastic", "m1 m1 m1", True),
        ("viscoelastic", "m1", False),
    ],
)
def test_two_of_one_kind_at_one_place_are_no_pair_of_names(names, where, same):
    kinds = tuple(CATALOGUE[name][0] for name in names.split())
    assert Hypothesis(kinds, tuple(where.split()), None).twice_the_same is same


def test_no_such_pair_is_handed_on(monkeypatch):
    def pair(cost, same):
        hypothesis = SimpleNamespace(
            where=("m1", "m1"), kinds=(), variant=same, twice_the_same=same, label=""
        )
        return SimpleNamespace(hypothesis=hypothesis, cost=cost * N, start=None)

    first, found = pair(50.0, False), [pair(1.0, True), pair(1.05, False)]
    candidate = SimpleNamespace(drop=1e9, start=None)
    scope = SimpleNamespace(in_time=lambda: True, progress=lambda line: None)
    table = SimpleNamespace(worth=lambda fitted: 1e4, values=np.zeros(2))
    for name, value in {
        "left_by_noise": N,
        "evidence": table,
        "scored": [candidate],
        "where_something_acts": [candidate],
        "multistart": found,
        "_singles": [],
        "_enough": [],
        "_margin": 1.0,
    }.items():
        monkeypatch.setattr(pairs, name, lambda *a, value=value, **k: value)
    near, alone = pairs.partners_of(SEARCH, first, scope)
    assert [each.cost for each in near] == [1.05 * N]
    assert not alone
