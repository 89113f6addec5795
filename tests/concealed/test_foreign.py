"""What the laws from outside the catalogue do over a cycle: work, and how large they get."""

import numpy as np
import pytest
from concealed.foreign_places import LAWS

AMPLITUDE, STEPS = 6e-4, 4000
CONSERVATIVE = ("nonlinear_inertia", "tanh_spring")


def cycle(name: str, frequency: float = 30.0) -> tuple[np.ndarray, np.ndarray]:
    """Deflection and force of the second of two cycles, one recording."""
    law, _ = LAWS[name]
    dt = 1.0 / (frequency * STEPS)
    turn = 2.0 * np.pi * np.arange(2 * STEPS + 1) / STEPS
    d = AMPLITUDE * np.sin(turn)
    v = np.diff(d, prepend=d[:1]) / dt
    memory = np.zeros((2, 1))
    force = [float(law(d[i : i + 1], v[i : i + 1], memory, dt)[0]) for i in range(len(d))]
    return d[STEPS:], np.array(force[STEPS:])


@pytest.mark.parametrize("name", LAWS)
def test_a_law_takes_energy_or_keeps_it(name):
    d, force = cycle(name)
    middle = 0.5 * (force[1:] + force[:-1])
    work = float(np.sum(middle * np.diff(d)))
    moved = float(np.sum(np.abs(middle * np.diff(d))))
    assert moved > 0.0
    if name in CONSERVATIVE:
        assert abs(work) < 0.01 * moved
    else:
        assert work > 0.1 * moved


def test_friction_of_bristles_lies_between_its_levels():
    """Kinetic 0.7 at high rates, with the viscous part; static 1 at most."""
    _, force = cycle("lugre", 300.0)
    rate = 2.0 * np.pi * 300.0 * AMPLITUDE
    assert np.max(np.abs(force)) < 1.0 + 0.1 * rate / 0.02
    assert force[0] == pytest.approx(0.7 + 0.1 * rate / 0.02, rel=0.02)
