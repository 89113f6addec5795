"""Tuned numbers of time histories reach what they are of."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from struck_mass import N, resolution

from iwanjax.discrepancy.histories import ranking
from iwanjax.discrepancy.histories.time_steps import StudyData
from iwanjax.identification.joint_priors import of_logarithm
from iwanjax.identification.recordings import (
    StudyRecording,
    before_force,
    cleaned,
    common_noise,
    noise_of,
)
from iwanjax.joints import Iwan4
from iwanjax.settings.conditioning import CONDITIONING
from iwanjax.settings.histories import HISTORIES

RESPONSE = np.random.default_rng(1).standard_normal((N, 1))


def test_recordings_are_weighed_by_the_model_error_that_is_asked_for():
    usual = resolution(RESPONSE)
    doubtful = replace(CONDITIONING, model_error=0.1)
    one, other = (
        np.max(np.asarray(StudyData.of(*each).fitted.data.weight))
        for each in (
            (usual.recordings, *usual.made(2), np.zeros(1), settings)
            for settings in (CONDITIONING, doubtful)
        )
    )
    # Without noise a residual's deviation is the model's own error.
    assert one / other == pytest.approx(0.1 / CONDITIONING.model_error, rel=1e-6)


def test_more_spoilt_samples_leave_fewer_before_a_force():
    for spoilt in (4, 8):
        settings = replace(CONDITIONING, spoilt=spoilt)
        assert len(before_force(RESPONSE, 100, settings)) == 100 - 2 * spoilt


def test_noise_is_measured_before_a_force_where_that_is_long_enough():
    few = replace(CONDITIONING, enough=1000)
    force = np.zeros((N, 1))
    force[100:110] = 1.0
    struck = StudyRecording("rec", RESPONSE, force)
    before = np.std(before_force(RESPONSE, 100), axis=0, ddof=1)
    assert noise_of(struck).deviation == pytest.approx(before)
    assert noise_of(struck).source == ("before the force",)
    assert noise_of(struck, few).source == ("over the whole band",)
    recordings = [StudyRecording(name, RESPONSE, force) for name in "ab"]
    assert np.isfinite(common_noise(recordings).deviation).all()
    assert np.isnan(common_noise(recordings, few).deviation).all()


def test_a_pulse_reaches_as_many_samples_farther_as_are_asked_for():
    force = np.zeros((N, 1))
    force[100:110] = 1.0
    assert cleaned(force, 5).last - cleaned(force).last == 5 - CONDITIONING.beside


def test_what_drifts_has_the_deviation_of_its_prior():
    known = {info.name: of_logarithm(info) for info in Iwan4.parameters if info.transform == "log"}
    assert known["F_S"] == 0.5
    assert known["K_T"] == 0.1
    assert math.isfinite(sum(known.values()))


@pytest.mark.parametrize(
    ("time_constant", "steps", "tolerance"),
    [(8.0, 12, 1e-3), (40.0, 15, 1e-4), (math.inf, 15, 1e-4)],
)
def test_a_polish_has_more_steps_and_a_finer_end_and_is_given_up_later_than_a_search(
    monkeypatch, time_constant, steps, tolerance
):
    asked = []

    def searched(problem, starts, *arguments, **options):
        asked.append((*arguments, options["tolerance"], options["give_up"]))
        return []

    monkeypatch.setattr(ranking, "multistart", searched)
    problem, scope = SimpleNamespace(settings=HISTORIES), SimpleNamespace(in_time=None)
    ranking.refitted(problem, [], time_constant, 1.0, scope)  # type: ignore[arg-type]
    ranking.refitted(problem, [], time_constant, 1.0, scope, 1.5)  # type: ignore[arg-type]
    assert asked == [(time_constant, steps, tolerance, give_up) for give_up in (30.0, 1.5)]
    assert HISTORIES.selection.give_up == 10.0
