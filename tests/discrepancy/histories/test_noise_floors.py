"""What noise of known size leaves of recordings: estimates, weights and floors, within their own
confidence."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from linear_pair import (
    QUANTITIES,
    RATE,
    C,
    M,
    N,
    hit,
    measured_force,
    model,
    simulated,
    stiffness_with_joint,
)

from iwanjax.discrepancy.histories.validation import FreeRun, free_run
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.conditioning import ConditionedRecordings, conditioned
from iwanjax.identification.multistart import multistart
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.identification.recordings import StudyRecording, cleaned, noise_of
from iwanjax.settings.conditioning import CONDITIONING
from iwanjax.signals.comparison_band import CORRELATION, END, HALF, OF_NOISE, in_band, over_pairs
from iwanjax.signals.noise import NoiseLevel
from iwanjax.signals.sensor_noise import SensorNoise

AT, PEAK, SHARE = 0.1, 60.0, 0.02
BEFORE = round(AT * RATE) - 28
"""Samples that nothing moves in: before the bell's first thousandth, less what filters spoil."""


def three_deviations(values: np.ndarray, expected: float) -> None:
    """Whether a mean is what it should be, by the scatter of the values themselves."""
    assert np.mean(values) == pytest.approx(expected, abs=3.0 * np.std(values) / len(values) ** 0.5)


def rested(wave: np.ndarray, first: int) -> StudyRecording:
    """At rest before a blow, and some more of the same after it."""
    force = np.zeros((first + 60, 1))
    force[first : first + 10] = 1.0
    return StudyRecording("rec", np.vstack([wave, wave[-1] * np.ones((60, 1))]), force)


def moving(wave: np.ndarray, force: np.ndarray | None = None) -> StudyRecording:
    """In motion all along."""
    return StudyRecording("rec", wave, force, initial="unknown")


@pytest.mark.parametrize("before", [40, 200])
def test_noise_before_a_hit_is_unbiased_and_as_sure_as_its_samples(before):
    random = np.random.default_rng(0)
    waves = 0.3 * random.standard_normal((400, before + 16, 1))
    found = np.array([noise_of(rested(wave, before + 16)).deviation[0] for wave in waves])
    assert noise_of(rested(waves[0], before + 16)).freedom == before - 1
    three_deviations(found**2, 0.09)
    assert np.std(found) == pytest.approx(0.3 / math.sqrt(2.0 * before), rel=0.15)


def test_noise_of_a_decay_is_told_beside_its_modes():
    """Three modes, the last at a third of the rate: what third differences took for noise."""
    random, t = np.random.default_rng(1), np.arange(4000)
    modes = ((0.01, 100.0), (0.07, 50.0), (0.33, 30.0))
    each = [a * np.exp(-2e-3 * t) * np.sin(2.0 * np.pi * f * t + 1.0) for f, a in modes]
    decay = np.sum(each, axis=0)
    waves = decay[:, None] + 0.3 * random.standard_normal((60, 4000, 1))
    found = [noise_of(moving(wave)) for wave in waves]
    # Bands that hold no mode; by chance one or two that lie beside one.
    assert np.mean([each.deviation for each in found]) == pytest.approx(0.3, rel=0.03)
    expected = 0.3 / math.sqrt(2.0 * np.median([each.freedom for each in found]))
    assert np.std([each.deviation for each in found]) == pytest.approx(expected, rel=0.3)


def test_noise_of_a_sensor_that_is_never_at_rest_is_where_the_structure_is_quiet():
    random, t = np.random.default_rng(2), np.arange(8192)
    motion = 50.0 * np.sum([np.sin(2.0 * np.pi * f * t) for f in (0.031, 0.092)], axis=0)
    waves = 0.3 * random.standard_normal((40, 8192, 1))
    found = np.array([noise_of(moving(motion[:, None] + w)).deviation[0] for w in waves])
    assert np.mean(found) == pytest.approx(0.3, rel=0.02)
    # Without the motion it is the same: nothing of it was taken for noise.
    still = np.array([noise_of(moving(w)).deviation[0] for w in waves])
    assert np.mean(found) == pytest.approx(np.mean(still), rel=0.02)


