"""Recordings that no fit has seen, predicted: limits, coverage, modes, parts, refusals."""

import numpy as np
import pytest
from known_fit import INPUTS, RATE, N, chain, hit, known_fit, study
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.studies import Measurement
from iwanjax.studies.measured import modes_apart
from iwanjax.studies.predicted import Comparison, PredictedRecording, Windows, compared, covered

OPEN = {"J1.K_T": 0.01, "J1.chi": 0.1, "mode0.zeta_0": 0.2, "mode1.zeta_0": 0.1}
NOISE = 0.05


@pytest.fixture(scope="module")
def hits():
    """One to fit, of whose curves only the modes' names and bands count, and one held out."""
    fitted = hit(chain(), 40.0, NOISE, 0, "m3")
    return study([fitted, Measurement(hit(chain(), 60.0, NOISE, 1), use="hold_out")])


@pytest.fixture(scope="module")
def modes(hits):
    return tuple(hits.curves().values())


@pytest.fixture(scope="module")
def of_known(modes):
    """The hit, the same from 0.1 s on, and a jerk of the ground, by a model that is known."""
    whole = hit(chain(), 60.0, NOISE, 1)
    held_out = [
        Measurement(whole, use="hold_out"),
        Measurement(whole, use="hold_out", start=0.1, name="part"),
        Measurement(hit(chain(), 60.0, NOISE, 2, "base"), use="hold_out"),
    ]
    found = study(held_out).predict(known_fit({}, modes), draws=2)
    assert list(found) == ["hit1", "part", "hit2"]
    return found


@pytest.fixture(scope="module")
def exact(of_known):
    return of_known["hit1"]


def noise_alone(found):
    return NOISE / np.sqrt(np.mean(found.response.measured**2, axis=0))


@pytest.fixture(scope="module")
def open_fit(hits, modes):
    return hits.predict(known_fit(OPEN, modes), draws=30).only


def test_a_known_model_predicts_to_the_noise(exact):
    assert_allclose(exact.response.error, noise_alone(exact), rtol=0.1)
    # By some 40 samples before the hit.
    assert_allclose(exact.floor, noise_alone(exact), rtol=0.3)
    assert_allclose(exact.covered, 0.9, atol=0.1)
    assert exact.response.measured.shape == (N, 3)
    assert exact.time.shape == (N,)


def test_without_uncertainty_bands_have_no_width(exact):
    for each in (exact.response, exact.amplitude, exact.modes[0].component):
        assert_allclose(each.lower, each.predicted, rtol=1e-9, atol=1e-12)
        assert_allclose(each.upper, each.predicted, rtol=1e-9, atol=1e-12)
    assert_allclose(exact.spread, 0.0, atol=1e-12)


def test_modes_are_told_apart_alike_and_followed_against_amplitude(exact):
    (mode,) = exact.modes
    # Three sensors know all three modes: the filter adds nothing to the noise.
    assert mode.leakage < 1e-9
    assert mode.filtered_error == pytest.approx(float(mode.component.error), rel=1e-6)
    assert mode.component.error < 0.02
    curves = mode.curves
    assert curves is not None
    seen = np.isfinite(curves.frequency.predicted)
    assert np.count_nonzero(seen) >= 2
    off = (curves.frequency.predicted - curves.frequency.measured)[seen]
    assert np.all(np.abs(off) < 5.0 * curves.frequency_std[seen])
    assert curves.frequency_error < 0.05
    assert curves.damping_error < 5.0


def test_open_parameters_make_a_band_about_the_prediction(open_fit, exact):
    inside = (open_fit.response.lower <= open_fit.response.upper).all()
    assert inside
    assert np.all(open_fit.spread > 3.0 * open_fit.floor)
    assert_allclose(open_fit.response.predicted, exact.response.predicted)
    width = open_fit.modes[0].curves.frequency
    # The stiffness moves the mode's frequency, and its damping the other band.
    assert np.nanmedian(width.upper - width.lower) > 0.05


def test_it_is_a_result_like_others(open_fit, tmp_path):
    told = open_fit.summary()
    for word in ("hit1: acceleration of 3 sensor(s)", "30 draws", "noise alone", "mode at a3"):
        assert word in told
    assert "<table" in open_fit._repr_html_()
    again = PredictedRecording.load(open_fit.save(tmp_path / "prediction.npz"))
    assert again.summary() == told
    assert_allclose(again.response.upper, open_fit.response.upper)
    figure = open_fit.plot()
    assert len(figure.axes) == 2 + 3
    assert figure.axes[0].get_ylabel() == "Acceleration a3 (m/s^2)"


@pytest.mark.computes
def test_bands_hold_as_many_samples_as_they_say():
    fit = known_fit(OPEN)
    truths = fit.only.solution.draws(8, seed=7)
    names = [p.name for p in fit.only.solution.parameters]
    recordings = []
    for i, theta in enumerate(truths):
        truth = fit.only.solution.problem.model(theta)
        recordings.append(Measurement(hit(truth, 60.0, NOISE, i), use="hold_out"))
    found = study(recordings).predict(fit, draws=60, probability=0.8)
    shares = np.stack([each.covered for each in found.values()])
    assert names[-2:] == ["mode0.zeta_0", "mode1.zeta_0"]
    assert abs(shares.mean() - 0.8) < 0.1
    # A wrong noise would not do.
    assert shares.std() < 0.3


