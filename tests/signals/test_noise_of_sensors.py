"""Noise of known size in recordings of every kind: estimated, or bounded, but no response in it.

The structure is a difference equation, so that its response is exact whatever acts on it:

    y[n+1] = 2 r cos(w) y[n] - r^2 y[n-1] + f[n] - k3 y[n]^3
"""

import numpy as np
import pytest

from iwanjax.signals.comparison_band import END
from iwanjax.signals.noise import NoiseLevel, between_periods, of_rounding
from iwanjax.signals.sensor_noise import (
    BESIDE_MODEL,
    GIVEN,
    SensorNoise,
    along_motion,
    beside_model,
    like_others,
)

N, PERIODS = 4000, 4
T = np.arange(N)
SHARE = 0.01
"""Noise over the response."""
WITHIN = (0.8, 1.25)


def driven(force: np.ndarray, cubic: float = 0.0, times: float = 1.0) -> np.ndarray:
    """Two modes, of so many times 0.3 % and 1 % damping; the cubic spring is in the first."""
    y = np.zeros(len(force) + 1)
    for frequency, damping, k3 in ((0.06, 0.003, cubic), (0.17, 0.01, 0.0)):
        turn = 2.0 * np.pi * frequency
        r = np.exp(-times * damping * turn)
        a, b = 2.0 * r * np.cos(turn), r**2
        last, now = 0.0, 0.0
        for n, f in enumerate(force):
            last, now = now, a * now - b * last + f - k3 * now**3
            y[n + 1] += now
    return y[:-1]


def cubic(force: np.ndarray) -> float:
    """A spring that at the largest deflection is a third of the first mode's stiffness."""
    return 0.05 / np.max(driven(force)) ** 2


