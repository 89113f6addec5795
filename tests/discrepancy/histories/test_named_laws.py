"""Laws that come in where all others leave more than noise are found where they are concealed."""

import math

import pytest
from two_masses import FINE, RATE, Law, N, diagnosed

RIVALS = ("stiffness_error", "cubic_stiffness", "coulomb_friction", "gap_contact")
LATE = ("tanh_spring", "bouc_wen", "backlash", "changing_stiffness")


def softening(k: float = 2e4, width: float = 2e-4) -> Law:
    return lambda d, v, moved: k * width * math.tanh(d / width)


def bouc_wen(k: float = 2e4, slip: float = 1.5e-4, n: float = 2.0) -> Law:
    """By the rate equation, its steps as small as the motion's."""
    z = 0.0

    def law(d: float, v: float, moved: float) -> float:
        nonlocal z
        z += moved * (1.0 - (abs(z / slip) ** n if moved * z > 0.0 else 0.0))
        return k * z

    return law


def backlash(k: float = 2e4, gap: float = 1e-4, stretch: float = 3e-5) -> Law:
    """A block that a pin drags through a clearance, the spring stretched so far at slip."""
    block = 0.0

    def law(d: float, v: float, moved: float) -> float:
        nonlocal block
        reach = gap + stretch
        block = min(max(block, d - reach), d + reach)
        return k * math.copysign(max(abs(d - block) - gap, 0.0), d - block)

    return law


def loosening(rate: float = -8e3 * RATE / N) -> Law:
    """A spring that is lost evenly over the recording."""
    steps = 0

    def law(d: float, v: float, moved: float) -> float:
        nonlocal steps
        t, steps = steps / (RATE * FINE), steps + 1
        return rate * t * d

    return law


def rubbing_freeplay(k: float = 4e4, gap: float = 1.2e-4, slip: float = 2e-5) -> Law:
    """A clearance in which something rubs."""
    stretch = 0.0

    def law(d: float, v: float, moved: float) -> float:
        nonlocal stretch
        stretch = min(max(stretch + moved, -slip), slip)
        return k * stretch + k * math.copysign(max(abs(d) - gap, 0.0), d)

    return law


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "law", "values"),
    [
        ("tanh_spring", softening, {"k": 2e4, "width": 2e-4}),
        ("bouc_wen", bouc_wen, {"F_S": 3.0, "K_T": 2e4, "n": 2.0}),
        ("backlash", backlash, {"F_S": 0.6, "K_T": 2e4, "gap": 1e-4}),
        ("changing_stiffness", loosening, {"rate": -8e3 * RATE / N}),
    ],
)
def test_a_concealed_law_is_found_at_its_place(name, law, values):
    found = diagnosed(law, (*RIVALS, *LATE))
    first = found.what[0]
    assert first.label == f"{name}@m1-m2"
    assert first.probability > 0.9
    known = {p.info.name: p.value for p in first.parameters}
    assert {name: known[name] for name in values} == pytest.approx(values, rel=0.05)
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert found.model is not None
    assert found.model.labels == (first.label,)


@pytest.mark.long
def test_two_laws_at_one_place_are_found_that_alone_look_like_neither():
    found = diagnosed(rubbing_freeplay, (*RIVALS, "viscoelastic", "viscous_damping"))
    first, second = sorted(found.what[:2], key=lambda each: each.kind.name)
    assert first.label == "coulomb_friction@m1-m2"
    assert second.label == "gap_contact@m1-m2"
    assert min(first.probability, second.probability) > 0.9
    assert [p.value for p in first.parameters] == pytest.approx([4e4, 2e-5], rel=0.05)
    assert [p.value for p in second.parameters] == pytest.approx([4e4, 1.2e-4], rel=0.05)
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out


@pytest.mark.long
def test_a_law_that_another_explains_almost_to_the_noise_is_found_all_the_same():
    """Names that were never tried have no probability: so weak a force dry friction explains.

    Half as strong, it is dry friction that is named, and Bouc-Wen as what nothing speaks against:
    what contains a simpler law has to explain more than the model's own errors may be worth.
    """

    def law():
        return bouc_wen(600.0)

    without = diagnosed(law, RIVALS)
    assert without.what[0].label == "coulomb_friction@m1-m2"
    assert without.after.fit < 1.2 * without.noise_floor.fit
    found = diagnosed(law, (*RIVALS, "bouc_wen"))
    assert found.what[0].label == "bouc_wen@m1-m2"
    assert found.what[0].probability > 0.9
