"""A law of several parameters that no screening saw begins as the general law's force."""

from dataclasses import replace

import numpy as np
from linear_pair import ROWS, measured_force, problem, simulated, stiffness_with_joint

from iwanjax.discrepancy.histories.general_law import PlacedLaw
from iwanjax.discrepancy.histories.pairs import as_one_law
from iwanjax.discrepancy.histories.ranking import Scope
from iwanjax.effects.catalogue import kinds_in_time
from iwanjax.effects.kinds import UnnamedKind
from iwanjax.identification.hypotheses import LawStart
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.multistart import multistart
from iwanjax.identification.problem import Start
from iwanjax.identification.unnamed_law import blank_at, fit_unnamed_law

NOISE = np.array([0.03, 0.02])
MORE = 4e3
HITS = ((60.0, 0), (25.0, 1))


def test_what_makes_the_same_force_is_refitted_at_its_place():
    """Two masses lack a spring; one of hyperbolic tangent becomes it."""
    random, row = np.random.default_rng(5), np.outer(ROWS["m2"], ROWS["m2"])
    stiffness = stiffness_with_joint() + MORE * row
    clean = [simulated(peak, struck=at, stiffness=stiffness) for peak, at in HITS]
    seen = [y + NOISE * random.standard_normal(y.shape) for y in clean]
    made, places = problem(seen, [measured_force(*hit) for hit in HITS], NOISE)
    (place,) = (each for each in places if each.label == "m2")
    blank, z = blank_at(place), np.zeros(made.parameters)
    strengths = np.zeros(len(blank.strengths))
    strengths[0] = MORE * place.scales.deflection
    begun = [LawStart(blank.with_strengths(strengths), z)]
    fit = fit_unnamed_law(made, UnnamedKind(), place, begun, (2.0,), 0)
    (nominal,) = multistart(made, [Start(made.nothing(), made.map.given(z))], 2.0, 0)
    assert nominal.cost > 10.0 * left_by_noise(made)

    told = []
    kinds = kinds_in_time(("tanh_spring", "viscous_damping"))
    scope = Scope(kinds, places, (), (), lambda: True, told.append)
    placed = PlacedLaw(fit, 1.0, False, frozenset(["m2"]))
    (entry,) = as_one_law(made, nominal, [], [], placed, scope)
    assert entry.fitted.hypothesis.label == "tanh_spring@m2"
    assert entry.fitted.cost < 1.1 * left_by_noise(made)
    assert told == ["refitting tanh_spring@m2 as the general law shows it"]
    late = replace(scope, in_time=lambda: False)
    assert as_one_law(made, nominal, [], [entry], placed, late) == [entry]
