from types import SimpleNamespace

import pytest

from iwanjax.discrepancy.histories import further_suspects as long_memory
from iwanjax.settings.histories import HISTORIES

NOISE = 1000.0


@pytest.fixture
def looked(monkeypatch):
    """What is refitted when a model leaves so much, the suspects that much."""

    def start(i: int) -> SimpleNamespace:
        return SimpleNamespace(index=i, hypothesis=SimpleNamespace(variant=i))

    def run(
        shortest: float, now: float, drops: list[float], suspects: list[float], known: int = 0
    ) -> list[float]:
        told = []
        scope = SimpleNamespace(in_time=lambda: True, progress=told.append)
        candidates = [SimpleNamespace(start=start(i), drop=drop) for i, drop in enumerate(drops)]
        monkeypatch.setattr(long_memory, "left_by_noise", lambda problem: NOISE)
        monkeypatch.setattr(long_memory, "scored", lambda *args: candidates)
        monkeypatch.setattr(
            long_memory,
            "evidence",
            lambda *args: SimpleNamespace(worth=lambda fitted: 0.5 * fitted.cost),
        )
        monkeypatch.setattr(
            long_memory,
            "multistart",
            lambda problem, starts, *args, **rest: [
                SimpleNamespace(cost=suspects[each.index]) for each in starts
            ],
        )
        monkeypatch.setattr(long_memory, "limited", lambda *args: None)
        monkeypatch.setattr(long_memory, "stuck", lambda *args: [])
        monkeypatch.setattr(long_memory, "placed", lambda entries: entries)
        problem = SimpleNamespace(settings=HISTORIES)
        entries = [
            SimpleNamespace(problem=problem, fitted=SimpleNamespace(start=start(i)))
            for i in range(len(suspects) - known, len(suspects))
        ]
        found = long_memory.appearing(
            problem,
            SimpleNamespace(cost=shortest),
            SimpleNamespace(cost=now, time_constant=40.0),
            entries,
            scope,
        )
        assert bool(told) == (now >= 1.25 * NOISE)
        return [entry.fitted.cost for entry in found]

    return run


def test_what_is_little_more_than_noise_is_not_looked_into(looked):
    assert looked(900.0, 1200.0, [0.3], [900.0]) == []


def test_what_builds_up_in_small_steps_is_looked_into(looked):
    assert looked(1150.0, 1300.0, [0.3], [1000.0]) == [1000.0]


def test_suspects_have_to_take_half_of_what_is_new(looked):
    assert looked(1300.0, 1900.0, [0.3, 0.2], [1590.0, 1610.0]) == [1590.0]


def test_only_what_promises_evidence_is_refitted(looked):
    assert looked(1000.0, 2000.0, [0.5, 0.002], [1000.0, 1000.0]) == [1000.0]


def test_the_best_so_far_are_refitted_whatever_is_promising_now(looked):
    assert looked(1000.0, 2000.0, [0.5], [1100.0, 1050.0], known=1) == [1050.0, 1100.0]
    # A suspect that is both is refitted once.
    assert looked(1000.0, 2000.0, [0.5], [1100.0], known=1) == [1100.0]
