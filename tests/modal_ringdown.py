"""The script behind configs/modal_ringdown, as a module: its data's proof, and a slider oracle."""

import importlib.util
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "configs" / "modal_ringdown"

_spec = importlib.util.spec_from_file_location("make_hits", FOLDER / "make_hits.py")
make_hits = importlib.util.module_from_spec(_spec)
# Where dataclasses look for the module they belong to.
sys.modules[_spec.name] = make_hits
_spec.loader.exec_module(make_hits)