def test_a_part_is_compared_and_what_went_before_still_drives(of_known):
    found = of_known["part"]
    assert found.time[0] == pytest.approx(0.1, abs=1.5 / RATE)
    assert found.response.measured.shape == (found.time.size, 3)
    assert_allclose(found.response.error, noise_alone(found), rtol=0.1)


def test_accelerometers_on_moving_ground_are_absolute(of_known):
    shaken = of_known["hit2"]
    assert_allclose(shaken.response.error, noise_alone(shaken), rtol=0.15)


def test_draws_have_the_covariance_and_keep_what_is_fixed():
    solution = known_fit(OPEN).only.solution
    draws = solution.draws(4000)
    spread = dict(zip((p.name for p in solution.parameters), draws.T, strict=True))
    for name, relative in OPEN.items():
        value = solution.values[name]
        logarithm = np.log(spread[name] / value)
        assert np.std(logarithm) == pytest.approx(relative, rel=0.06)
        assert abs(np.mean(spread[name]) / value - 1.0) < 0.1 * relative + relative**2
    assert np.all(spread["J1.F_S"] == solution.values["J1.F_S"])


def test_samples_that_noise_and_draws_explain_are_covered():
    random = np.random.default_rng(0)
    drawn = random.standard_normal((300, 2000, 1))
    measured = random.standard_normal((2000, 1)) + 0.5 * random.standard_normal((2000, 1))
    assert covered(measured, drawn, np.array([0.5]), 0.9)[0] == pytest.approx(0.9, abs=0.03)
    assert covered(measured, drawn, np.array([0.0]), 0.9)[0] < 0.87
    assert covered(measured, 0.0 * drawn, np.array([0.5]), 0.9)[0] < 0.6


def test_the_amplitude_of_a_sine_is_its_own_less_the_noise():
    t = np.arange(4000) / 1000.0
    sine = 3.0 * np.sin(2.0 * np.pi * 20.0 * t)[:, None]
    noise = np.array([0.5])
    noisy = sine + noise * np.random.default_rng(0).standard_normal(sine.shape)
    windows = Windows.of(t, 20.0)
    _, amplitude = windows.compared(noisy, sine, sine[None], noise, 0.9)
    assert windows.length == 50
    assert_allclose(amplitude.predicted, 3.0, rtol=1e-9)
    assert np.nanmean(amplitude.measured) == pytest.approx(3.0, rel=0.01)
    _, hidden = windows.compared(0.1 * noisy, sine, sine[None], noise, 0.9)
    assert np.all(np.isnan(hidden.measured))


def test_errors_are_relative_and_skip_what_is_not_known():
    measured, predicted = np.array([3.0, 4.0, np.nan]), np.array([3.3, 4.4, 9.0])
    found = compared(measured, predicted, predicted[None], 0.9)
    assert found.error == pytest.approx(0.1)
    assert_allclose(found.relative[:2], 0.1)
    assert isinstance(found, Comparison)


MODE = {"name": "mode1", "band": (90, 150), "joint": {"type": "iwan4"}}


def test_what_cannot_be_predicted_is_refused_before_anything_is_fitted(hits):
    first = hit(chain(), 40.0, NOISE, 0)
    decay = ij.as_recording(first.response[:, 0], sampling_rate=RATE, quantity="velocity")
    held_out = Measurement(decay, use="hold_out")
    with pytest.raises(InputError, match="predict needs a structure"):
        ij.Study(recordings=[decay, held_out], modal=[MODE]).predict()
    with pytest.raises(InputError, match="say use: hold_out of one of kind transient"):
        study([first]).predict()
    with pytest.raises(InputError, match="draws = 0"):
        hits.predict(draws=0)
    with pytest.raises(InputError, match=r"hit1: responses of 30000 draws take 1\.\d GB"):
        hits.predict(known_fit({}), draws=30000)


def test_what_else_is_held_out_is_told(hits):
    free = ij.as_recording(
        hit(chain(), 40.0, NOISE, 0).response, sampling_rate=RATE, quantity="acceleration",
        sensors=["a1", "a2", "a3"], name="free",
    )  # fmt: skip
    lines = []
    with pytest.raises(InputError, match="use: hold_out"):
        study([Measurement(free, use="hold_out")]).predict(progress=lines.append)
    assert lines == ["free is left out: free_decay has no force to drive the model by"]


def test_a_recording_that_begins_in_motion_is_refused():
    whole = hit(chain(), 60.0, NOISE, 1)
    cut = ij.as_recording(
        whole.response[200:], sampling_rate=RATE, quantity="acceleration",
        sensors=["a1", "a2", "a3"], force=whole.force[100:-100], inputs=list(INPUTS), name="cut",
    )  # fmt: skip
    for said in (None, "unknown", "periodic"):
        held_out = Measurement(cut, use="hold_out", initial=said)
        with pytest.raises(InputError, match="cut: does not begin at rest"):
            study([held_out]).predict(known_fit({}), draws=1)


def test_a_filter_of_few_sensors_passes_over_modes_that_they_do_not_see():
    shapes = np.array([[1.0, 0.0, 0.5, 0.3], [0.2, 0.0, -1.0, 0.4]])
    assert modes_apart(shapes, 0) == modes_apart(shapes, 2) == [0, 2]
    assert modes_apart(shapes, 3) == [2, 3]
    # The wanted one is kept, whose filter then says what is wrong.
    assert modes_apart(shapes, 1) == [0, 1]
