"""What the laws from outside the catalogue do over a cycle: work, and how large they get."""

import numpy as np
import pytest
from concealed.foreign import CASES

from iwanjax.trial.effects import Effect
from iwanjax.trial.foreign_laws import LAWS, foreign

STIFFNESS, AMPLITUDE, FREQUENCY, STEPS = 1e5, 6e-4, 30.0, 4000
RATE = 2.0 * np.pi * FREQUENCY * AMPLITUDE
CONSERVATIVE = ("inertia", "softening")


def cycle(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Deflection and force of the second of two cycles, one recording."""
    case = CASES[name]
    dt = 1.0 / (FREQUENCY * STEPS)
    law = foreign(Effect(case.kind, case.where, case.build(STIFFNESS, AMPLITUDE, RATE)), 1, dt)
    assert law is not None
    turn = 2.0 * np.pi * np.arange(2 * STEPS + 1) / STEPS
    d, v = AMPLITUDE * np.sin(turn), RATE * np.cos(turn)
    force = [float(law(d[i : i + 1], v[i : i + 1])[0]) for i in range(len(d))]
    return d[STEPS:], np.array(force[STEPS:])


def test_every_law_has_a_case():
    assert sorted(case.kind for case in CASES.values()) == sorted(LAWS)


def test_a_fractional_damper_turns_with_the_power_of_the_frequency():
    """Over a cycle, begun long ago: c (i omega)^order of the deflection."""
    c, order, turns = 3.0, 0.5, 40
    law = foreign(Effect("fractional_damper", "a", (c, order)), 1, 1.0 / (FREQUENCY * 400))
    assert law is not None
    turn = 2.0 * np.pi * np.arange(400 * turns) / 400
    force = np.array([float(law(np.sin([t]), np.cos([t]))[0]) for t in turn])[-400:]
    found = 2.0 * np.mean(force * np.exp(-1j * turn[-400:])) * 1j
    assert found == pytest.approx(c * (2.0j * np.pi * FREQUENCY) ** order, rel=0.02)


def test_an_attached_mass_is_one_far_below_its_frequency():
    m, times = 0.7, 6.0
    values = (m, times * 2.0 * np.pi * FREQUENCY, 0.3)
    law = foreign(Effect("attached_mass", "a", values), 1, 1.0 / (FREQUENCY * STEPS))
    assert law is not None
    turn = 2.0 * np.pi * np.arange(6 * STEPS) / STEPS
    d, v = AMPLITUDE * np.sin(turn), RATE * np.cos(turn)
    force = np.array([float(law(d[i : i + 1], v[i : i + 1])[0]) for i in range(len(d))])
    found = 2.0j * np.mean(force[-STEPS:] * np.exp(-1j * turn[-STEPS:])) / AMPLITUDE
    ratio = 1.0 / times
    shift = (1.0 + 0.6j * ratio) / (1.0 - ratio**2 + 0.6j * ratio)
    expected = -m * (2.0 * np.pi * FREQUENCY) ** 2 * shift
    assert found == pytest.approx(expected, rel=0.01)
    # What a damper takes.
    assert found.imag == pytest.approx(expected.imag, rel=0.05)
    assert found.imag > 0.0


# A mass of its own has not come to rest within two cycles.
@pytest.mark.parametrize("name", [name for name in CASES if name != "attached"])
def test_a_law_takes_energy_or_keeps_it(name):
    d, force = cycle(name)
    middle = 0.5 * (force[1:] + force[:-1])
    work = float(np.sum(middle * np.diff(d)))
    moved = float(np.sum(np.abs(middle * np.diff(d))))
    assert moved > 0.0
    if name in CONSERVATIVE:
        assert abs(work) < 0.01 * moved
    else:
        assert work > 0.05 * moved


def test_friction_of_bristles_lies_between_its_levels():
    """Kinetic at the highest rate, with the viscous part; static at most."""
    _, force = cycle("bristles")
    _, _, viscous, kinetic, static, _ = CASES["bristles"].build(STIFFNESS, AMPLITUDE, RATE)
    assert np.max(np.abs(force)) < static + viscous * RATE
    assert force[0] == pytest.approx(kinetic + viscous * RATE, rel=0.02)
