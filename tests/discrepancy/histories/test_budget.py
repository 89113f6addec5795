"""When time is over no stage begins any more."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_ranking import SEARCH, entry

from iwanjax.discrepancy.findings import PlaceEvidence
from iwanjax.discrepancy.histories import selection
from iwanjax.discrepancy.histories.ranking import Scope
from iwanjax.discrepancy.histories.selection import ModelSelection

STAGES = ("nominal_fit", "scored", "first_fits", "again")


def scope(stages: int, seen: list[str]) -> Scope:
    """Time for so many stages."""
    return Scope((), (), (), (), lambda: len(seen) < stages, lambda line: None)


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_no_stage_begins_when_the_time_is_over(monkeypatch, stages):
    seen: list[str] = []
    candidate = SimpleNamespace(
        drop=0.9,
        start=SimpleNamespace(hypothesis=entry(1.0, "mass_error@a").fitted.hypothesis),
        place=PlaceEvidence("a", 1.0, 0.9, 1, 50.0),
    )
    results = {
        "nominal_fit": entry(9.0).fitted,
        "scored": [candidate],
        "first_fits": [entry(1.0, "mass_error@a", time_constant=2.0)],
    }

    def stage(name):
        def run(*args, **options):
            seen.append(name)
            return results[name]

        return run

    for name in STAGES:
        monkeypatch.setattr(selection, name, stage(name))
    found = selection.run(SEARCH, scope(stages, seen), 0)
    assert tuple(seen) == STAGES[:stages]
    assert not found.detected
    assert len(found.scores) == (stages > 1)


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
