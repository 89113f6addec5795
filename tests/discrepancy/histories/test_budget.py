"""When time is over no stage begins any more."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_ranking import SEARCH, entry

from iwanjax.discrepancy.findings import PlaceEvidence
from iwanjax.discrepancy.histories import screening, selection
from iwanjax.discrepancy.histories.ranking import Scope
from iwanjax.discrepancy.histories.selection import ModelSelection

STAGES = ("scored", "first_fits", "again")
NOMINAL = entry(9.0).fitted


def scope(stages: int, seen: list[str], to_finish: bool = False) -> Scope:
    """Time for so many stages, and to finish."""
    return Scope((), (), (), (), lambda: len(seen) < stages, lambda line: None, lambda: to_finish)


@pytest.fixture
def seen(monkeypatch):
    """Stages of a search whose one suspect explains nearly all."""
    seen: list[str] = []
    suspect = entry(1.0, "mass_error@a", time_constant=2.0)
    candidate = SimpleNamespace(
        drop=0.9, start=suspect.fitted.start, place=PlaceEvidence("a", 1.0, 0.9, 1, 50.0)
    )
    results = {"scored": [candidate], "first_fits": [suspect]}

    def stage(name):
        def run(*args, **options):
            seen.append(name)
            return results[name]

        return run

    for name in STAGES:
        monkeypatch.setattr(screening, name, stage(name))
    return seen


def run(within: Scope) -> ModelSelection:
    """A whole competition."""
    within, screen = screening.screened(SEARCH, NOMINAL, within)
    screen = screening.with_first_fits(SEARCH, NOMINAL, screen, within)
    return selection.run(SEARCH, NOMINAL, screen, within, 0)


@pytest.mark.parametrize("stages", [0, 1, 2])
def test_no_stage_begins_when_the_time_is_over(seen, stages):
    found = run(scope(stages, seen))
    assert tuple(seen) == STAGES[:stages]
    assert not found.detected
    assert len(found.scores) == (stages > 0)


@pytest.mark.parametrize("stages", [1, 2])
def test_a_search_that_is_stopped_shows_its_suspects(monkeypatch, seen, stages):
    """Fitted with the memory that the model without them was."""

    def refitted(problem, starts, time_constant, best, within):
        assert within.in_time()
        (start,) = starts
        return [entry(1.0, start.hypothesis.label, time_constant=time_constant).fitted]

    monkeypatch.setattr(selection, "refitted", refitted)
    monkeypatch.setattr(selection, "renominated", lambda _, nominal, *more: nominal)
    found = run(scope(stages, seen, to_finish=True))
    assert tuple(seen) == STAGES[:stages]
    assert found.detected
    assert found.best.fitted.hypothesis.label == "mass_error@a"
    assert len(found.scores) == len(found.places) == 1


def test_better_joints_are_no_suspect_of_a_search_that_is_stopped(monkeypatch, seen):
    """The model without suspects is fitted from where the suspects' joints ended, too."""

    def refitted(problem, starts, *_):
        return [entry(1.0, start.hypothesis.label).fitted for start in starts]

    def renominated(problem, nominal, entries, within):
        assert [e.fitted.hypothesis.label for e in entries] == ["mass_error@a"]
        return entry(1.0).fitted

    monkeypatch.setattr(selection, "refitted", refitted)
    monkeypatch.setattr(selection, "renominated", renominated)
    found = run(scope(2, seen, to_finish=True))
    assert not found.detected
    assert found.nominal.fitted.cost == entry(1.0).fitted.cost


def test_nothing_is_polished_when_the_time_is_over(monkeypatch):
    def fail(*args, **options):
        raise AssertionError("polished")

    monkeypatch.setattr(selection, "again", fail)
    monkeypatch.setattr(selection, "in_the_middle", fail)
    monkeypatch.setattr(selection, "determined", lambda *_: True)
    table = ModelSelection(True, entry(9.0), (entry(1.0, "mass_error@a"),), ())
    found = selection.concluded(table, SEARCH, scope(0, []))
    assert found.detected
    assert np.isfinite(found.nominal.behind)
