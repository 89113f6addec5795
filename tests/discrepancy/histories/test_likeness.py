"""Names that a law without one is like: one of them, or two together."""

import jax
import numpy as np
import pytest

from iwanjax.discrepancy.histories.likeness import (
    SizedLaw,
    described,
    nearest,
    nearest_laws,
    nearest_pairs,
)
from iwanjax.effects.catalogue import kinds_in_time, kinds_of
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.places import Place
from iwanjax.identification.unnamed_law import blank_at, force_in, nearest_strengths
from iwanjax.joints import BoucWen, Gap, Jenkins, PlaceMotion, UnnamedLaw, hysteresis
from iwanjax.joints.duhem import FIRST_BRANCH, NODES
from iwanjax.joints.force_law import Scales
from iwanjax.joints.unnamed_terms import BANKS, BENDS, PARTS, POWERS, TERMS

K, GAP, SLIP = 4e4, 1.2e-4, 2e-5
SEEN = Scales(5e-4, 1.0 / 40.0, stiffness=1e5)
NAMES = ("coulomb_friction", "gap_contact", "cubic_stiffness", "viscous_damping", "viscoelastic")


@pytest.fixture(scope="module")
def decays() -> PlaceMotion:
    """Two free decays of 40 Hz, in steps of half a millisecond."""
    t, omega = 5e-4 * np.arange(1200), 2.0 * np.pi * 40.0
    z = np.array([[5e-4], [2e-4]]) * np.exp((1j * omega - 4.0) * t)
    d, v, a = (np.imag(x) for x in (z, 1j * omega * z, -(omega**2) * z))
    moved = np.diff(d, axis=1, prepend=0.0)
    return PlaceMotion(*map(jax.numpy.asarray, (d, v, a, moved, 5e-4)))


def kinds() -> list[ForceKind]:
    return [k for k in kinds_of(NAMES) if isinstance(k, ForceKind) and not k.within]


def test_a_gap_in_which_something_rubs_is_a_gap_and_dry_friction(decays):
    force = sum(
        np.asarray(hysteresis(law, decays.d, dt=5e-4))
        for law in (Gap(K, GAP), Jenkins(K * SLIP, K))
    )
    first, *others = nearest_pairs(kinds(), decays, force)
    found = {each.kind.name: each for each in first}
    assert set(found) == {"coulomb_friction", "gap_contact"}
    # As near as the grids of shapes have them, three steps to an octave and a half.
    assert found["gap_contact"].size == pytest.approx(K, rel=0.3)
    assert found["gap_contact"].shape == pytest.approx(GAP, rel=0.4)
    assert found["coulomb_friction"].size * found["coulomb_friction"].shape == pytest.approx(
        K * SLIP, rel=0.3
    )
    # Every pair of names once, of a gap both sides or either.
    pairs = [frozenset(str(each.kind) for each in pair) for pair in [first, *others]]
    assert len(set(pairs)) == len(pairs)
    assert max(nearest(kinds(), SEEN, decays, force).values()) < 0.5


def test_a_law_of_several_parameters_is_found_by_its_force(decays):
    """From where a search of it begins, which is far from it; dry friction is only like it."""
    exact = BoucWen(F_S=K * SLIP, K_T=K, n=1.4)
    force = np.asarray(hysteresis(exact, decays.d))
    among = kinds_in_time(("bouc_wen", "tanh_spring", "coulomb_friction", "iwan_joint"))
    first, *others = nearest_laws(among, SEEN, decays, force)
    assert first.kind.name == "bouc_wen"
    assert first.share < 1e-3
    for name in ("F_S", "K_T", "n"):
        assert float(getattr(first.law, name)) == pytest.approx(
            float(getattr(exact, name)), rel=0.01
        )
    # Of kinds without a law of their own nothing is fitted here.
    assert {each.kind.name for each in others} <= {"bouc_wen", "tanh_spring"}
    probable = nearest(among, SEEN, decays, force)
    assert next(iter(probable)) == "bouc_wen"
    assert probable["bouc_wen"] > 0.99
    assert nearest_laws(kinds(), SEEN, decays, force) == []


def test_what_cannot_be_negative_is_in_no_pair_with_another_sign(decays):
    force = -np.asarray(hysteresis(Jenkins(K * SLIP, K), decays.d, dt=5e-4))
    for pair in nearest_pairs(kinds(), decays, force):
        assert all(each.size >= 0.0 for each in pair if each.kind.positive)


def test_of_no_names_there_is_no_pair(decays):
    force = np.asarray(hysteresis(Gap(K, GAP), decays.d, dt=5e-4))
    assert nearest_pairs([], decays, force) == []
    assert nearest_pairs(kinds()[:1], decays, force) == []


@pytest.mark.parametrize(
    ("name", "size", "shape", "words"),
    [
        ("cubic_stiffness", K / 5e-4**2, 1.0, "rising with the deflection to the power 3.0"),
        ("gap_contact", K, GAP, "with a clearance"),
    ],
)
def test_a_clearance_is_told_from_a_power_of_the_deflection(decays, name, size, shape, words):
    """Neither has any stiffness at rest."""
    (kind, *_) = [each for each in kinds() if each.name == name]
    force = SizedLaw(kind, size, shape).force(decays)
    place = Place("m1", np.ones(1), Scales(float(np.max(np.abs(decays.d))), 1.0 / 40.0))
    for without in (POWERS, BENDS) if name == "cubic_stiffness" else (POWERS,):
        near = nearest_strengths(place, decays, force, np.setdiff1d(BANKS, without))
        law = blank_at(place).with_strengths(near)
        forces = {part: np.asarray(force_in(law.alone(part), decays)) for part in PARTS}
        assert described(law, decays, forces) == f"elastic, {words}, no memory"


