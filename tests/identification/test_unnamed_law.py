"""The general law in a fit: nothing at no strength; where a spring and damper miss, both."""

import math
from dataclasses import replace

import numpy as np
import pytest
from linear_pair import ROWS, C, M, measured_force, problem, simulated, stiffness_with_joint

from iwanjax.effects.kinds import UnnamedKind
from iwanjax.identification.hypotheses import LawStart
from iwanjax.identification.linearise import residuals_at
from iwanjax.identification.unnamed_law import (
    blank_at,
    fit_unnamed_law,
    loosened,
    resonating,
    with_unnamed_law,
)
from iwanjax.joints.unnamed_terms import BANKS, ELASTIC, FEW, LINEAR, PARTS, RESONATES, TERMS

NOISE = np.array([0.03, 0.02])
MORE, DAMPER = 4e3, 6.0
HITS = ((60.0, 0), (25.0, 1))


@pytest.fixture(scope="module")
def pair():
    """Two hits of masses with a spring and a damper more at m2 than the model has."""
    random, row = np.random.default_rng(5), np.outer(ROWS["m2"], ROWS["m2"])
    stiffness, damping = stiffness_with_joint() + MORE * row, C + DAMPER * row
    clean = [simulated(p, struck=at, stiffness=stiffness, damping=damping) for p, at in HITS]
    seen = [y + NOISE * random.standard_normal(y.shape) for y in clean]
    made, places = problem(seen, [measured_force(*hit) for hit in HITS], NOISE)
    return made, {each.label: each for each in places}


def no_force(made, place):
    return LawStart(blank_at(place), np.zeros(made.parameters))


def test_a_law_without_strength_changes_no_residual(pair):
    made, places = pair
    z = np.zeros(made.parameters)
    other, (start,) = with_unnamed_law(
        made, UnnamedKind(), places["m2"], [no_force(made, places["m2"])]
    )
    at = made.nothing(), made.still(made.map.given(z))
    (without,) = residuals_at(made, [at], 8.0)
    (with_it,) = residuals_at(other, [(start.hypothesis, other.still(start.theta))], 8.0)
    np.testing.assert_allclose(with_it, without, atol=1e-7 * np.max(np.abs(without)))


def test_a_force_that_takes_more_than_a_place_has_of_momentum_stops_it(pair):
    place, v = pair[1]["m2"], np.sin(np.arange(50.0))
    damper = place.scales.mass / 1e-3
    assert place.stopped(v, 1.1 * damper * v, 1e-3)
    assert not place.stopped(v, 0.9 * damper * v, 1e-3)


def test_a_part_begins_as_strong_as_it_is_known_to_be(pair):
    """No search goes farther than eight prior deviations, nor does it begin there."""
    made, places = pair
    place, strengths = places["m2"], np.zeros(len(TERMS))
    usual = place.scales.deflection * place.scales.stiffness
    strengths[PARTS["damper"]] = 100.0 * usual
    strengths[0] = -0.5 * usual
    none = no_force(made, place)
    strong = LawStart(none.law.with_strengths(strengths), none.z)
    other, (_, start) = with_unnamed_law(made, UnnamedKind(), place, [none, strong], BANKS)
    joint = other.joints[-1]
    loose = np.asarray(joint.loose)
    assert loose[PARTS["damper"]] == pytest.approx(100.0 * usual)
    assert loose[PARTS["spring"]] == pytest.approx(usual)
    own = start.theta[made.parameters :][: joint.count]
    np.testing.assert_allclose(joint.at(own).strengths, strengths)


