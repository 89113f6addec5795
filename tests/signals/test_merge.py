from dataclasses import replace

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.signals.hilbert import ringdown_curves
from iwanjax.signals.merge import merge_curves

HITS, LEVELS, CAMPAIGNS = 12, 20, 150
# Deviations of one hit's estimates, Hz and 1.
NOISE = {"frequency": 0.01, "damping": 2e-5}


def truth(name, amplitude):
    """Lines in the logarithm of the amplitude, which interpolation keeps."""
    x = np.log(np.asarray(amplitude))
    return 100.0 - 0.5 * x if name == "frequency" else 1e-3 + 2e-4 * x


def hit(rng, scatter=0.0, low=-4.0, high=0.0, count=LEVELS):
    """Levels that fall, as in a decay; the whole hit is off by ``scatter`` times its noise."""
    amplitude = np.exp(np.linspace(high, low, count) + rng.uniform(-0.1, 0.1))
    noisy = {
        name: truth(name, amplitude)
        + std * (scatter * rng.standard_normal() + rng.standard_normal(count))
        for name, std in NOISE.items()
    }
    deviations = {f"{name}_std": np.full(count, std) for name, std in NOISE.items()}
    return ij.ModalCurves(amplitude, **noisy, **deviations, quantity="velocity", unit="m/s")


def campaigns(scatter):
    return [
        merge_curves([hit(rng, scatter) for _ in range(HITS)])
        for rng in map(np.random.default_rng, range(CAMPAIGNS))
    ]


@pytest.fixture(scope="module")
def repeating():
    return campaigns(0.0)


@pytest.fixture(scope="module")
def scattering():
    return campaigns(3.0)


@pytest.mark.parametrize("name", NOISE)
def test_hits_that_repeat_have_no_repeatability_left(repeating, name):
    # The excess of n hits over their noise varies by sqrt(2/(n-1)) of that noise's variance.
    excess = np.sqrt(2.0 / (HITS - 1))
    ratio = [
        np.mean(getattr(m, f"{name}_repeatability") ** 2) / NOISE[name] ** 2 for m in repeating
    ]
    # Were levels not averaged, the positive half of that would remain: 0.4 of it.
    assert np.mean(ratio) < 0.4 * excess


@pytest.mark.parametrize("name", NOISE)
def test_the_deviation_of_the_mean_is_right(repeating, name):
    z = np.concatenate(
        [
            (getattr(m.curves, name) - truth(name, m.curves.amplitude))
            / getattr(m.curves, f"{name}_std")
            for m in repeating
        ]
    )
    # What is taken for scatter by chance makes it a little too wide.
    assert 0.9 < np.sqrt(np.mean(z**2)) < 1.03


@pytest.mark.parametrize("name", NOISE)
def test_scatter_from_hit_to_hit_is_recovered(scattering, name):
    """A variance from n hits is known to sqrt(2/(n-1)), and without bias."""
    ratio = (
        np.array([np.mean(getattr(m, f"{name}_repeatability") ** 2) for m in scattering])
        / (3.0 * NOISE[name]) ** 2
    )
    sampling = np.sqrt(2.0 / (HITS - 1))
    assert np.mean(ratio) == pytest.approx(1.0, abs=3.0 * sampling / np.sqrt(CAMPAIGNS))
    assert np.std(ratio) == pytest.approx(sampling, rel=0.25)


@pytest.mark.parametrize("name", NOISE)
def test_the_repeatability_is_what_the_scatter_has_beyond_the_noise(name):
    """Hits of equal noise at equal levels: a sample variance less that of the noise."""
    rng, count = np.random.default_rng(5), 4
    hits = [hit(rng, scatter=1.5) for _ in range(count)]
    hits = [replace(h, amplitude=hits[0].amplitude) for h in hits]
    values = np.array([np.asarray(getattr(h, name))[::-1] for h in hits])
    excess = np.var(values, axis=0, ddof=1) - NOISE[name] ** 2
    around = [np.mean(excess[max(i - 2, 0) : i + 3]) for i in range(LEVELS)]
    found = getattr(merge_curves(hits, LEVELS), f"{name}_repeatability")
    assert_allclose(found, np.sqrt(np.maximum(around, 0.0)), rtol=1e-6, atol=1e-6 * NOISE[name])
    assert np.max(around) > 0


@pytest.mark.parametrize("name", NOISE)
def test_the_mean_of_scattering_hits_is_as_uncertain_as_it_says(scattering, name):
    square = [
        np.mean(
            (
                (getattr(m.curves, name) - truth(name, m.curves.amplitude))
                / getattr(m.curves, f"{name}_std")
            )
            ** 2
        )
        for m in scattering
    ]
    # Student's t of n - 1 degrees of freedom has this variance.
    expected = (HITS - 1) / (HITS - 3)
    assert np.mean(square) == pytest.approx(expected, abs=3 * expected * (2 / CAMPAIGNS) ** 0.5)


def test_the_next_hit_has_both_deviations(scattering):
    covered = []
    for i, m in enumerate(scattering):
        c = m.next_hit
        assert_allclose(
            c.damping_std, np.hypot(m.damping_repeatability, m.damping_estimator), rtol=1e-12
        )
        new = hit(np.random.default_rng([i, 1]), 3.0)
        x = np.log(np.asarray(new.amplitude))[::-1]
        predicted, std = (
            np.interp(x, np.log(np.asarray(c.amplitude)), np.asarray(y))
            for y in (c.damping, c.damping_std)
        )
        inside = slice(2, -2)
        z = (np.asarray(new.damping)[::-1] - predicted) / std
        covered.append(np.mean(np.abs(z[inside]) < 1.96))
    # Twelve hits' own uncertainty takes a little: t of 11 degrees of freedom gives 0.924.
    assert np.mean(covered) == pytest.approx(0.93, abs=0.05)


