"""The README's example is true."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

README = Path(__file__).resolve().parents[1] / "README.md"


def test_the_example_runs_and_says_what_the_thesis_says(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    names: dict = {}
    exec(code, names)
    plt.close("all")
    omega = 2 * np.pi * np.asarray(names["solution"].curves.frequency)
    np.testing.assert_allclose(omega[0], 1.216, rtol=5e-4)
    assert "-" in capsys.readouterr().out  # the gradient: a larger chi damps less
