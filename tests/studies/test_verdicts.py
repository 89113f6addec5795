"""What diagnosis.json says of several diagnoses together."""

import math
from dataclasses import replace

import numpy as np
import pytest

from iwanjax.discrepancy import CATALOGUE, CurveRun, Diagnosis, LoopRun, Suspect
from iwanjax.discrepancy.findings import (
    Errors,
    ForceNoise,
    MeasuredNoise,
    PlaceEvidence,
    Refitted,
    UnnamedForce,
)
from iwanjax.discrepancy.judgement import Misfit, beside_general_law, judged
from iwanjax.effects.kinds import UnnamedKind
from iwanjax.joints import UnnamedLaw
from iwanjax.studies.verdicts import as_json

NOTHING = judged(0.0, [-20.0], Misfit(1.0, 1.0))
SOMETHING = judged(-50.0, [0.0], Misfit(9.0, 9.0), Misfit(1.0, 1.0))


def run(kind):
    if kind is LoopRun:
        return LoopRun((), (), 0, ())
    return CurveRun((), (), 0, 10.0, (1.0, 1.0))


def diagnosis(name, verdict, before, kind=CurveRun):
    """One of a mode or a joint of this name, with errors that are easily added as squares."""
    cubic = CATALOGUE["cubic_stiffness"][0]
    what = [Suspect(cubic, name, p, 0.0, ()) for p in verdict.named] if verdict.found else []
    errors = Errors(before, 2.0 * before)
    return Diagnosis(
        verdict=verdict,
        what=tuple(what),
        before=errors,
        after=errors,
        noise_floor=errors,
        noise_floor_95=errors,
        parameter_spread=Errors(math.nan, math.nan),
        refused=(),
        indistinguishable=(),
        observables=(),
        scores=(),
        joints=(Refitted(name, ()),),
        runs=(run(kind), run(kind)),
        sampling_rate=math.nan,
        restoring=None,
        warnings=(f"of {name}",),
        complete=True,
        seconds=2.0,
        noise=(MeasuredNoise(name, "a", 0.3, 0.1, "one step ahead", 0.2, 0.9),),
    )


def test_one_is_said_as_it_is():
    said = as_json({"m1": diagnosis("m1", SOMETHING, 3.0)})
    assert (said["verdict"], said["what"][0]["where"]) == ("something_missing", "m1")
    assert said["fit"]["before"] == {"fit": 3.0, "hold_out": 6.0}
    assert "modes" not in said


def test_an_undecided_verdict_names_the_place():
    """Where something acts is known before what does; below one half it is not said."""
    unknown = judged(-100.0, [-20.0], Misfit(50.0, 40.0))
    assert (unknown.name, unknown.detected) == ("undecided", True)
    places = (PlaceEvidence("m3-m4", 0.97, 0.9, 16, 60.0), PlaceEvidence("m2", 0.03, 0.5, 16, 40.0))
    made = replace(diagnosis("m1", unknown, 0.3), places=places, what=())
    acts = "something acts between m3 and m4 (probability 0.97), and nothing that was tried"
    assert acts in made.statement()
    assert as_json({"m1": made})["places"][0] == places[0]._asdict()
    vague = replace(made, places=(places[0]._replace(probability=0.4), places[1]))
    assert "something is missing, and nothing that was tried" in vague.statement()


def test_names_at_two_places_are_told_beside_the_one_law_that_does_as_well():
    right = Misfit(1.0, 1.0)
    verdict = judged(-50.0, [0.0], Misfit(9.0, 9.0), right)
    verdict = beside_general_law(verdict, right, right, elsewhere=1.0)
    shape = np.zeros((2, 3))
    law = UnnamedForce("m1", UnnamedLaw.blank(1.0, 1.0, 1.0), "elastic", {}, 2.0, shape, shape, [])
    damper, spring = (CATALOGUE[kind][0] for kind in ("viscous_damping", "stiffness_error"))
    labels = "viscous_damping@m1", "stiffness_error@m2-m3"
    what = (
        Suspect(UnnamedKind(), "m1", 0.97, 0.0, ()),
        Suspect(damper, "m1", verdict.named[0], -0.7, (), labels[1:]),
        Suspect(spring, "m2-m3", verdict.named[0], -0.7, (), labels[:1]),
    )
    made = replace(diagnosis("m1", verdict, 0.3), what=what, unnamed=law)
    said = made.statement()
    assert "Or it is a viscous damper at m1 and a linear spring between m2 and m3 (prob" in said
    assert said.count("(probability 0.50)") == 1
    assert "No name comes near" not in said


