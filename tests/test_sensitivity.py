"""Every tuned number is found, halved, doubled, and shown in a row."""

from dataclasses import dataclass

import pytest
from concealed.sensitivity import AS_IS, numbers, replaced, scaled, table, trials

from iwanjax.settings.stages import Settings


@dataclass(frozen=True)
class Inner:
    """Of a stage.

    Attributes
    ----------
    count, others : int
        Numbers.
    turn : float, rad
        Angle.
    """

    count: int = 3
    others: int = 1
    turn: float = 0.5


@dataclass(frozen=True)
class Whole:
    """Of all."""

    inner: Inner = Inner()
    shares: tuple[float, ...] = (1.0, 0.5)


def test_every_number_has_its_path_and_unit():
    assert list(numbers(Whole())) == [
        ("inner.count", 3, "1"),
        ("inner.others", 1, "1"),
        ("inner.turn", 0.5, "rad"),
        ("shares", (1.0, 0.5), "1"),
    ]


def test_whole_numbers_stay_whole_and_at_least_one():
    assert [scaled(each, 0.5) for each in (3, 1, 2, 0.5, (1.0, 3))] == [2, 1, 1, 0.25, (0.5, 2)]


def test_one_number_is_replaced_at_a_time():
    tried = {(path, name): other for path, name, other in trials(Whole(), ["inner"])}
    assert tried["", AS_IS] == Whole()
    assert tried["inner.turn", "doubled"] == Whole(Inner(turn=1.0))
    # Half of one is one: nothing to try.
    assert ("inner.others", "halved") not in tried
    assert ("shares", "doubled") not in tried


@pytest.mark.long
def test_every_number_of_a_diagnosis_can_be_replaced():
    for path, value, _ in numbers(Settings()):
        other = replaced(Settings(), path, scaled(value, 2.0))
        changed = [at for at, now, _ in numbers(other) if now != dict(_values())[at]]
        assert changed == [path]


def _values():
    return [(path, value) for path, value, _ in numbers(Settings())]


def test_a_row_says_what_a_number_decides():
    def found(right: bool, probability: float, k: float) -> dict:
        return {
            "right": right,
            "seconds": 2.0,
            "said": ["a"],
            "verdict": "something_missing",
            "probability_nothing_missing": 0.0,
            "what": [{"probability": probability, "parameters": {"k": {"value": k, "std": 2.0}}}],
        }

    record = {
        "fields": {"x.y": [3, "1"]},
        "kept": {
            "": {AS_IS: {"case": found(True, 1.0, 10.0)}},
            "x.y": {
                "halved": {"case": found(False, 0.5, 11.0)},
                "doubled": {"case": {"error": "no", "right": False, "seconds": 1.0}},
            },
        },
    }
    row = table(record).splitlines()[-1]
    assert row == "| x.y | 3 | 1 | 0/1 | 1/1 | 0/1 | 0.5 | 0.5 | 2 | 2 | 1 |"
