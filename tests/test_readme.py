"""The README's example is true."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

README = Path(__file__).resolve().parents[1] / "README.md"


def test_the_example_runs_and_says_what_the_thesis_says(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    names: dict = {}
    exec(code, names)
    plt.close("all")
    omega = 2 * np.pi * np.asarray(names["solution"].curves.frequency)
    np.testing.assert_allclose(omega[0], 1.216, rtol=5e-4)
    gradient = float(capsys.readouterr().out.splitlines()[-1])
    damping = names["damping"]
    expected = float(damping(-0.5 + 1e-5) - damping(-0.5 - 1e-5)) / 2e-5
    assert gradient == pytest.approx(expected, rel=1e-5)