@pytest.mark.parametrize(
    ("behind", "words"),
    [
        (0.5, "These data cannot tell stiffness_error@m1 from iwan_joint@m1"),
        (6.7, "Nothing here speaks against iwan_joint@m1 either, with more parameters"),
    ],
)
def test_a_rival_that_holds_what_is_named_is_no_less_likely_than_it_says(behind, words):
    """Evidence is for what has fewer parameters, whatever else does as well."""
    verdict = judged(-50.0, [0.0, -behind], Misfit(9.0, 9.0), Misfit(1.0, 1.0))
    what = [
        Suspect(CATALOGUE[kind][0], "m1", p, -each, ())
        for kind, p, each in zip(
            ("stiffness_error", "iwan_joint"), verdict.named, (0.0, behind), strict=True
        )
    ]
    pairs = (("stiffness_error@m1", "iwan_joint@m1"),)
    said = replace(diagnosis("m1", verdict, 3.0), what=tuple(what), indistinguishable=pairs)
    assert words in said.statement()


def test_several_are_one_verdict_with_each_beside_it():
    parts = {"m1": diagnosis("m1", NOTHING, 3.0), "m2": diagnosis("m2", SOMETHING, 4.0)}
    said = as_json(parts)
    assert (said["verdict"], said["detected"]) == ("something_missing", True)
    assert said["probability_nothing_missing"] == pytest.approx(NOTHING.nothing * SOMETHING.nothing)
    assert [each["where"] for each in said["what"]] == ["m2"]
    # Root mean square of 3 and 4.
    assert said["fit"]["before"]["fit"] == pytest.approx(math.sqrt(12.5))
    assert said["fit"]["before"]["hold_out"] == pytest.approx(2.0 * math.sqrt(12.5))
    assert said["warnings"] == ["of m1", "of m2"]
    assert said["noise"] == [
        {
            "recording": name,
            "sensor": "a",
            "deviation": 0.3,
            "std": 0.1,
            "source": "one step ahead",
            "lower": 0.2,
            "upper": 0.9,
        }
        for name in ("m1", "m2")
    ]
    assert (list(said["joints"]), said["seconds"]) == (["m1", "m2"], 4.0)
    assert said["modes"] == {name: as_json({name: part}) for name, part in parts.items()}


def test_floors_are_lower_bounds_where_noise_may_be_more():
    sure = MeasuredNoise("r", "a", 0.3, 0.1, "before the force", 0.3, 0.3)
    bound = sure._replace(source="in quiet bands", upper=0.4)
    known, unknown = ForceNoise("r", "f", 0.1, "between periods"), ForceNoise("r", "f", None, "")
    part = diagnosis("m1", NOTHING, 1.0)
    for noise, force, lower in (
        (sure, known, False),
        (bound, known, True),
        (sure, unknown, True),
    ):
        said = as_json({"m1": replace(part, noise=(noise,), force_noise=(force,))})
        assert said["noise_floor_is_lower_bound"] == lower
        assert said["force_noise"] == [force._asdict()]


def test_nothing_is_missing_where_it_is_from_no_part():
    parts = {name: diagnosis(name, NOTHING, 1.0, LoopRun) for name in ("J1", "J2")}
    said = as_json(parts)
    assert (said["verdict"], said["detected"], said["what"]) == ("nothing_missing", False, [])
    assert set(said["parts"]) == {"J1", "J2"}
    parts["J2"] = replace(parts["J2"], complete=False)
    assert not as_json(parts)["complete"]
