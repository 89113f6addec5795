"""Verdicts in the words of the field."""

import math

import pytest

from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.estimate import Estimate
from iwanjax.effects.kinds import ForceKind
from iwanjax.effects.wording import noun, sentence, share, sizes
from iwanjax.joints import Dashpot, ParameterInfo


@pytest.mark.parametrize(
    ("name", "where", "said"),
    [
        ("cubic_stiffness", "m5-m6", "A cubic spring is missing between m5 and m6"),
        ("gap_contact", "m1-ground", "A gap is missing between m1 and ground"),
        ("iwan_joint", "opening3", "A joint is missing at opening3"),
        ("sensor_delay", "a1", "Sensor a1 is late"),
        ("force_gain", "m1", "The force at m1 has a wrong gain"),
        ("tanh_spring", "m1-m2", "A softening spring is missing between m1 and m2"),
        ("joint_drift", "J1", "Joint J1 changes from recording to recording"),
    ],
)
def test_a_verdict_is_a_plain_sentence(name, where, said):
    assert sentence(CATALOGUE[name][0], where) == said


def test_every_kind_has_words_of_its_own():
    said = {noun(kinds[0], "x") for kinds in CATALOGUE.values()}
    assert len(said) == len(CATALOGUE)
    own = ForceKind("own", "magnetic drag", Dashpot)
    assert sentence(own, "m1-m2") == "Magnetic drag is missing between m1 and m2"


@pytest.mark.parametrize(
    ("error", "said"),
    [(0.031, "3.1 %"), (1.05, "105 %"), (28559.0, "2.86e+04 times the signal")],
)
def test_errors_are_told_as_shares_of_what_was_measured(error, said):
    assert share(error) == said


def test_a_deviation_that_is_not_known_is_left_out():
    info = ParameterInfo("k3", "force/length^3", "cubic stiffness")
    assert sizes([Estimate(info, 2.5e12, 1e10)]) == "k3 = 2.5e+12 ± 1e+10 force/length^3"
    assert sizes([Estimate(info, 2.5e12, math.nan)]) == "k3 = 2.5e+12 force/length^3"
    assert "nan" not in share(math.inf) + share(math.nan)
