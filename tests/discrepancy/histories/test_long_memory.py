import math
from types import SimpleNamespace

import pytest

from iwanjax.discrepancy.histories import further_suspects as long_memory
from iwanjax.settings.histories import HISTORIES

NOISE, GAIN = 1000.0, 24.0


@pytest.fixture
def looked(monkeypatch):
    """What is refitted when a model leaves so much, the suspects that much."""

    def start(i: int) -> SimpleNamespace:
        return SimpleNamespace(index=i, hypothesis=SimpleNamespace(variant=i))

    def run(
        shortest: float,
        now: float,
        drops: list[float],
        suspects: list[float],
        known: int = 0,
        sticking: tuple[float, ...] = (),
        linear: float = 2000.0,
        memory: float = math.inf,
    ) -> list[float]:
        told = []
        scope = SimpleNamespace(in_time=lambda: True, progress=told.append, places=())
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
        monkeypatch.setattr(long_memory, "foreseen", lambda *args: [now])
        monkeypatch.setattr(long_memory, "gain_in_squares", lambda *args: GAIN)
        monkeypatch.setattr(
            long_memory, "like_no_linear_error", lambda *args: args[-1] < linear - GAIN
        )
        found = [SimpleNamespace(fitted=SimpleNamespace(cost=cost)) for cost in sticking]
        monkeypatch.setattr(long_memory, "stuck", lambda *args: found)
        monkeypatch.setattr(long_memory, "placed", lambda entries: entries)
        problem = SimpleNamespace(settings=HISTORIES)
        entries = [
            SimpleNamespace(problem=problem, fitted=SimpleNamespace(start=start(i)))
            for i in range(len(suspects) - known, len(suspects))
        ]
        found = long_memory.appearing(
            problem,
            SimpleNamespace(cost=shortest),
            SimpleNamespace(cost=now, time_constant=memory, start=None),
            entries,
            scope,
        )
        grown = now - shortest > GAIN and math.isinf(memory)
        assert bool(told) == (now >= 1.25 * NOISE or grown)
        return [entry.fitted.cost for entry in found]

    return run


def test_in_what_is_little_more_than_noise_no_force_is_looked_for(looked):
    assert looked(900.0, 1200.0, [0.3], [900.0]) == []


@pytest.mark.parametrize(
    ("shortest", "linear", "found"),
    [
        (1020.0, 1030.0, [1000.0]),
        # Noise does not grow with the memory; errors of the linear model may.
        (1030.0, 1030.0, []),
        (1020.0, 1020.0, []),
    ],
)
def test_what_grows_with_the_memory_is_little_because_a_joint_sticks(
    looked, shortest, linear, found
):
    assert looked(shortest, 1050.0, [], [], sticking=(1000.0,), linear=linear) == found


def test_what_little_grows_is_looked_into_once_in_the_free_run(looked):
    assert looked(1020.0, 1050.0, [], [], sticking=(1000.0,), linear=1030.0, memory=40.0) == []


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