@pytest.mark.parametrize(
    ("deep", "words"),
    [
        (0.0, "rate-independent hysteresis"),
        (0.8, "rate-independent hysteresis, pinched"),
    ],
)
def test_a_branch_that_stiffens_again_is_called_pinched(decays, deep, words):
    side = NODES[NODES.size // 2 :]
    back, held = np.split(FIRST_BRANCH, [side.size])
    onward = 1.0 - deep * np.exp(-(((side - 0.1) / 0.2) ** 2))
    branch = np.concatenate([back, held - np.log(onward[1:])])
    law = UnnamedLaw(np.eye(len(TERMS))[PARTS["duhem"].start], 5e-4, 0.1, 0.025, branch)
    forces = {name: np.asarray(force_in(law.alone(name), decays)) for name in PARTS}
    assert described(law, decays, forces) == words


def test_up_and_down_the_same_curve_is_called_a_spring(decays):
    """Its slope depends on the size of the force alone: that of tanh, 1 - w^2."""
    side = NODES[NODES.size // 2 :]
    back = np.log(np.maximum(1.0 - side**2, 0.05)) + np.log(2.0)
    branch = np.concatenate([back, np.zeros(side.size - 1)])
    law = UnnamedLaw(np.eye(len(TERMS))[PARTS["duhem"].start], 5e-4, 0.1, 0.025, branch)
    forces = {name: np.asarray(force_in(law.alone(name), decays)) for name in PARTS}
    assert described(law, decays, forces) == "elastic, softening, no memory"


@pytest.mark.parametrize(
    ("part", "share", "words"),
    [
        ("sliders", 0.03, "elastic, linear, and weaker: rate-independent hysteresis"),
        (
            "damper",
            0.03,
            "elastic, linear, and weaker: damping that grows with the rate to the power 0.5, "
            "no memory",
        ),
        ("sliders", 0.0, "elastic, nearly linear, no memory"),
    ],
)
def test_what_is_weak_beside_a_spring_is_told_for_a_spring_has_a_name(decays, part, share, words):
    strengths = np.zeros(len(TERMS))
    strengths[0] = 1.0
    strengths[2] = 0.02
    # The second of the dampers grows with a root of the rate.
    strengths[PARTS[part].start + 1] = share
    law = UnnamedLaw(strengths, 5e-4, 0.1, 0.025)
    forces = {name: np.asarray(force_in(law.alone(name), decays)) for name in PARTS}
    assert described(law, decays, forces) == words


@pytest.mark.parametrize(
    ("which", "words"),
    [
        (0, "inertia, no memory"),
        (1, "inertia that grows with the deflection, no memory"),
    ],
)
def test_masses_are_called_inertia(decays, which, words):
    largest, fastest = (float(np.max(np.abs(x))) for x in (decays.d, decays.v))
    strengths = np.zeros(len(TERMS))
    strengths[PARTS["inertia"].start + which] = 1.0
    law = UnnamedLaw(strengths, largest, fastest, 2.0 * np.pi * largest / fastest)
    forces = {name: np.asarray(force_in(law.alone(name), decays)) for name in PARTS}
    x, u = decays.d / largest, decays.v / fastest
    a = decays.a * largest / fastest**2
    expected = (a, x**2 * a + x * u**2)[which]
    np.testing.assert_allclose(forces["inertia"], expected, atol=4e-3)
    assert all(not np.any(forces[name]) for name in PARTS if name != "inertia")
    assert described(law, decays, forces) == words


@pytest.mark.parametrize(
    ("name", "size", "shape", "most"),
    [
        ("cubic_stiffness", K / 5e-4**2, 1.0, 0.01),
        # A kink between knots of the spring.
        ("gap_contact", K, GAP, 0.04),
        ("viscous_damping", 3.0, 1.0, 1e-6),
        ("viscoelastic", K, 1e-3, 0.02),
        ("coulomb_friction", K, 1e-4, 0.04),
    ],
)
def test_a_general_law_begins_as_what_a_name_does(decays, name, size, shape, most):
    """By strengths that no law refuses, over a motion that a place is not scaled to."""
    (kind, *_) = [each for each in kinds() if each.name == name]
    force = SizedLaw(kind, size, shape).force(decays)
    largest = 1.2 * float(np.max(np.abs(decays.d)))
    place = Place("m1", np.ones(1), Scales(largest, 1.0 / 40.0))
    left = {}
    for spring, without in {"splines": POWERS, "powers": BENDS}.items():
        near = nearest_strengths(place, decays, force, np.setdiff1d(BANKS, without))
        law = blank_at(place).with_strengths(near)
        off = np.asarray(force_in(law, decays)) - force
        left[spring] = np.linalg.norm(off) / np.linalg.norm(force)
    assert left["splines"] < most
    if name == "cubic_stiffness":
        assert left["powers"] < 1e-6
