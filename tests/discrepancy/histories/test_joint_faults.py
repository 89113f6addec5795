"""A joint that sticks is looked for beside a force where the force alone explains too little."""

from types import SimpleNamespace

import numpy as np
import pytest

from iwanjax.discrepancy.histories import joint_faults
from iwanjax.discrepancy.histories.ranking import RankedFit
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.settings.histories import HISTORIES

N = 1000
SEARCH = SimpleNamespace(
    data=SimpleNamespace(weight=np.ones((1, N, 1))),
    noise=np.array([1.0]),
    driven=0.0,
    predictor=None,
    settings=HISTORIES,
)
NOISE = left_by_noise(SEARCH)  # type: ignore[arg-type]
GROUNDS = SimpleNamespace(in_time=lambda: True)
LIMITS = joint_faults.Limits(np.inf, 0.0)


def fitted(cost: float, *kinds: str) -> SimpleNamespace:
    hypothesis = SimpleNamespace(kinds=tuple(CATALOGUE[kind][0] for kind in kinds))
    return SimpleNamespace(hypothesis=hypothesis, cost=cost * NOISE, start=kinds)


@pytest.mark.parametrize(
    ("best", "sensor_faults", "asked"),
    [
        (fitted(5.0, "gap_contact"), [4.0, 6.0], True),
        (fitted(5.0, "gap_contact"), [], True),
        (fitted(2.0, "gap_contact"), [], False),
        (fitted(5.0, "gap_contact"), [2.0], False),
        (fitted(5.0, "gap_contact", "viscous_damping"), [], False),
        (fitted(5.0, "sensor_delay"), [], False),
        (fitted(5.0, "joint_drift"), [], False),
        (fitted(5.0), [], False),
    ],
)
def test_a_partner_is_looked_for_beside_one_force_that_leaves_much(best, sensor_faults, asked):
    found = [RankedFit(SEARCH, fitted(cost, "stiction")) for cost in sensor_faults]
    single = joint_faults.explaining_too_little(SEARCH, best, found)
    assert single is (best if asked else None)


@pytest.mark.parametrize(("cost", "kept"), [(1.2, True), (1.9, True), (2.1, False), (3.9, False)])
def test_a_joint_that_sticks_has_to_take_most_of_what_the_force_leaves(monkeypatch, cost, kept):
    """Of the three times the noise that the force leaves too much, two."""
    short, seen = fitted(4.0, "gap_contact"), []
    pair = RankedFit(SEARCH, fitted(cost, "stiction", "gap_contact"))

    def stuck(problem, nominal, limits, scope, time_constant=2.0, beside=None):
        seen.append((nominal, limits.best, beside))
        return [pair]

    monkeypatch.setattr(joint_faults, "multistart", lambda *_, **__: [short])
    monkeypatch.setattr(joint_faults, "stuck", stuck)
    single = fitted(5.0, "gap_contact")
    assert joint_faults.beside_stiction(SEARCH, single, LIMITS, GROUNDS) == [pair] * kept
    assert seen == [(short, short.cost, short.start)]