@pytest.mark.parametrize("quantity", ["acceleration", "displacement"])
def test_what_a_random_force_makes_of_a_structure_is_no_noise(quantity):
    """An accelerometer's mass line reaches to the end of the band: 900 times the noise there."""
    random, count = np.random.default_rng(3), 6000
    force = random.standard_normal((count, 1))
    f = 2j * np.pi * np.fft.rfftfreq(count)[:, None]
    omega, zeta = np.array([0.3, 0.9]), 0.02
    parts = 1.0 / (f**2 + 2.0 * zeta * omega * f + omega**2)
    answer = np.sum(parts, axis=1, keepdims=True) * (f**2 if quantity == "acceleration" else 1.0)
    clean = np.fft.irfft(answer * np.fft.rfft(force, axis=0), count, axis=0)
    # From the middle of it, where its end does not join its beginning.
    part, noise = slice(500, 5500), 1e-3 * np.std(clean)
    waves = clean[part] + noise * random.standard_normal((20, 5000, 1))
    found = [noise_of(moving(wave, force[part])) for wave in waves]
    assert np.mean([each.deviation for each in found]) == pytest.approx(noise, rel=0.05)


def test_noise_of_a_steady_cycle_is_its_change_from_period_to_period():
    """Harmonics that the force does not have, and an offset that wanders, are none of it; noise of
    any colour is."""
    random, period, count = np.random.default_rng(4), 1000, 4
    t = np.arange(period * count) / period
    lines = np.arange(5, 60)
    force = np.cos(2.0 * np.pi * (np.outer(t, lines) + 0.1 * lines**2)).sum(axis=1)[:, None]
    cycle = force + 0.5 * force**3
    colour = 1.0 / (1.0 + np.abs(np.fft.rfftfreq(period * count)) / 0.1)
    found = []
    for _ in range(20):
        white = random.standard_normal((period * count, 1))
        noise = np.fft.irfft(colour[:, None] * np.fft.rfft(white, axis=0), axis=0)
        response = cycle + 1e-3 * noise + 3e-3 * t[:, None]
        measured = force + 1e-4 * random.standard_normal(force.shape)
        found.append(noise_of(StudyRecording("rec", response, measured, initial="periodic")))
    assert found[0].source == ("between periods",)
    band = np.fft.rfftfreq(period * count) < END
    expected = 1e-3 * math.sqrt(np.mean(colour[band] ** 2))
    sizes = np.array([each.deviation[0] for each in found])
    assert np.mean(sizes) == pytest.approx(expected, rel=0.04)


def test_a_cycle_that_is_not_steady_is_no_noise_between_periods():
    random, period = np.random.default_rng(5), 1000
    t = np.arange(3 * period)
    force = np.cos(2.0 * np.pi * 20.0 * t / period)[:, None]
    late = force + np.exp(-1e-3 * t)[:, None] * np.sin(0.3 * t)[:, None]
    response = late + 1e-3 * random.standard_normal(late.shape)
    found = noise_of(StudyRecording("rec", response, force, initial="periodic"))
    assert found.source != ("between periods",)
    assert found.deviation == pytest.approx(1e-3, rel=0.1)


def test_noise_is_no_less_than_what_rounding_leaves():
    """A converter whose step hides the noise shows zeros before the hit."""
    random = np.random.default_rng(6)
    wave = np.zeros((500, 1))
    wave[100:] = np.sin(0.2 * np.arange(400))[:, None]
    step = 0.02
    response = step * np.rint((wave + 0.1 * step * random.standard_normal(wave.shape)) / step)
    force = np.zeros((500, 1))
    force[100:110] = 1.0
    found = noise_of(StudyRecording("rec", response, force, initial="rest"))
    assert found.deviation == pytest.approx(step / math.sqrt(12.0))


def test_noise_of_a_force_is_that_beside_its_pulse():
    random = np.random.default_rng(3)
    pulse = hit(np.arange(N) / RATE, PEAK, AT)[:, None]
    found = [cleaned(pulse + 0.2 * random.standard_normal((N, 1))) for _ in range(200)]
    # Of a quarter of the recording, by the median of deviations: 1.17 / sqrt(n).
    sizes = np.array([each.noise[0] for each in found])
    assert np.mean(sizes) == pytest.approx(0.2, rel=0.03)
    assert np.std(sizes) == pytest.approx(0.2 * 1.17 / math.sqrt(N / 4), rel=0.25)
    for each in found:
        acting = np.flatnonzero(each.clean[:, 0])
        assert set(acting) <= set(range(each.first - CONDITIONING.beside, each.last + 1))
        # All of the pulse that is six deviations of the noise high, and little beside it.
        assert set(np.flatnonzero(pulse > 12.0 * 0.2)) <= set(acting)
        assert len(acting) < 30