def test_levels_rise_and_count_the_hits_that_reach_them():
    rng = np.random.default_rng(0)
    ranges = [(-4.0, 0.0), (-3.0, 1.0), (-2.0, -1.0), (-6.0, 3.0)]
    hits = [hit(rng, low=low, high=high) for low, high in ranges]
    m = merge_curves(hits)
    amplitude = np.asarray(m.curves.amplitude)
    assert np.all(np.diff(amplitude) > 0)
    ends = [(float(h.amplitude[-1]), float(h.amplitude[0])) for h in hits]
    # From the second lowest to the second highest of the hits' ends.
    assert amplitude[[0, -1]] == pytest.approx([ends[0][0], ends[1][1]])
    inner = amplitude[1:-1]
    assert_allclose(m.count[1:-1], sum((inner > low) & (inner < high) for low, high in ends))
    assert (m.curves.quantity, m.curves.unit) == ("velocity", "m/s")
    assert merge_curves(hits, levels=7).curves.amplitude.shape == (7,)


def test_amplitudes_that_only_one_hit_reaches_are_left_out():
    rng = np.random.default_rng(0)
    low = [hit(rng, low=-6.0, high=-4.0) for _ in range(2)]
    high = [hit(rng, low=-2.0, high=0.0) for _ in range(2)]
    x = np.log(np.asarray(merge_curves([*low, *high]).curves.amplitude))
    assert x[0] < -5.8
    assert x[-1] > -0.2
    assert not np.any((x > -3.8) & (x < -2.2))


def test_a_noisy_hit_counts_less():
    exact, noisy = hit(np.random.default_rng(0)), hit(np.random.default_rng(1))
    noisy = replace(
        noisy, damping=noisy.damping + 1e-3, damping_std=100.0 * np.asarray(noisy.damping_std)
    )
    m = merge_curves([exact, exact, noisy])
    off = np.asarray(m.curves.damping) - truth("damping", m.curves.amplitude)
    z = off / np.asarray(m.curves.damping_std)
    assert np.max(np.abs(z)) < 4.0


REFUSED = {
    "one": ([hit(np.random.default_rng(0))], "1 curve.*at least two"),
    "none": ([], "0 curve.*at least two"),
    "quantities": (
        [hit(np.random.default_rng(0)), hit(np.random.default_rng(0)).as_quantity("displacement")],
        "different amplitudes.*as_quantity",
    ),
    "no deviations": (
        [hit(np.random.default_rng(0)), replace(hit(np.random.default_rng(0)), damping_std=None)],
        "hit 1 has no standard deviations",
    ),
    "apart": (
        [
            hit(np.random.default_rng(0), low=-6, high=-4),
            hit(np.random.default_rng(0), low=-2, high=0),
        ],
        "no amplitude is reached by two hits",
    ),
    "three apart": (
        [hit(np.random.default_rng(0), low=low, high=low + 1) for low in (-6, -4, -2)],
        r"reached by two hits \(they reach .* to .*, .* to .*, .* to .*\)",
    ),
    "one level": ([hit(np.random.default_rng(0), count=1)] * 2, r"hit 0 has shape \(1,\)"),
}


@pytest.mark.parametrize(("hits", "message"), REFUSED.values(), ids=REFUSED)
def test_hits_that_cannot_be_merged_are_refused(hits, message):
    with pytest.raises(ij.InputError, match=message) as caught:
        merge_curves(hits)
    assert "\n" not in str(caught.value)


# --- measured: twelve hits on the double beam ------------------------------------------------


@pytest.fixture(scope="module")
def double_beam(reference_data):
    cells = scipy.io.loadmat(reference_data / "double_beam" / "data.mat")["xData"]
    time = cells[0, 0].ravel()
    # Times are rounded to a tenth of a microsecond: their ends say more than a step.
    rate = (time.size - 1) / (time[-1] - time[0])
    return [ringdown_curves(x.ravel(), rate, (90.0, 160.0), unit="m/s") for x in cells[:, 1]]


def test_the_double_beams_hits_repeat(double_beam):
    m = merge_curves(double_beam)
    amplitude = np.asarray(m.curves.amplitude)
    inside = (amplitude > 0.1) & (amplitude < 0.9)
    assert np.sqrt(np.mean(m.frequency_spread[inside] ** 2)) < 0.01
    assert np.sqrt(np.mean(m.damping_spread[inside] ** 2)) < 3e-5
    # More than the noise explains: three places of impact, and bolts.
    assert np.mean(m.damping_repeatability[inside] > m.damping_estimator[inside]) > 0.9


def test_the_double_beam_softens_and_loses_more_at_large_amplitudes(double_beam):
    """122.42 Hz and 0.054 per cent at 0.086 m/s, 122.00 Hz and 0.165 per cent at 1 m/s."""
    weak = min(double_beam, key=lambda c: float(c.amplitude[-1]))
    strong = max(double_beam, key=lambda c: float(c.amplitude[0]))
    x = np.log(np.asarray(weak.amplitude))[::-1]
    ends = {"frequency": (122.42, 122.00, 0.01, 0.0), "damping": (5.4e-4, 1.65e-3, 0.0, 0.05)}
    for name, (low, high, near, share) in ends.items():
        value = np.interp(np.log(0.086), x, np.asarray(getattr(weak, name))[::-1])
        assert value == pytest.approx(low, abs=near, rel=share)
        # The strongest hit has fallen to 0.93 m/s when the filter settles; a line leads back.
        line = np.polyfit(strong.amplitude[:5], np.asarray(getattr(strong, name))[:5], 1)
        assert np.polyval(line, 1.0) == pytest.approx(high, abs=near, rel=share)
