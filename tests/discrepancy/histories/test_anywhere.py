"""What is linear is tried at every place, from joints as given as well as bent."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_pair import ROWS, measured_force, problem, simulated, stiffness_with_joint

from iwanjax.discrepancy.histories.further_suspects import anywhere
from iwanjax.discrepancy.histories.ranking import STEPS, TIME_CONSTANT, RankedFit, Scope
from iwanjax.discrepancy.histories.restarts import linear_laws
from iwanjax.effects.catalogue import kinds_in_time
from iwanjax.identification.hypotheses import force
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, multistart
from iwanjax.identification.problem import Start

NOISE = np.array([0.3, 0.2])
# A fifth of what holds its mass.
STRONG = 3e4
HITS = ((60.0, 0), (25.0, 1))
NAMES = ("stiffness_error", "cubic_stiffness")


@pytest.fixture(scope="module")
def lacking():
    """Two masses that lack a strong spring at the first, their joint refitted without it."""
    random, row = np.random.default_rng(6), np.outer(ROWS["m1"], ROWS["m1"])
    clean = [
        simulated(peak, struck=at, stiffness=stiffness_with_joint() + STRONG * row)
        for peak, at in HITS
    ]
    seen = [y + NOISE * random.standard_normal(y.shape) for y in clean]
    made, places = problem(seen, [measured_force(*hit) for hit in HITS], NOISE, names=NAMES)
    start = Start(made.nothing(), made.map.given(np.zeros(made.parameters)))
    (nominal,) = multistart(made, [start], TIME_CONSTANT, STEPS)
    return made, places, nominal


def leaving(lacking, left):
    """The nominal model as if it left so many times the noise."""
    made, _, nominal = lacking
    return SimpleNamespace(theta=nominal.theta, cost=left * left_by_noise(made))


def elsewhere(lacking, name):
    """The same suspect where nothing acts, with a short memory and a longer one."""
    made, places, nominal = lacking
    (kind,) = (each for each in made.predictor.kinds if each.name == name)
    (place,) = (each for each in places if each.label == "m2")
    z = nominal.theta.mean(axis=0)[: made.parameters]
    size = 0.01 * place.scales.stiffness
    start = force(made, kind, place.label, place.row, z, size, 1.0)
    for memory in (SHORT_TIME_CONSTANT, TIME_CONSTANT):
        (fit,) = multistart(made, [start], memory, 2)
        yield RankedFit(made, fit)


def test_a_strong_spring_is_found_where_it_is_when_another_place_led(lacking):
    made, places, _ = lacking
    shorts, entries = ([each] for each in elsewhere(lacking, "stiffness_error"))
    assert entries[0].fitted.cost > 10.0 * left_by_noise(made)
    told = []
    scope = Scope(kinds_in_time(NAMES), places, (), (), lambda: True, told.append)
    bent = leaving(lacking, 2.0)
    first, *_ = anywhere(made, bent, shorts, entries, scope)
    assert first.fitted.hypothesis.label == "stiffness_error@m1"
    assert first.fitted.time_constant == TIME_CONSTANT
    assert first.fitted.cost < 1.1 * left_by_noise(made)
    size, *_ = first.fitted.hypothesis.physical(first.fitted.theta.mean(axis=0), made.map, 0)
    assert size == pytest.approx(STRONG, rel=1e-2)
    assert told == ["linear errors at every place"]
    late = replace(scope, in_time=lambda: False)
    assert anywhere(made, bent, shorts, entries, late) is entries
    # Joints that do not do most of it have been looked at as given.
    assert anywhere(made, leaving(lacking, 4.0), shorts, entries, scope) is entries


def test_columns_tell_where_what_depends_on_the_amplitude_acts(lacking):
    made, places, _ = lacking
    shorts, entries = ([each] for each in elsewhere(lacking, "cubic_stiffness"))
    scope = Scope(kinds_in_time(NAMES), places, (), (), lambda: True, lambda line: None)
    assert anywhere(made, leaving(lacking, 2.0), shorts, entries, scope) is entries


def test_linear_laws_leave_nothing_where_the_spring_is(lacking):
    made, places, nominal = lacking
    scope = Scope((), places, (), (), lambda: True, lambda line: None)
    (there, *others) = sorted(
        linear_laws(made, nominal, places, scope), key=lambda each: each.fitted.cost
    )
    assert there.place.label == "m1"
    assert there.fitted.cost < 1.1 * left_by_noise(made, SHORT_TIME_CONSTANT)
    assert all(each.fitted.cost > 1.5 * there.fitted.cost for each in others)
    late = replace(scope, in_time=lambda: False)
    assert linear_laws(made, nominal, places, late, [there]) == [there]
