"""A cantilever hit by a hammer: Euler and Bernoulli's elements, each mode integrated by SciPy."""

from typing import Any

import numpy as np
import scipy.linalg
import scipy.signal

SENSORS = tuple(f"a{k + 1}" for k in range(12))
POINTS = (2, 5, 8, 11)
"""Sensors that are hit beside."""
ZETA = np.array([0.008, 0.004, 0.003, 0.003, 0.004] + [0.006] * 7)
RATE, DURATION, FINE = 2048, 4.0, 8


def beam(length=0.62, depth=0.008, width=0.03, modulus=210e9, density=7850.0):
    """Natural frequencies in rad/s and mass-normalised shapes at the twelve nodes."""
    n = len(SENSORS)
    h, EI = length / n, modulus * width * depth**3 / 12.0
    k = EI / h**3 * np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h * h, -6 * h, 2 * h * h],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h * h, -6 * h, 4 * h * h],
        ]
    )  # fmt: skip
    m = density * width * depth * h / 420.0 * np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h * h, 13 * h, -3 * h * h],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
        ]
    )  # fmt: skip
    K, M = np.zeros((2 * n + 2, 2 * n + 2)), np.zeros((2 * n + 2, 2 * n + 2))
    for e in range(n):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += k
        M[at, at] += m
    squares, Phi = scipy.linalg.eigh(K[2:, 2:], M[2:, 2:])
    return np.sqrt(squares), Phi[::2]


def hits(random, *, repeats=2, noise=0.01):
    """Time, accelerations and force of hits at each point, noise as share of the mean rms."""
    omega, Phi = beam()
    fine = np.arange(round(RATE * DURATION * FINE)) / (RATE * FINE)
    low_pass = scipy.signal.butter(8, 0.4 * RATE, fs=RATE * FINE, output="sos")
    for point in POINTS:
        for _ in range(repeats):
            begin, width = 0.02, 2e-3
            inside = (fine > begin) & (fine < begin + width)
            force = random.uniform(80.0, 120.0) * np.where(
                inside, np.sin(np.pi * (fine - begin) / width) ** 2, 0.0
            )
            response = np.zeros((len(fine), len(SENSORS)))
            for k, zeta in enumerate(ZETA):
                system = ([Phi[point, k], 0.0, 0.0], [1.0, 2 * zeta * omega[k], omega[k] ** 2])
                discrete: Any = scipy.signal.cont2discrete(
                    system, 1.0 / (RATE * FINE), method="foh"
                )
                b, a = discrete[:2]
                response += np.outer(scipy.signal.lfilter(b.ravel(), a, force), Phi[:, k])
            response = scipy.signal.sosfiltfilt(low_pass, response, axis=0)[::FINE]
            force = scipy.signal.sosfiltfilt(low_pass, force)[::FINE]
            deviation = noise * np.mean(np.std(response, axis=0))
            response = response + deviation * random.standard_normal(response.shape)
            force = force + 1e-3 * np.max(force) * random.standard_normal(force.shape)
            yield point, response, force
