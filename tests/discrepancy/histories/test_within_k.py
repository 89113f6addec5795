"""Laws whose stiffness at rest a linear model from low levels holds already."""

import numpy as np
import pytest
from two_masses import PLACES, K, diagnosed

from iwanjax.discrepancy import CATALOGUE
from iwanjax.effects.kinds import ForceKind, JointKind
from iwanjax.effects.wording import sentence
from iwanjax.joints import Jenkins
from iwanjax.joints.force_law import PlaceMotion, Scales

STIFFNESS, SLIP = 2e4, 3e-4
PLAIN, WITHIN = (kind for kind in CATALOGUE["coulomb_friction"] if isinstance(kind, ForceKind))


def slider():
    """Dry friction of which K holds the spring: what it differs from that."""
    stretch = 0.0

    def law(d, v, moved):
        nonlocal stretch
        stretch = min(max(stretch + moved, -SLIP), SLIP)
        return STIFFNESS * (stretch - d)

    return law


def test_friction_that_sticks_in_k_is_found_and_taken_out_of_it():
    """Without the variant it takes two effects: less stiffness, and a slider of just as much."""
    names = ("coulomb_friction", "stiffness_error", "viscous_damping", "cubic_stiffness")
    found = diagnosed(slider, names)
    first = found.what[0]
    assert (first.label, first.kind) == ("coulomb_friction@m1-m2", WITHIN)
    assert not first.joint_with
    assert first.probability > 0.9
    values = {p.info.name: p.value for p in first.parameters}
    assert values == pytest.approx({"k": STIFFNESS, "slip": SLIP}, rel=0.01)
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert found.model is not None
    row = np.array(PLACES["m1-m2"])
    assert pytest.approx(K - values["k"] * np.outer(row, row), rel=1e-9) == found.model.structure.K
    joint = found.model.joints["coulomb_friction@m1-m2"]
    assert isinstance(joint, Jenkins)
    assert float(joint.K_T) == pytest.approx(values["k"])


def microslip():
    """Sliders in parallel, their slips spread evenly: an Iwan joint of chi = 0 and beta = 0."""
    slips, stretch = 4.0 * SLIP * (np.arange(40) + 0.5) / 40, np.zeros(40)

    def law(d, v, moved):
        nonlocal stretch
        stretch = np.clip(stretch + moved, -slips, slips)
        return STIFFNESS * (np.mean(stretch) - d)

    return law


@pytest.mark.long
def test_a_joint_left_out_that_sticks_in_k_is_found_and_taken_out_of_it():
    names = ("coulomb_friction", "stiffness_error", "viscous_damping", "iwan_joint")
    found = diagnosed(microslip, names)
    first = found.what[0]
    assert first.label == "iwan_joint@m1-m2"
    assert isinstance(first.kind, JointKind)
    assert first.kind.within
    assert not first.joint_with
    values = {p.info.name: p.value for p in first.parameters}
    assert values["K_T"] == pytest.approx(STIFFNESS, rel=0.05)
    assert found.after.hold_out < 1.5 * found.noise_floor.hold_out
    assert found.model is not None
    row = np.array(PLACES["m1-m2"])
    assert pytest.approx(K - values["K_T"] * np.outer(row, row), rel=1e-6) == np.asarray(
        found.model.structure.K
    )
    assert "iwan_joint@m1-m2" in found.model.joints


def test_nothing_acts_before_it_gives_way_and_less_stiffness_from_then_on():
    d = np.array([0.5, 1.0, 3.0, -1.0])
    moved = np.diff(d, prepend=0.0)
    memory, forces = 0.0, []
    for now, by in zip(d, moved, strict=True):
        motion = PlaceMotion(now, 0.0, 0.0, by, 1e-3)
        force, memory = WITHIN.unit_force(motion, 1.0, memory)
        forces.append(float(force))
    assert forces == pytest.approx([0.0, 0.0, 1.0 - 3.0, -1.0 + 1.0])
    assert all(0 < shape < 1.0 for shape in WITHIN.shapes(Scales(1.0, 1.0)))


def test_one_that_gives_way_at_once_is_less_stiffness():
    (nested,) = WITHIN.limits
    spring = CATALOGUE["stiffness_error"][0]
    assert nested.means(spring)
    assert nested.narrowed((7.0, 1e-3)) == ((-7.0,),)
    size, slip = nested.widened((-7.0,), Scales(2.0, 1.0), 1e-3)
    assert (size, slip) == (7.0, 2e-3)
    # A joint left out that slides at once is plain friction: K holds nothing of it.
    for joint, wanted in zip(CATALOGUE["iwan_joint"], ([1, 0], [0, 1]), strict=True):
        assert isinstance(joint, JointKind)
        meant = [[each.means(kind) for each in joint.limits] for kind in (PLAIN, WITHIN)]
        assert [sum(each) for each in meant] == wanted


def test_the_words_say_what_k_holds():
    assert sentence(WITHIN, "m1-m2").endswith("m1 and m2, with its stiffness at rest in K already")
    assert "in K" not in sentence(PLAIN, "m1-m2")
