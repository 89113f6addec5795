"""A law that contains another one never fits worse than it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from struck_mass import JOINT, searching, struck
from two_masses import diagnosed

from iwanjax.discrepancy.histories import selection
from iwanjax.discrepancy.histories.nested import begun_from, holding, none_worse, widened
from iwanjax.discrepancy.histories.ranking import STEPS, TIME_CONSTANT, RankedFit, tolerance_of
from iwanjax.discrepancy.histories.restarts import nominal_fit
from iwanjax.discrepancy.histories.screening import screened, with_first_fits
from iwanjax.effects.catalogue import CATALOGUE, kinds_in_time, kinds_of
from iwanjax.effects.faults import (
    TURNED,
    AbstractFault,
    AbstractForceFault,
    AbstractSensorFault,
)
from iwanjax.effects.kinds import ForceKind, JointKind, Kind
from iwanjax.effects.nested import Nested
from iwanjax.identification.hypotheses import (
    JointStart,
    LawStart,
    channel,
    force,
    joined,
    sensor,
    with_joint,
    with_law,
    with_stiction,
)
from iwanjax.identification.linearise import residuals_at
from iwanjax.identification.multistart import multistart
from iwanjax.identification.problem import Start
from iwanjax.joints import AttachedOscillator, Scales


def _key_of(kind: Kind) -> str:
    """Name and variant."""
    return f"{kind.name} {getattr(kind, 'variant', '')}".strip()


KINDS = {_key_of(kind): kind for kind in kinds_of()}
# Those too that are tried only where they are named.
ALL = {_key_of(kind): kind for kinds in CATALOGUE.values() for kind in kinds}
# And with all of their parameters.
WHOLE = {_key_of(kind): kind for kind in kinds_in_time() if getattr(kind, "law", None)}


def _limits(kind: Kind) -> tuple[Nested, ...]:
    return getattr(kind, "limits", ())


def _key(nested: Nested) -> str:
    """Of the simpler kind, of which K may hold the stiffness as of the whole."""
    return next(key for key, kind in KINDS.items() if nested.means(kind))


LAWS = [
    pytest.param(kind, nested, id=f"{word}{name}, {nested.name}")
    for word, kinds in (("", ALL), ("whole ", WHOLE))
    for name, kind in kinds.items()
    for nested in _limits(kind)
]
# One set of kernels serves all searches.
NAMES = (
    "bilinear_stiffness",
    "coulomb_friction",
    "cubic_stiffness",
    "gap_contact",
    "stiffness_error",
    "viscous_damping",
    "viscoelastic",
)
# Share of what was measured that is no difference.
HARDLY = 1e-3


@pytest.mark.parametrize(("kind", "nested"), LAWS)
@given(
    st.floats(1e-3, 1e6),
    st.floats(1e-6, 1e3),
    st.floats(1e-6, 1.0),
    st.floats(1e-3, 10.0),
    st.floats(1e-4, 0.1),
)
def test_a_law_is_found_again_where_it_was_begun_from(
    kind, nested: Nested, size, shape, deflection, period, share
):
    simpler = KINDS[nested.name]
    values = (size, shape) if getattr(simpler, "shape", None) else (size,)
    if isinstance(simpler, AbstractFault):
        values = (TURNED,)
    there = nested.widened(values, Scales(deflection, period), share)
    back = nested.narrowed(there)
    assert any(np.allclose(each, values, rtol=1e-9) for each in back)


@pytest.fixture(scope="module")
def searched():
    """A mass that a spring is missing from, with all that may be missing instead."""
    names = (*NAMES, *(kind.name for kind in kinds_of() if isinstance(kind, AbstractSensorFault)))
    return searching(struck(lambda d: 8e3 * d), names=tuple(dict.fromkeys(names)))


Z = np.array([0.3, -0.2, 0.1, 0.2])


def begun(searched, *names: str, stiffness: float = 5e3) -> RankedFit:
    """An entry of kinds at the only place or sensor, in the free run.

    An observer is designed for a model's linear part, which a gap has not and a spring is.
    """
    problem, scope = searched
    (place,) = scope.places
    sizes = {"cubic_stiffness": 1e9, "viscous_damping": 5.0}
    shapes = {"viscoelastic": 0.01, "sensor_saturation": 50.0}
    starts, own = [], problem
    for name in names:
        kind = KINDS[name]
        if isinstance(kind, ForceKind):
            law = sizes.get(name, stiffness), shapes.get(name, 3e-4)
            starts.append(force(problem, kind, "J1", np.asarray(place.row), Z, *law))
        elif isinstance(kind, AbstractSensorFault):
            size = shapes.get(name, 0.1)
            starts.append(sensor(problem, kind, 0, "a1", Z, size))
        elif isinstance(kind, AbstractForceFault):
            starts.append(channel(problem, kind, 0, "m1", Z, 0.1))
    beside = starts[0] if starts else None
    for kind in (KINDS[name] for name in names):
        if isinstance(kind, JointKind) and kind.name == "stiction":
            own, starts = with_stiction(problem, kind, 0, "J1", (0.6,), Z, beside)
        elif isinstance(kind, JointKind) and kind.law:
            joint = AttachedOscillator(0.1, 5e3, 1.0)
            own, starts = with_law(problem, kind, place, [LawStart(joint, Z)])
        elif isinstance(kind, JointKind):
            own, starts = with_joint(problem, kind, place, [JointStart(5e3, 3e-4, Z)], beside)
    if not names:
        starts = [Start(problem.nothing(), np.append(Z, [0.0, 0.0]))]
    return RankedFit(own, multistart(own, [joined(own, starts)], math.inf, 0)[0])


CONTAINED = [
    *(((name,), (_key(each),)) for name, kind in KINDS.items() for each in _limits(kind)),
    *(((name,), ()) for name in NAMES),
    *(
        ((name,), ())
        for name in ("sensor_gain", "sensor_delay", "sensor_high_pass", "sensor_saturation")
    ),
    (("force_gain",), ()),
    (("force_delay",), ()),
    pytest.param(("iwan_joint",), (), marks=pytest.mark.long),
    pytest.param(("stiction",), (), marks=pytest.mark.long),
    pytest.param(("stiffness_error", "sensor_gain"), ("sensor_gain",), marks=pytest.mark.long),
    pytest.param(("viscoelastic", "cubic_stiffness"), ("viscous_damping",), marks=pytest.mark.long),
    pytest.param(
        ("viscoelastic", "cubic_stiffness"),
        ("cubic_stiffness", "stiffness_error"),
        marks=pytest.mark.long,
    ),
    pytest.param(("iwan_joint", "stiffness_error"), ("iwan_joint",), marks=pytest.mark.long),
    pytest.param(("iwan_joint", "stiffness_error"), ("coulomb_friction",), marks=pytest.mark.long),
    pytest.param(("stiction", "cubic_stiffness"), ("cubic_stiffness",), marks=pytest.mark.long),
]


@pytest.mark.parametrize(("whole", "part"), CONTAINED)
def test_a_law_is_begun_where_it_predicts_what_one_that_it_contains_does(searched, whole, part):
    problem, scope = searched
    # What K holds already and gives way is less stiffness.
    within = any(getattr(KINDS[name], "within", False) for name in whole)
    large = begun(searched, *whole)
    small = begun(searched, *part, stiffness=-5e3 if within else 5e3)
    starts = widened(large, small, scope, problem)
    # Doing nothing at all is tried with smaller shares, but for a joint's own fault.
    guessed = not part and not {"stiction", "iwan_joint", "joint_drift"} & set(whole)
    assert len(starts) == (6 if guessed else 4)
    assert all(start.hypothesis.label == large.fitted.hypothesis.label for _, start in starts)
    off = [
        np.linalg.norm(seen - small.fitted.residual)
        for own, each in starts
        for seen in residuals_at(own, [(each.hypothesis, each.theta)], math.inf)
    ]
    wave = np.linalg.norm(np.asarray(problem.data.weight * problem.data.response))
    assert off[-1] < HARDLY * wave
    # A mass that stays at rest ends at 4e-7 of the wave, by the search's integration: the law alone
    # is exact to 1e-14. That is a hundredth of the noise of one sample.
    at_rest = whole == ("attached_oscillator",) and part == ("viscous_damping",)
    assert off[-1] < 1.01 * min(off) + (1e-6 if at_rest else 1e-12) * wave
    # It begins from there, and costs no more for where its joints are.
    own, start = starts[-1]
    (fitted,) = multistart(own, [start], math.inf, 0)
    assert fitted.cost == pytest.approx(small.fitted.cost, rel=0.1)


@pytest.mark.parametrize("known", ["coulomb_friction", "iwan_joint"])
def test_a_law_begins_as_what_a_place_is_known_to_do_or_as_what_both_become(searched, known):
    problem, scope = searched
    (place,), entry = scope.places, begun(searched, known)
    starts = list(begun_from(WHOLE["bouc_wen"], place, [entry], problem))
    law, z = starts[0]
    assert float(law.K_T) == pytest.approx(5e3)
    assert 0.5 < float(law.F_S) / (5e3 * 3e-4) < 1.0 + 1e-9
    assert float(law.n) == pytest.approx(2.0)
    np.testing.assert_allclose(z, Z)
    assert not list(begun_from(WHOLE["bouc_wen"], replace(place, label="b"), [entry], problem))
    assert not list(begun_from(WHOLE["attached_oscillator"], place, [entry], problem))


@pytest.mark.parametrize(
    ("whole", "part"),
    [("viscoelastic", "stiffness_error"), ("attached_oscillator", "mass_error")],
)
def test_what_has_another_sign_is_not_contained(searched, whole, part):
    problem, scope = searched
    large, small = begun(searched, whole), begun(searched, part)
    less = small.fitted.theta.copy()
    less[:, 4] = -1.0
    solution = replace(small.fitted.solution, values=less)
    less = replace(small, fitted=replace(small.fitted, solution=solution))
    assert widened(large, small, scope, problem)
    assert not widened(large, less, scope, problem)


def test_what_is_at_another_place_or_is_no_limit_is_not_contained(searched):
    problem, _ = searched
    hypotheses = {
        name: begun(searched, name).fitted.hypothesis
        for name in ("stiffness_error", "viscoelastic", "gap_contact", "sensor_polarity")
    }
    spring, maxwell, gap, turned = hypotheses.values()
    assert holding(maxwell, spring)
    assert holding(maxwell, replace(spring, where=("elsewhere",))) is None
    assert holding(spring, maxwell) is None
    assert holding(gap, maxwell) is None
    # The wrong sign has no size, and so is never none at all.
    assert holding(turned, problem.nothing()) is None


def worse(base: RankedFit, entries: list[RankedFit]) -> list[str]:
    """Entries that cost more than one that they contain, and which."""
    once = 1.0 + tolerance_of(base.problem, base.fitted.time_constant)
    return [
        f"{e.fitted.hypothesis.label} > {o.fitted.hypothesis.label}"
        for e in entries
        for o in (base, *entries)
        if e is not o
        and e.fitted.time_constant == o.fitted.time_constant == base.fitted.time_constant
        and holding(e.fitted.hypothesis, o.fitted.hypothesis) is not None
        and e.fitted.cost > once * o.fitted.cost
    ]


@pytest.mark.parametrize(
    ("missing", "c", "whole"),
    [
        pytest.param(0.0, 400.0, "viscoelastic@J1", id="a damper in a Maxwell element"),
        pytest.param(
            8e3, 2.5, "coulomb_friction@J1", id="a spring in a slider", marks=pytest.mark.long
        ),
    ],
)
def test_after_a_competition_nothing_fits_worse_than_what_it_contains(
    monkeypatch, missing, c, whole
):
    """What contains the truth was given up where a search of it had led, 100 times worse."""
    response = struck(lambda d: missing * d, c=c)
    problem, scope = searching(response, replace(JOINT, F_S=1e7), NAMES)
    seen = []

    def before(base, entries, scope):
        seen.extend(entries)
        return none_worse(base, entries, scope)

    monkeypatch.setattr(selection, "none_worse", before)
    nominal = nominal_fit(problem, scope, 0)
    scope, screen = screened(problem, nominal, scope)
    screen = with_first_fits(problem, nominal, screen, scope)
    table = selection.run(problem, nominal, screen, scope, 0)
    plain = frozenset([(*whole.split("@"), "")])
    (given_up,) = (e.fitted for e in seen if e.fitted.hypothesis.variant == plain)
    (found,) = (e.fitted for e in table.entries if e.fitted.hypothesis.variant == plain)
    assert given_up.cost > 100.0 * found.cost
    assert found.time_constant == TIME_CONSTANT
    assert table.detected
    assert not worse(table.nominal, list(table.entries))


def test_a_pair_starts_from_the_better_of_the_two(searched):
    """And a single suspect from nothing."""
    problem, scope = searched
    nothing, spring, pair = (
        replace(each, fitted=multistart(problem, [each.fitted.start], TIME_CONSTANT, steps)[0])
        for each, steps in (
            (begun(searched), STEPS),
            (begun(searched, "stiffness_error"), STEPS),
            (begun(searched, "viscous_damping", "stiffness_error"), 0),
        )
    )
    damper = begun(searched, "viscous_damping")
    damper = replace(damper, fitted=multistart(problem, [damper.fitted.start], TIME_CONSTANT, 0)[0])
    assert worse(nothing, [damper, spring, pair])
    found = none_worse(nothing, [pair, spring, damper], scope)
    assert len(found) == 3
    assert not worse(nothing, found)
    # What was no worse stays what it was.
    assert any(each.fitted is spring.fitted for each in found)


def test_a_spring_that_is_not_tried_is_named_where_friction_becomes_it():
    """Friction that never slips, or whose spring in K always does, would be no friction."""
    found = diagnosed(lambda: lambda d, v, moved: -9e3 * d, ("coulomb_friction",))
    assert found.what[0].label == "stiffness_error@m1-m2"
    (size,) = found.what[0].parameters
    assert size.value == pytest.approx(-9e3, rel=0.02)
    assert any("is not among the hypotheses" in line for line in found.warnings)
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