def test_an_oscillator_is_where_a_law_that_resonates_begins():
    """Attached to m2; the general law begins as it, and leaves what it leaves."""
    m, w, ratio = 0.05, 2.0 * math.pi * 70.0, 0.03
    mass, row = np.diag([*np.diag(M), m]), np.array([0.0, 1.0, -1.0])
    stiffness, damping = np.zeros((2, 3, 3))
    stiffness[:2, :2], damping[:2, :2] = stiffness_with_joint(), C
    stiffness += m * w**2 * np.outer(row, row)
    damping += 2.0 * ratio * m * w * np.outer(row, row)
    whole, random = (
        {"mass": mass, "stiffness": stiffness, "damping": damping},
        np.random.default_rng(6),
    )
    seen = [simulated(peak, struck=at, **whole) for peak, at in HITS]
    seen = [y + NOISE * random.standard_normal(y.shape) for y in seen]
    made, places = problem(seen, [measured_force(*hit) for hit in HITS], NOISE)
    (place,) = (each for each in places if each.label == "m2")
    begun = resonating(made, place, [np.zeros(made.parameters)], 12)
    frequency, damped = np.exp(np.stack(begun.law.resonance)) / [place.scales.period, 1.0]
    assert frequency == pytest.approx(70.0, rel=0.01)
    assert damped == pytest.approx(ratio, rel=0.2)
    carried = np.stack(begun.law.strengths)[RESONATES]
    assert carried == pytest.approx(
        m * float(begun.law.rate) * 2.0 * math.pi / place.scales.period, rel=0.1
    )
    found = fit_unnamed_law(made, UnnamedKind(), place, [begun], (2.0,), 0)
    assert found.fitted.misfit.sum() < 1.1 * np.count_nonzero(made.data.weight)


@pytest.mark.long
def test_terms_take_part_as_far_as_the_recordings_ask_for_them(pair):
    """A spring that is missing needs no others; a damper that is missing as well does."""
    made, places = pair
    place = places["m2"]
    random, row = np.random.default_rng(7), np.outer(ROWS["m2"], ROWS["m2"])
    stiffness = stiffness_with_joint() + MORE * row
    seen = [simulated(peak, struck=at, stiffness=stiffness) for peak, at in HITS]
    seen = [y + NOISE * random.standard_normal(y.shape) for y in seen]
    alone, _ = problem(seen, [measured_force(*hit) for hit in HITS], NOISE)
    taken = {}
    for name, each in (("spring", alone), ("both", made)):
        begun = [no_force(each, place)]
        law = fit_unnamed_law(each, UnnamedKind(), place, begun, (2.0, 8.0), 12, terms=LINEAR)
        taken[name] = law.joint.free
        assert law.fitted.misfit.sum() < 1.06 * np.count_nonzero(each.data.weight)
    assert taken == {"spring": LINEAR, "both": FEW}


@pytest.mark.long
def test_a_missing_spring_and_damper_are_the_law_that_is_fitted(pair):
    made, places = pair
    place = places["m2"]
    begun = [no_force(made, place)]
    found = fit_unnamed_law(made, UnnamedKind(), place, begun, (2.0, 8.0, math.inf), 12)
    law, reach = found.law, place.scales.deflection
    assert all(float(each) >= 0.0 for each in law.strengths[ELASTIC:])
    d = reach * np.array([-0.9, -0.4, 0.3, 0.8])
    np.testing.assert_allclose(law.backbone(d), MORE * d, atol=0.05 * MORE * reach)
    # In the amplitudes and about the rate of the motion itself.
    omega = 2.0 * math.pi / place.scales.period
    lost = float(law.dissipation(0.4 * reach, omega=omega))
    assert lost == pytest.approx(math.pi * DAMPER * omega * (0.4 * reach) ** 2, rel=0.1)
    # As little is left as the noise leaves of residuals that allow for errors of the model.
    assert found.fitted.misfit.sum() < np.count_nonzero(made.data.weight)
    assert 1.0 < found.determined.sum() < len(TERMS)
    # A prior of another width is another unit of the same law.
    other = loosened(found)
    np.testing.assert_allclose(other.law.strengths, law.strengths, rtol=1e-9, atol=1e-12)
    assert np.any(np.asarray(other.problem.joints[-1].loose) != found.problem.joints[-1].loose)
    # Of one that broke down nothing is known, and a prior without a width would break the next.
    squares = found.fitted.squares
    lost = squares._replace(normal=np.full_like(squares.normal, np.nan))
    solution = replace(found.fitted.solution, groups=lost)
    broken = loosened(replace(found, fitted=replace(found.fitted, solution=solution)))
    assert np.all(np.isfinite(broken.problem.joints[-1].loose))
