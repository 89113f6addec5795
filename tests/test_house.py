"""The package's own counts stay within their bounds (tests/house.py), and are counted right."""

import re
from pathlib import Path

import house
import pytest


def test_no_count_has_risen():
    assert not house.risen(), "\n".join(house.risen())


def test_the_table_names_every_count_and_room():
    told = house.table()
    assert all(name in told for name in (*house.BOUNDS, *house.MODULES))


MODULE = Path("discrepancy/some.py")


def tuned(text, module=MODULE):
    return [
        (each.names, each.literals, each.documented) for each in house.tuned_numbers(module, text)
    ]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("_STEPS = 5", [(("_STEPS",), 1, False)]),
        ("# Steps.\n_STEPS = 5", [(("_STEPS",), 1, True)]),
        ("_STEPS = 5  # of a search", [(("_STEPS",), 1, True)]),
        ('STEPS: int = 5\n"""Of a search."""', [(("STEPS",), 1, True)]),
        ("# Both.\n_LOW, _HIGH = 0.1, -2e3", [(("_LOW", "_HIGH"), 2, True)]),
        ("# First.\n_A = 1\n_B = 2", [(("_A",), 1, True), (("_B",), 1, False)]),
        ("_GRID = [10.0**k for k in (1, 2)]", [(("_GRID",), 3, False)]),
        ("_SURE = True\n_NAME = 'a'\nlower = 3\ndef f():\n    _N = 4", []),
    ],
)
def test_tuned_numbers_are_literals_in_constants(text, found):
    assert tuned(text) == found


SETTINGS = """
class SearchSettings:
    '''How to search.

    Attributes
    ----------
    steps : int
        Of a search.
    '''

    steps: int = 5
    patience: int = 2
    name: str = "a"
"""


def test_fields_of_settings_are_tuned_numbers_too():
    assert tuned(SETTINGS) == [(("steps",), 1, True), (("patience",), 1, False)]
    assert not tuned(SETTINGS, Path("config/settings.py"))


def test_a_law_is_what_makes_a_force_of_a_motion():
    text = """
cubic = lambda m, _: m.d**3
other = lambda m: m.T
def slider(motion: PlaceMotion, slip): return motion.moved
def response(motion: PlaceMotion): return motion.omega
class Spring(AbstractJoint): pass
class Sum(AbstractProblem): pass
"""
    lines = (2, 4, 6)
    assert house.laws_outside_joints({MODULE: text}) == [f"{MODULE}:{i}" for i in lines]
    assert not house.laws_outside_joints({Path("joints/some.py"): text})


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("while True:\n    x = x - np.linalg.solve(H, g)", True),
        ("for _ in range(9):\n    f(scipy.linalg.lstsq(J, r))", True),
        ("x = np.linalg.solve(H, g)", False),
        ("for _ in range(9):\n    x = jnp.linalg.solve(H, g)", False),
    ],
)
def test_a_loop_that_solves_is_a_least_squares_engine(text, found):
    assert bool(house.least_squares_loops({MODULE: text})) == found


def test_parameter_maps_are_products_with_slots():
    texts = {"a.py": "x[p + 2 * slot]", "b.py": "p + slots * 2", "c.py": "n * slot\nf(*slots)"}
    found = house.parameter_maps({Path(name): text for name, text in texts.items()})
    assert found == ["a.py", "b.py"]


def test_class_names_are_compared_across_modules():
    texts = {Path("a.py"): "class Run: pass\nclass One: pass", Path("b.py"): "class Run: pass"}
    assert house.class_names_used_twice(texts) == ["Run"]


PROJECT = """
[project]
dependencies = ["numpy>=2", "PyYAML", "lineax"]
[project.optional-dependencies]
fem = ["scikit-fem>=12; python_version < '4'"]
io = ["pyuff"]
plot = ["pandas[all]>=2"]
dev = ["ruff"]
"""
NOTEBOOK = (
    '{"cells": [{"cell_type": "code", "source": ["%matplotlib inline\\n", "import pandas"]}]}'
)


def test_dependencies_are_looked_for_in_sources_tests_and_notebooks(tmp_path):
    texts = {
        "pyproject.toml": PROJECT,
        "iwanjax/a.py": "def f():\n    import numpy.linalg\n    from skfem.io import x",
        "tests/b.py": 'yaml = pytest.importorskip("yaml")\n"import lineax"',
        "notebooks/c.ipynb": NOTEBOOK,
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert house.never_imported(tmp_path) == ["lineax", "pyuff"]


def test_a_risen_count_is_told(monkeypatch):
    monkeypatch.setitem(house.BOUNDS, "public names", 3)
    monkeypatch.setitem(house.MODULES, "report", 0)
    monkeypatch.setitem(house.LONGER, "report", 10)
    told = house.risen()
    assert len(told) == 3
    assert told[0].startswith("public names: ")
    assert "report: 3 modules, bound 0" in told


def test_contributing_names_every_room_and_no_file_that_is_not_there():
    told = (house.ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rooms = {house.room_of(module) for module in house.sources()} - {"."}
    assert not {room for room in rooms if f"| `{room}/` |" not in told}
    named = set(re.findall(r"`((?:[\w.]+/)*[\w.]+(?:\.py|/))`", told)) - {"iwanjax/"}
    missing = {
        name
        for name in named
        if not any(
            (house.ROOT / top / name).exists() for top in ("", "iwanjax", "iwanjax/structures")
        )
    }
    assert not missing
