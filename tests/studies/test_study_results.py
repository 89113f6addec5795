import pytest

from iwanjax.errors import InputError
from iwanjax.studies import StudyResults


class Told:
    """Of a verdict."""

    def __init__(self, text):
        self.text = text

    def statement(self):
        return self.text


TWO = StudyResults({"mode1": Told("mode1: stiff"), "mode2": Told("soft")})


def test_they_are_a_mapping_in_the_study_s_order():
    assert list(TWO) == ["mode1", "mode2"]
    assert len(TWO) == 2
    assert "mode2" in TWO
    assert TWO.get("mode3") is None
    assert [each.text for each in TWO.values()] == ["mode1: stiff", "soft"]
    assert repr(TWO) == "StudyResults(mode1: Told, mode2: Told)"


def test_each_is_told_under_its_name_once():
    assert TWO.summary() == "mode1: stiff\n\nmode2: soft"
    assert StudyResults({"a": 1.5}).summary() == "a: 1.5"


def test_the_only_one_is_had_without_its_name():
    assert StudyResults({"a": 1}).only == 1
    with pytest.raises(InputError, match="2 results: mode1, mode2; take one by name"):
        _ = TWO.only
    with pytest.raises(InputError, match="no result 'mode'; expected one of mode1, mode2; did you"):
        TWO["mode"]
