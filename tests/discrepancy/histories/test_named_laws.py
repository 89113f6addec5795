"""Laws that a diagnosis tries when asked for are found where they are concealed."""

import math

import pytest
from two_masses import Law, diagnosed

RIVALS = ("stiffness_error", "cubic_stiffness", "coulomb_friction", "gap_contact")
NEW = ("tanh_spring", "bouc_wen", "backlash")


def softening(k: float = 2e4, width: float = 2e-4) -> Law:
    return lambda d, v, moved: k * width * math.tanh(d / width)


def bouc_wen(k: float = 2e4, slip: float = 1.5e-4) -> Law:
    """By the rate equation, its steps as small as the motion's."""
    z = 0.0

    def law(d: float, v: float, moved: float) -> float:
        nonlocal z
        z += moved * (1.0 - (abs(z) / slip if moved * z > 0.0 else 0.0))
        return k * z

    return law


def backlash(k: float = 2e4, gap: float = 1e-4) -> Law:
    """A block that a pin drags, with as much clearance as the spring is stretched at slip."""
    block = 0.0

    def law(d: float, v: float, moved: float) -> float:
        nonlocal block
        block = min(max(block, d - 2.0 * gap), d + 2.0 * gap)
        return k * math.copysign(max(abs(d - block) - gap, 0.0), d - block)

    return law


@pytest.mark.parametrize(
    ("name", "law", "values"),
    [
        pytest.param("tanh_spring", softening, {"k": 2e4, "width": 2e-4}, marks=pytest.mark.long),
        pytest.param("bouc_wen", bouc_wen, {"k": 2e4, "slip": 1.5e-4}, marks=pytest.mark.long),
        pytest.param("backlash", backlash, {"k": 2e4, "gap": 1e-4}, marks=pytest.mark.long),
    ],
)
def test_a_concealed_law_is_found_at_its_place(name, law, values):
    found = diagnosed(law, (*RIVALS, *NEW))
    first = found.what[0]
    assert first.label == f"{name}@m1-m2"
    assert first.probability > 0.9
    assert {p.info.name: p.value for p in first.parameters} == pytest.approx(values, rel=0.05)
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
