"""Examples in the room's docstrings are true."""

import doctest
import importlib
import pkgutil
from pathlib import Path

import pytest

import iwanjax.studies
from iwanjax.config import recordings

ROOT = Path(__file__).resolve().parents[2]
MODULES = [
    importlib.import_module(f"iwanjax.studies.{module.name}")
    for module in pkgutil.iter_modules(iwanjax.studies.__path__)
]


@pytest.mark.parametrize("module", [*MODULES, recordings], ids=lambda module: module.__name__)
def test_examples_run(module, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert doctest.testmod(module).failed == 0


@pytest.mark.parametrize(
    "name", ["Study", "load_study", "Measurement", "as_recording", "StudyResults"]
)
def test_a_public_name_has_an_example(name):
    assert ">>> " in getattr(iwanjax.studies, name).__doc__
