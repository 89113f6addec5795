"""When time is over no stage begins any more."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_ranking import SEARCH, entry

from iwanjax.discrepancy.histories import selection as competition
from iwanjax.discrepancy.histories.ranking import Grounds
from iwanjax.discrepancy.histories.selection import Table

STAGES = ("_nominal", "screened", "_first", "again")


def grounds(stages: int, seen: list[str]) -> Grounds:
    """Time for so many stages."""
    return Grounds((), (), (), (), lambda: len(seen) < stages, lambda line: None)


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_no_stage_begins_when_the_time_is_over(monkeypatch, stages):
    seen: list[str] = []
    candidate = SimpleNamespace(
        drop=0.9, start=SimpleNamespace(hypothesis=entry(1.0, "mass_error@a").fitted.hypothesis)
    )
    results = {
        "_nominal": entry(9.0).fitted,
        "screened": [candidate],
        "_first": [entry(1.0, "mass_error@a", cycles=2.0)],
    }

    def stage(name):
        def run(*args, **options):
            seen.append(name)
            return results[name]

        return run

    for name in STAGES:
        monkeypatch.setattr(competition, name, stage(name))
    found = competition.run(SEARCH, grounds(stages, seen), 0)
    assert tuple(seen) == STAGES[:stages]
    assert not found.detected
    assert len(found.scores) == (stages > 1)


def test_nothing_is_polished_when_the_time_is_over(monkeypatch):
    def fail(*args, **options):
        raise AssertionError("polished")

    monkeypatch.setattr(competition, "again", fail)
    monkeypatch.setattr(competition, "in_the_middle", fail)
    monkeypatch.setattr(competition, "determined", lambda *_: True)
    table = Table(True, entry(9.0), (entry(1.0, "mass_error@a"),), ())
    found = competition.concluded(table, SEARCH, grounds(0, []))
    assert found.detected
    assert np.isfinite(found.nominal.behind)
