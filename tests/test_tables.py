import re

from iwanjax.tables import Grid, as_html, as_text, without_empty_columns

GRID = Grid(("mode", "f Hz", "remark"), (("1", "12.5", "low"), ("10", "1e+03", "")))


def test_numbers_stand_on_the_right_words_on_the_left():
    assert as_text(["Head", GRID]) == (
        "Head\n\n  mode   f Hz  remark\n     1   12.5  low\n    10  1e+03"
    )


def test_what_is_empty_is_left_out():
    assert as_text(["", "a\nb", Grid(("x",), ()), "c"]) == "a\nb\n\nc"
    kept = without_empty_columns(("a", "b", "c"), [("1", "", ""), ("2", "", "x")])
    assert kept == Grid(("a", "c"), (("1", ""), ("2", "x")))


def test_percent_signs_and_exponents_are_numbers_words_are_none():
    columns = Grid((), (("+1.5 %", "-2e-05", "1 of 2", ""), ("nan", "3", "4", "")))
    assert columns.numeric == [True, True, False, False]


def test_html_is_escaped_and_lines_stay_apart():
    shown = as_html(["  a < b\n  c", GRID])
    assert "<p>a &lt; b<br>c</p>" in shown
    assert re.findall(r"<th[ >].*?>(.*?)</th>", shown) == list(GRID.header)
    assert shown.count("<td") == 6
    assert shown.count("text-align:right") == 6