class Hits:
    """Hits of a model that is right, with noise of known size."""

    def __init__(self, quantity: str, force_noise: float) -> None:
        (kind,) = CATALOGUE["cubic_stiffness"]
        assert isinstance(kind, ForceKind)
        eye = jnp.eye(2)
        self.by, self.modal = predictor(model(False), eye, eye, RATE, quantity, (kind,), 2)
        self.clean = simulated(PEAK, quantity, at=AT)
        self.noise = SHARE * np.std(self.clean, axis=0)
        self.force_noise = np.array([force_noise, 0.0])
        self.random = np.random.default_rng(5)
        self.compiled: set[tuple[str, int, int]] = set()

    def conditioned(
        self, known: np.ndarray, told: SensorNoise | None = None
    ) -> ConditionedRecordings:
        response = self.clean + self.noise * self.random.standard_normal((N, 2))
        recording = StudyRecording("rec", response, self.acting(), noise=told)
        return conditioned([recording], self.by, self.modal, known, N, 1, 6)

    def acting(self) -> np.ndarray:
        """The force as measured."""
        return measured_force(PEAK, at=AT) + self.force_noise * self.random.standard_normal((N, 2))

    def run(self, known: np.ndarray, told: SensorNoise | None = None) -> FreeRun:
        """Of the model as it is, with nothing fitted."""
        seen = self.conditioned(known, told)
        problem = HistoryProblem(
            self.by,
            (),
            seen.data,
            self.noise,
            (0,),
            forces=seen.forces,
            compiled=self.compiled,
        )
        start = Start(problem.nothing(), problem.map.given())
        (fitted,) = multistart(problem, [start], math.inf, 0)
        return free_run(problem, fitted, [], [(seen, (0,))])


class Shaken(Hits):
    """Random force on the first mass from rest on, within a band, to the end of the recording.

    The response is exact: that to one long cycle, at whose end all is still again.
    """

    def __init__(self, quantity: str, force_noise: float) -> None:
        super().__init__(quantity, force_noise)
        count, random = 2**17, np.random.default_rng(7)
        t, f = np.arange(count) / RATE, np.fft.rfftfreq(count, 1.0 / RATE)
        lines = random.standard_normal((len(f), 2)) @ [1.0, 1.0j]
        wave = np.fft.irfft(np.where((f > 20.0) & (f < 100.0), lines, 0.0), count)
        # On within a tenth of a second; off, as smoothly, after what is recorded.
        rise = 0.5 * (np.tanh((t - 0.05) / 0.01) - np.tanh((t - 0.6) / 0.01))
        force = PEAK * wave * rise / np.max(np.abs(wave * rise))
        s = 2j * np.pi * f[:, None, None]
        answer = np.linalg.solve(s**2 * M + s * C + stiffness_with_joint(), np.eye(2)[0])
        power = QUANTITIES[quantity]
        moved = np.fft.irfft(s[:, 0] ** power * answer * np.fft.rfft(force)[:, None], count, axis=0)
        self.clean, self.force = moved[:N], np.stack([force[:N], np.zeros(N)], axis=1)
        self.noise = 1e-3 * np.std(self.clean, axis=0)

    def acting(self) -> np.ndarray:
        return self.force + self.force_noise * self.random.standard_normal((N, 2))


UNKNOWN = np.full(2, np.nan)


@pytest.mark.parametrize(
    ("quantity", "force_noise"),
    [
        ("velocity", 0.0),
        ("acceleration", 0.2),
        pytest.param("velocity", 2.0, marks=pytest.mark.long),
    ],
)
def test_the_floor_is_what_a_right_model_leaves(quantity, force_noise):
    """In the mean of many hits; of each, within the scatter of so few ways as noise goes."""
    hits = Hits(quantity, force_noise)
    runs = [hits.run(UNKNOWN) for _ in range(40)]
    shares = np.array([each.relative**2 / each.floor**2 for each in runs])
    three_deviations(shares, 1.0)
    # A sum of squares in the band, beside the estimate of the noise itself, and of few forces.
    if force_noise == 0.0:
        values = 2 * (N - 2 * HALF) * 2.0 * END
        expected = math.sqrt(2.0 / values + 0.5 * 2.0 / BEFORE)
        assert np.std(shares) == pytest.approx(expected, rel=0.35)


@pytest.mark.parametrize(
    "quantity", [pytest.param("velocity", marks=pytest.mark.long), "acceleration"]
)
def test_the_floor_holds_what_the_noise_of_a_lasting_force_leaves(quantity):
    """Of the sensors' noise alone a right model would be refuted."""
    shaken, draws = Shaken(quantity, 0.004 * PEAK), CONDITIONING.force_draws
    runs = [shaken.run(shaken.noise) for _ in range(12)]
    shares = np.array([each.relative**2 / each.floor**2 for each in runs])
    # The floor is the mean of so many draws of the same.
    deviation = np.std(shares) * math.sqrt(1.0 / len(runs) + 1.0 / draws)
    assert np.mean(shares) == pytest.approx(1.0, abs=3.0 * deviation)
    quiet = Shaken(quantity, 0.0).run(shaken.noise)
    assert all(each.floor > 3.0 * quiet.floor for each in runs)


