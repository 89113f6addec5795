"""The README's examples, and what they print and make when they are run from its folder."""

import contextlib
import io
import os
import re
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]


def examples(language: str = "python") -> list[str]:
    """Code of each."""
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


def run(code: str) -> tuple[dict[str, Any], str]:
    """Names it leaves behind, and what it printed."""
    names: dict[str, Any] = {}
    printed, before = io.StringIO(), Path.cwd()
    os.chdir(ROOT)
    try:
        with contextlib.redirect_stdout(printed):
            exec(code, names)
    finally:
        os.chdir(before)
        plt.close("all")
    return names, printed.getvalue()