def lines(count: int, random: np.random.Generator) -> np.ndarray:
    """A random-phase multisine from 0.01 to 0.3 of the rate, of deviation 1."""
    spectrum = np.zeros(count // 2 + 1, dtype=complex)
    k = slice(count // 100, int(0.3 * count))
    spectrum[k] = np.exp(2j * np.pi * random.random(len(spectrum[k])))
    wave = np.fft.irfft(spectrum)
    return wave / np.std(wave)


def force_of(kind: str) -> np.ndarray:
    random = np.random.default_rng(11)
    if kind == "random":
        # From the middle: it begins and ends in motion, and its end does not join its beginning.
        return lines(2 * N, random)[:N]
    if kind == "multisine":
        return lines(N, random)
    if kind == "sweep":
        return np.sin(2.0 * np.pi * (0.01 * T + 0.29 * T**2 / (2.0 * N)))
    hits = np.zeros(N)
    for start in (20, 1300, 2700):
        hits[start : start + 8] += np.hanning(10)[1:-1]
    return hits


FORCES = ("random", "multisine", "sweep", "hits")


def noise_of_colour(kind: str, random: np.random.Generator) -> np.ndarray:
    """Of deviation 1: white; half of it pink; white noise through a low-pass at 0.01, 1/f^2."""
    white = np.fft.rfft(random.standard_normal(4 * N))
    f = np.fft.rfftfreq(4 * N)
    shape = {
        "white": np.ones_like(f),
        "half pink": np.sqrt(1.0 + 0.05 / np.maximum(f, f[1])),
        "1/f^2": 1.0 / np.sqrt(1.0 + (f / 0.01) ** 2),
    }[kind]
    wave = np.fft.irfft(shape * white)[N : 2 * N]
    return wave / np.std(wave)


def in_band(noise: np.ndarray) -> float:
    """Deviation of white noise with as much power in the band that is compared."""
    spectrum = np.fft.rfft(noise)[1 : int(END * len(noise))]
    return float(np.sqrt(np.mean(np.abs(spectrum) ** 2) / len(noise)))


def estimated(response: np.ndarray, force: np.ndarray) -> SensorNoise:
    found = along_motion(response[:, None], force[:, None])
    return found.at_least(of_rounding(response[:, None]))


@pytest.mark.parametrize("colour", ["white", "half pink", "1/f^2"])
@pytest.mark.parametrize("kind", FORCES)
def test_noise_of_any_colour_beside_a_linear_structure(kind, colour):
    """Modes two frequencies wide, of 100 times the noise, are none of it.

    In the mean square of eight records: one of 1/f^2 has its power in a few frequencies.
    """
    force = force_of(kind)
    clean = driven(force)
    random = np.random.default_rng(FORCES.index(kind))
    noises = [SHARE * np.std(clean) * noise_of_colour(colour, random) for _ in range(8)]
    found = [estimated(clean + noise, force) for noise in noises]
    true = np.sqrt(np.mean([in_band(noise) ** 2 for noise in noises]))
    upper = np.sqrt(np.mean([each.upper[0] ** 2 for each in found]))
    assert WITHIN[0] < upper / true < WITHIN[1]
    whole = [each.source == ("over the whole band",) for each in found]
    # 1/f^2 is the steepest that counts as noise, and beyond it by chance. The others are bounds.
    assert sum(whole) > len(whole) / 2
    for each, all_of_it in zip(found, whole, strict=True):
        assert (each.lower[0] == each.upper[0]) == all_of_it


@pytest.mark.parametrize("kind", FORCES)
def test_noise_of_rounding_to_few_steps(kind):
    """12 bits of which a twentieth of the range is used: 205 steps to the peak."""
    force = force_of(kind)
    clean = driven(force)
    step = np.max(np.abs(clean)) / (0.05 * 4096)
    rounded = step * np.rint(clean / step)
    found = estimated(rounded, force)
    assert WITHIN[0] < found.deviation[0] / in_band(rounded - clean) < WITHIN[1]


@pytest.mark.parametrize("kind", FORCES)
def test_what_a_cubic_spring_does_is_no_noise(kind):
    """Response that no linear model explains, 10 to 60 times the noise, is in the upper bound."""
    force = force_of(kind)
    clean = driven(force, cubic(force))
    noise = SHARE * np.std(clean) * np.random.default_rng(3).standard_normal(N)
    found = estimated(clean + noise, force)
    assert found.source[0] in ("in quiet bands", "one step ahead")
    assert found.upper[0] > 5.0 * in_band(noise)
    assert 0.9 < found.deviation[0] / in_band(noise) < 1.5


def test_noise_that_passes_through_the_structure_is_bounded_from_both_sides():
    """A force that nobody measures: white, its one-step error that of one sample of it."""
    random = np.random.default_rng(4)
    force, other = force_of("random"), 0.05 * random.standard_normal(N)
    clean = driven(force)
    noise = driven(force + other) - clean
    found = estimated(clean + noise + 1e-4 * random.standard_normal(N), force)
    assert found.source == ("one step ahead",)
    # The two modes' answers to one sample of it, as they come one step later.
    assert found.deviation[0] == pytest.approx(2.0 * np.std(other), rel=0.15)
    assert found.lower[0] < 0.5 * found.deviation[0]
    assert 0.5 < found.upper[0] / in_band(noise) < 1.25


@pytest.mark.parametrize("through", [False, True])
def test_noise_between_periods_is_whatever_does_not_repeat(through):
    """Harmonics of the cubic spring repeat; noise of a force, as the structure amplifies it, no.

    In the mean square of six records, of modes that die away within a period.
    """
    random, period = np.random.default_rng(5), N // 2
    force = np.tile(lines(period, random), 3 * PERIODS)
    # As much as leaves the cycle steady.
    clean = driven(force, 0.1 * cubic(force), 4.0)
    last = slice(-PERIODS * period, None)
    squares = []
    for _ in range(6):
        white = random.standard_normal(len(force))
        noise = driven(white, 0.0, 4.0) if through else SHARE * np.std(clean) * white
        response = (clean + noise)[last, None]
        found = between_periods(response, force[last, None], period)
        assert found.steady.all()
        squares.append((found.level.deviation[0] ** 2, in_band(noise[last]) ** 2))
    estimate, true = np.sqrt(np.mean(squares, axis=0))
    assert WITHIN[0] < estimate / true < WITHIN[1]
    # What has not died away yet is no noise.
    early = slice(0, PERIODS * period)
    assert not between_periods(clean[early, None], force[early, None], period).steady.any()


def test_clipped_samples_spoil_no_estimate():
    force = force_of("random")
    clean = driven(force)
    noise = SHARE * np.std(clean) * np.random.default_rng(6).standard_normal(N)
    limit = 1.5 * np.std(clean)
    found = estimated(np.clip(clean + noise, -limit, limit), force)
    assert np.mean(np.abs(clean) > limit) > 0.05
    assert WITHIN[0] < found.deviation[0] / in_band(noise) < WITHIN[1]
    assert found.upper[0] > 5.0 * in_band(noise)


@pytest.mark.parametrize("colour", ["white", "half pink"])
@pytest.mark.parametrize("kind", FORCES)
def test_noise_is_what_a_model_leaves_unless_modes_stand_out_of_it(kind, colour):
    """Of a right model; of one that lacks a share of the cubic spring it stays what it was."""
    force = force_of(kind)
    k3 = cubic(force)
    clean, random = driven(force, k3), np.random.default_rng(8)
    noise = SHARE * np.std(clean) * noise_of_colour(colour, random)
    known = estimated(clean + noise, force)
    found = beside_model(known, noise[:, None])
    assert found.source == (BESIDE_MODEL,)
    assert WITHIN[0] < found.deviation[0] / in_band(noise) < WITHIN[1]
    # Half as far off as the noise is loud; at a quarter it is taken for noise more often than not.
    missing = clean - driven(force, 0.0)
    missing *= 0.5 * np.std(noise) / np.std(missing)
    assert beside_model(known, (noise + missing)[:, None]) == known
    given = SensorNoise.of(NoiseLevel(np.array([1.0]), np.array([np.inf])), GIVEN)
    assert beside_model(given, noise[:, None]) == given


def test_a_held_out_sensor_has_the_noise_of_the_others_within_its_own_bounds():
    """The third is told by two recordings, the last by none."""
    bounds = np.array([[0.5, 2.5], [3.0, 4.0], [1.0, 9.0], [1.0, 2.0]]).T
    own = SensorNoise(bounds[0], np.full(4, 50.0), ("in quiet bands",) * 4, *bounds)
    told = [
        own._replace(
            deviation=np.array(deviation),
            freedom=np.full(4, 80.0),
            source=(BESIDE_MODEL,) * 3 + last,
        )
        for deviation, last in (([2.0, 2.0, 1.0, 5.0], ("before the force",)),)
    ]
    told.append(told[0]._replace(deviation=np.array([2.0, 2.0, 7.0, 5.0])))
    found = like_others(own, told)
    np.testing.assert_allclose(found.deviation, [2.0, 3.0, 5.0, 1.0])
    assert found.source == (BESIDE_MODEL,) * 3 + ("in quiet bands",)
    np.testing.assert_array_equal(found.upper, [2.0, 3.0, 5.0, 2.0])
