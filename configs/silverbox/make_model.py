"""The linear model of the Silverbox circuit, from the lowest level of its recording.

The circuit (Wigren and Schoukens 2013) stands for a mass on a spring, damper and cubic spring; its
volts stand for force and deflection. Where it is driven least the cubic spring matters little, so
a mass, a damper and a spring are fitted there, by transfer function and nothing of iwanjax.
``model.npz`` holds them, with no joint; the recording itself is not part of the repository.

    python configs/silverbox/make_model.py ../shared/data/silverbox/SNLS80mV.mat --out DIR
"""

import argparse
from pathlib import Path

import numpy as np
import scipy.io
import scipy.optimize

RATE = 1e7 / 2**14
LOW = slice(127_500, 131_072)
"""The end of the recording, from rest."""
OFFSET = 6.2e-3
"""V, of the input where it rests."""


def linear_response(force: np.ndarray, m: float, c: float, k: float) -> np.ndarray:
    """Of an oscillator from rest; the force is band-limited, and silent from its end on."""
    omega = 2.0 * np.pi * np.fft.rfftfreq(2 * len(force), 1.0 / RATE)
    shown = np.fft.rfft(force, 2 * len(force)) / (k - m * omega**2 + 1j * c * omega)
    return np.fft.irfft(shown)[: len(force)]


def identified(force: np.ndarray, response: np.ndarray) -> np.ndarray:
    """m, c and k that suit a record best, from 68 Hz and 5 % of critical damping.

    The zero of the response is fitted with them.
    """
    omega = 2.0 * np.pi * 68.0
    begin = np.array([1.0 / omega**2, 0.1 / omega, 1.0])

    def off(logarithm: np.ndarray) -> np.ndarray:
        error = linear_response(force, *(begin * np.exp(logarithm))) - response
        return error - error.mean()

    found = scipy.optimize.least_squares(off, np.zeros(3), x_scale=0.1)
    return begin * np.exp(found.x)


def main() -> None:
    """Write ``model.npz``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    given = parser.parse_args()
    both = scipy.io.loadmat(given.recording)
    force, response = (both[name].ravel()[LOW] for name in ("V1", "V2"))
    m, c, k = identified(force - OFFSET, response)
    one = np.ones((1, 1))
    given.out.mkdir(parents=True, exist_ok=True)
    np.savez(
        given.out / "model.npz",
        M=m * one,
        C=c * one,
        K=k * one,
        row_labels=["mass"],
        rows=one,
        sensor_labels=["x"],
        sensor_rows=one,
        input_labels=["V1"],
        input_rows=one,
    )
    print(f"m = {m:.5g}, c = {c:.5g}, k = {k:.5g}: {np.sqrt(k / m) / (2.0 * np.pi):.2f} Hz")


if __name__ == "__main__":
    main()
