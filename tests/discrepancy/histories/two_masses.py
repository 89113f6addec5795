"""Two masses with a law between them, or at one, that are struck: plain NumPy, small steps."""

from collections.abc import Callable

import numpy as np

import iwanjax as ij
from iwanjax.discrepancy import Diagnosis, StudyRecording, diagnose_histories

RATE, N, FINE = 1024.0, 700, 64
M, K = np.diag([1.0, 1.5]), np.array([[1.5e5, -6e4], [-6e4, 6e4]])
DAMPING = 2e-5 * K
PLACES = {"m1-ground": [1.0, 0.0], "m2-ground": [0.0, 1.0], "m1-m2": [-1.0, 1.0]}

Law = Callable[[float, float, float], float]
"""Deflection, rate and change of the deflection -> force; it keeps its memory itself."""


def _pulse(t: float, peak: float) -> float:
    return peak * np.sin(np.pi * (t - 0.04) / 0.01) ** 2 if 0.04 < t < 0.05 else 0.0


def recorded(
    law: Law,
    struck: int,
    peak: float,
    use: str,
    rate: float = RATE,
    samples: int = N,
    place: str = "m1-m2",
    noisy: bool = True,
) -> StudyRecording:
    """Semi-implicit Euler in small steps, of one length for all rates; noise of one density."""
    random = np.random.default_rng(round(peak))
    fine = round(FINE * RATE / rate)
    dt, row = 1.0 / (RATE * FINE), np.array(PLACES[place])
    u, v, seen, push, d = np.zeros(2), np.zeros(2), [], [], 0.0
    for i in range(samples * fine):
        f = np.zeros(2)
        f[struck] = _pulse(i * dt, peak)
        now = float(row @ u)
        a = (f - DAMPING @ v - K @ u - row * law(now, float(row @ v), now - d)) / np.diag(M)
        d = now
        if i % fine == 0:
            seen.append(a)
            push.append(f)
        v = v + dt * a
        u = u + dt * v
    response = np.array(seen)
    deviation = 5e-3 * np.std(response) * np.sqrt(rate / RATE)
    noise = noisy * deviation * random.standard_normal(response.shape)
    return StudyRecording(f"{use} {peak:g}", response + noise, np.array(push), use=use)


def diagnosed(
    law: Callable[[], Law], hypotheses: tuple[str, ...], place: str = "m1-m2"
) -> Diagnosis:
    """What is said of the masses without the law, from two hits; a third one is held out."""
    hits = [(0, 40.0, "fit"), (1, 160.0, "fit"), (0, 90.0, "hold_out")]
    return diagnose_histories(
        ij.JointedStructure(ij.LinearStructure(M, DAMPING, K), {}),
        [recorded(law(), *hit, place=place) for hit in hits],
        RATE,
        rows=PLACES,
        sensors={"a1": [1.0, 0.0], "a2": [0.0, 1.0]},
        inputs={"m1": [1.0, 0.0], "m2": [0.0, 1.0]},
        hypotheses=hypotheses,
    )