@pytest.mark.parametrize(
    ("response", "force_noise", "above"),
    [
        (1.0, 0.0, 1.02),
        (0.1, 2.0, 1.3),
        pytest.param(1.0, 1.0, 1.1, marks=pytest.mark.long),
    ],
)
def test_one_right_model_of_twenty_exceeds_the_floor_of_95_per_cent(response, force_noise, above):
    """Of the sensors' noise alone, which varies little; of the force's, which goes a few ways
    only and may leave much more; of both. The sensors' is known."""
    hits = Hits("velocity", force_noise)
    hits.noise = response * hits.noise
    runs = [hits.run(hits.noise) for _ in range(80)]
    exceeded = sum(each.relative > each.floor_95 for each in runs)
    # Binomial: 4 expected, three deviations of 1.9.
    assert abs(exceeded - 4.0) < 3.0 * math.sqrt(80 * 0.05 * 0.95)
    assert np.mean([each.floor_95 / each.floor for each in runs]) > above


@pytest.mark.parametrize("before", [24, pytest.param(80, marks=pytest.mark.long)])
def test_the_floor_of_95_per_cent_allows_for_an_estimated_noise(before):
    """Noise told by a few samples: without its own doubt 19 to 42 of a hundred exceeded it."""
    hits = Hits("velocity", 0.0)
    hits.noise = hits.noise * np.array([1.0, 1e-3])
    draws = 100
    exceeded = 0
    for _ in range(draws):
        quiet = hits.noise * hits.random.standard_normal((before, 2))
        level = NoiseLevel(np.std(quiet, axis=0, ddof=1), np.full(2, before - 1.0))
        told = SensorNoise.of(level, "before the force")
        run = hits.run(UNKNOWN, told)
        exceeded += run.relative > run.floor_95
        assert run.floors_95()["rec"] == pytest.approx(run.floor_95)
    # Binomial: 5 expected, three deviations of 2.2.
    assert abs(exceeded - 0.05 * draws) < 3.0 * math.sqrt(draws * 0.05 * 0.95)


def test_pairs_of_samples_are_those_of_the_bands_own_matrix():
    """By the filter as a matrix; with gaps, and with fewer samples than it is long."""
    random = np.random.default_rng(6)
    for count in (20, 150):
        band = np.asarray(in_band(jnp.eye(count + 2 * HALF)))[HALF:-HALF]
        covariance = band @ band.T
        x = random.standard_normal((3, count, 2)) * (random.random((3, count, 2)) > 0.2)
        for found, matrix in (
            (over_pairs(x, CORRELATION), covariance),
            (over_pairs(x, CORRELATION**2), covariance**2),
        ):
            np.testing.assert_allclose(found, np.einsum("wis,ij,wjs->ws", x, matrix, x), atol=1e-10)


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_weights_are_one_over_what_residuals_may_be(quantity):
    """Sensors' noise and the model's own share, in the band; and the force's, while it acts."""
    hits = Hits(quantity, 0.0)
    known = np.array([1.0, 2.0]) * hits.noise
    seen = hits.conditioned(known)
    weight = np.asarray(seen.data.weight)[0]
    rms = np.sqrt(np.mean(np.asarray(seen.data.response)[0] ** 2, axis=0))
    expected = 1.0 / (OF_NOISE * np.sqrt(known**2 + (CONDITIONING.model_error * rms) ** 2))
    late = slice(round(AT * RATE) + 40, -HALF)
    np.testing.assert_allclose(weight[late], np.tile(expected, (len(weight[late]), 1)))
    assert not np.any(weight[:HALF])
    assert not np.any(weight[-HALF:])
    # A hundredth of the peak over the mass, which an accelerometer shows at once.
    at_peak = weight[round(AT * RATE)]
    if quantity == "velocity":
        np.testing.assert_allclose(at_peak, expected)
    else:
        felt = np.array([0.01 * np.max(measured_force(PEAK, at=AT)) / M[0, 0], 0.0])
        np.testing.assert_allclose(
            at_peak, 1.0 / np.sqrt(expected**-2 + (OF_NOISE * felt) ** 2), rtol=1e-3
        )
    np.testing.assert_array_equal(seen.noise, known[None])
