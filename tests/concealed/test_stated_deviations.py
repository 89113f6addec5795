"""Stated deviations hold: the last record's numbers beside the truths of the concealed cases."""

import json
from pathlib import Path

import pytest
from concealed.cases import CASES
from concealed.deviations import Stated, stated
from concealed.study import truth_of

RECORD = json.loads(Path(__file__).with_name("frozen.json").read_text())


@pytest.fixture(scope="module")
def numbers():
    """Every determined number of hammer tests that the record names rightly."""
    found = []
    for case in CASES:
        if (name := f"case{case.number}") in RECORD:
            rate = float(case.structure.rate)
            found += stated(name, RECORD[name], truth_of(case, 0.0), rate)
    return [each for each in found if each.determined]


@pytest.mark.parametrize("joints", [False, True])
def test_the_truth_lies_within_two_stated_deviations(numbers, joints):
    some = [each for each in numbers if (each.kind == "joint") == joints]
    assert len({each.case for each in some}) >= 20
    assert sum(each.off <= 2.0 for each in some) >= 0.85 * len(some)


def test_truths_are_held_in_the_terms_of_the_verdict():
    found = {"right": True, "joints": {}, "what": []}
    given = {"gain_error": {"value": 0.3, "std": 0.1}}
    found["what"].append({"kind": "sensor_gain", "where": "a1", "parameters": given})
    delay = {"delay": {"value": 0.02, "std": 0.03}}
    found["what"].append({"kind": "sensor_delay", "where": "a2", "parameters": delay})
    truth = {
        "kind": ["sensor_gain", "sensor_delay"],
        "where": ["a1", "a2"],
        "joints": {},
        "parameters": [{"place": "a1", "values": [1.1]}, {"place": "a2", "values": [2.0]}],
    }
    gain, late = stated("one", found, truth, 100.0)
    assert isinstance(gain, Stated)
    assert gain.off == pytest.approx(2.0)
    assert late.off == pytest.approx(0.0)
    assert gain.determined
    assert not late.determined
    assert not stated("one", found | {"right": False}, truth, 100.0)
