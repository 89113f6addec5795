from functools import cache

import numpy as np
import pytest
import scipy.io
from modal_ringdown import FOLDER, make_hits
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import iwanjax as ij
from iwanjax.curves import QUANTITIES
from iwanjax.signals.filters import settling_time
from iwanjax.signals.hilbert import ringdown, ringdown_curves

RATE = 2000.0
BAND = (70.0, 140.0)
SETTLED = settling_time(BAND, 3)
# Noise draws per level; 500 were run by hand, with the same coverage to a per cent.
DRAWS = 150


def decay(t, frequency=100.0, damping=2e-3, amplitude=1.0, at=0.0):
    """A linear mode struck at a time."""
    since = np.maximum(t - at, 0.0)
    rate, omega = 2.0 * np.pi * frequency * damping, 2.0 * np.pi * frequency
    return np.where(t >= at, amplitude * np.exp(-rate * since) * np.cos(omega * since + 0.3), 0.0)


def record(*hits, noise=1e-3, seconds=4.0, seed=0):
    """Decays, each given by its options, in white noise."""
    t = np.arange(int(seconds * RATE)) / RATE
    x = noise * np.random.default_rng(seed).standard_normal(t.size)
    return sum((decay(t, **hit) for hit in hits), x)


# --- a slow flow whose frequency and damping are known at every amplitude -----------------


def flow(amplitude):
    """Frequency, Hz, and damping at an amplitude of acceleration."""
    return 100.0 * (1.0 - 0.008 * amplitude**0.8), 6e-4 + 2.5e-3 * amplitude**0.8


@cache
def flowing(seconds=6.0):
    """Log-amplitude and phase that flow down from amplitude 1."""

    def derivatives(_, state):
        frequency, damping = flow(np.exp(state[0]))
        natural = 2.0 * np.pi * frequency
        return [-damping * natural, natural * np.sqrt(1.0 - damping**2)]

    t = np.arange(int(seconds * RATE)) / RATE
    return solve_ivp(derivatives, (0.0, seconds), [0.0, 0.3], "DOP853", t, rtol=1e-11, atol=1e-12).y


def flowing_signal():
    psi_1, psi_2 = flowing()
    return np.exp(psi_1) * np.cos(psi_2)


@pytest.fixture(
    scope="module",
    params=[30.0, *(pytest.param(level, marks=pytest.mark.long) for level in (50.0, 70.0))],
    ids="{:.0f}dB".format,
)
def draws(request):
    """For all levels of all draws: amplitude, and per quantity (relative error, deviation)."""
    deviation = np.sqrt(0.5) * 10.0 ** (-request.param / 20.0)
    rng = np.random.default_rng([1, int(request.param)])
    clean, levels = flowing_signal(), []
    for _ in range(DRAWS):
        c = ringdown_curves(
            clean + deviation * rng.standard_normal(clean.size), RATE, BAND, quantity="acceleration"
        )
        f, zeta = flow(np.asarray(c.amplitude))
        levels.append(
            [
                c.amplitude,
                c.frequency / f - 1.0,
                np.asarray(c.frequency_std) / f,
                c.damping / zeta - 1.0,
                np.asarray(c.damping_std) / zeta,
                np.asarray(c.damping_std) / np.asarray(c.damping),
            ]
        )
    return np.concatenate(levels, axis=1)


@pytest.mark.parametrize("column", [1, 3], ids=["frequency", "damping"])
def test_the_deviations_cover_the_truth_as_often_as_they_say(draws, column):
    z = np.abs(draws[column] / draws[column + 1])
    assert np.mean(z < 1.0) == pytest.approx(0.68, abs=0.08)
    assert np.mean(z < 1.96) == pytest.approx(0.95, abs=0.04)


@pytest.mark.parametrize("estimator", ["polynomial", "peaks", "short_time", "kalman"])
@pytest.mark.parametrize(
    ("decibel", "count"),
    [
        (50.0, 30),
        *(
            pytest.param(*each, marks=pytest.mark.long)
            for each in ((30.0, 150), (50.0, 500), (70.0, 150))
        ),
    ],
)
def test_every_estimator_covers_the_truth_as_often_as_it_says(estimator, decibel, count):
    """Few draws leave three per cent of chance to the first number, and as much to the other."""
    deviation = np.sqrt(0.5) * 10.0 ** (-decibel / 20.0)
    rng, clean = np.random.default_rng([2, int(decibel)]), flowing_signal()
    z = []
    for _ in range(count):
        noisy = clean + deviation * rng.standard_normal(clean.size)
        c = ringdown_curves(noisy, RATE, BAND, quantity="acceleration", estimator=estimator)
        f, zeta = flow(np.asarray(c.amplitude))
        of_f, of_zeta = np.asarray(c.frequency_std), np.asarray(c.damping_std)
        z.append([(c.frequency - f) / of_f, (c.damping - zeta) / of_zeta])
    for each in np.abs(np.concatenate(z, axis=1)):
        assert np.mean(each < 1.0) == pytest.approx(0.68, abs=0.08)
        assert np.mean(each < 1.96) == pytest.approx(0.95, abs=0.04)


@pytest.mark.long
@pytest.mark.parametrize("strength", [0.5, 1.6], ids=["microslip", "macroslip"])
@pytest.mark.parametrize("estimator", ["lines", "polynomial", "peaks", "short_time", "kalman"])
def test_so_it_does_on_decays_of_a_joint_that_none_was_made_with(estimator, strength):
    """Another mode, rate and band; from beyond macroslip the curves have a kink."""
    joint = ij.Iwan4(F_S=1.0, K_T=5000.0, chi=-0.4, beta=0.8)
    mode = ij.ModalOscillator(58.0, 1.2e-3, joint)
    largest, rate, band = strength * float(joint.phi_max), 1500.0, (40.0, 75.0)
    x = np.log(largest) + np.linspace(-9.2, 0.01, 4000)
    f, zeta = map(np.asarray, mode.ringdown_frequency_and_damping(np.exp(x), largest=largest))

    def derivatives(_, state):
        natural, damping = 2.0 * np.pi * np.interp(state[0], x, f), np.interp(state[0], x, zeta)
        return [-damping * natural, natural * np.sqrt(1.0 - damping**2)]

    t = np.arange(12_000) / rate
    begin = [np.log(largest), 0.3]
    psi = solve_ivp(derivatives, (0.0, 8.0), begin, "DOP853", t, rtol=1e-10, max_step=0.01).y
    clean, rng, z = np.exp(psi[0]) * np.cos(psi[1]), np.random.default_rng(7), []
    for _ in range(100):
        noisy = clean + largest * 4e-3 * rng.standard_normal(t.size)
        c = ringdown_curves(noisy, rate, band, quantity="acceleration", estimator=estimator)
        at = np.log(np.asarray(c.amplitude))
        off = c.frequency - np.interp(at, x, f), c.damping - np.interp(at, x, zeta)
        z.append([off[0] / np.asarray(c.frequency_std), off[1] / np.asarray(c.damping_std)])
    for each in np.abs(np.concatenate(z, axis=1)):
        assert np.mean(each < 1.0) == pytest.approx(0.68, abs=0.08)
        assert np.mean(each < 1.96) == pytest.approx(0.95, abs=0.04)


@pytest.mark.parametrize("estimator", ["polynomial", "peaks", "short_time", "kalman"])
def test_every_estimator_tells_the_decay_of_a_linear_mode(estimator):
    ring = ringdown(record({}, noise=1e-6), RATE, BAND, "acceleration", estimator=estimator)
    c = ring.curves
    assert_allclose(c.frequency, 100.0, rtol=1e-5)
    assert_allclose(c.damping, 2e-3, rtol=5e-3)
    assert_allclose(c.amplitude, np.exp(-2e-3 * 200.0 * np.pi * ring.time), rtol=1e-3)
    for std in (c.amplitude_std, c.frequency_std, c.damping_std):
        assert np.all(np.asarray(std) > 0.0)


def test_an_unknown_estimator_is_refused_by_name():
    with pytest.raises(ij.InputError, match="estimator = 'kalmann': expected one of lines, poly"):
        ringdown(record({}), RATE, BAND, estimator="kalmann")


def test_the_mean_over_draws_is_the_truth_where_the_damping_is_known_to_a_tenth(draws):
    amplitude, f_error, _, zeta_error, _, share = draws
    x, trusted = np.log(amplitude), share < 0.1
    bins = np.digitize(x, np.linspace(x[trusted].min(), x.max(), 8))
    enough = [i for i in range(1, 8) if np.sum(trusted & (bins == i)) > DRAWS // 3]
    assert len(enough) >= 5
    for i in enough:
        here = trusted & (bins == i)
        assert abs(np.mean(f_error[here])) < 2e-4
        assert abs(np.mean(zeta_error[here])) < 0.03


def test_long_intervals_have_the_values_of_their_midpoints():
    """A line is an average; unless that is undone, half a decrement shows."""
    r = ringdown(flowing_signal(), RATE, BAND, "acceleration", precision=1e-9)
    decrement = -np.diff(np.interp(r.edges, r.signal_time, np.log(r.envelope)))
    assert np.min(decrement[1:-1]) > 0.4
    psi_1 = flowing()[0]
    amplitude = np.exp(np.interp(r.time, np.arange(psi_1.size) / RATE, psi_1))
    f, zeta = flow(amplitude)
    # A third of what averaging does at most; the two at the ends have neighbours on one side.
    inner = slice(1, -1)
    assert_allclose(r.curves.amplitude[inner], amplitude[inner], rtol=2e-3)
    assert_allclose(r.curves.frequency[inner], f[inner], rtol=5e-6)
    assert_allclose(r.curves.damping[inner], zeta[inner], rtol=1e-3)


# --- one oscillator of discrete sliders, without noise ------------------------------------

SLIDERS = make_hits.Oscillator(
    f_0=100.0, zeta_0=5e-4, F_S=2.0, K_T=0.06 * (200.0 * np.pi) ** 2, chi=-0.5, beta=1.0
)


@pytest.fixture(scope="module")
def microslip():
    """Curves from displacement, velocity and acceleration of one decay, against displacement."""
    velocity = np.array([SLIDERS.omega_0 * SLIDERS.phi_max])
    motion = make_hits.ring_down(SLIDERS, velocity, RATE, int(2.5 * RATE), 20)
    return {
        quantity: ringdown_curves(signal[:, 0], RATE, (60.0, 140.0), quantity=quantity).as_quantity(
            "displacement"
        )
        for quantity, signal in motion._asdict().items()
    }


def closed_form(oscillator, q):
    """Frequency, Hz, and damping by the joint's first harmonic and dissipation."""
    joint = ij.Iwan4(
        F_S=oscillator.F_S, K_T=oscillator.K_T, chi=oscillator.chi, beta=oscillator.beta
    )
    stiffness = oscillator.omega_0**2 - oscillator.K_T + np.asarray(joint.harmonic_stiffness(q))
    omega = np.sqrt(stiffness)
    dissipated = np.asarray(joint.dissipation(q)) / (2.0 * np.pi * stiffness * q**2)
    return omega / (2.0 * np.pi), dissipated + oscillator.zeta_0 * oscillator.omega_0 / omega


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_frequency_and_damping_are_the_closed_forms(microslip, quantity):
    c = microslip[quantity]
    q = np.asarray(c.amplitude)
    assert q[-1] < 0.1 * SLIDERS.phi_max < 0.75 * SLIDERS.phi_max < q[0] < SLIDERS.phi_max
    f, zeta = closed_form(SLIDERS, q)
    assert_allclose(c.frequency, f, rtol=3e-5)
    assert_allclose(c.damping, zeta, rtol=3e-3)


def test_displacement_velocity_and_acceleration_agree(microslip):
    levels = np.geomspace(0.08, 0.75, 20) * SLIDERS.phi_max

    def at(c, values):
        # Relative to the closed form, which takes the curvature out of the interpolation.
        q = np.asarray(c.amplitude)[::-1]
        return np.interp(np.log(levels), np.log(q), values[::-1])

    damping, frequency = (
        [
            at(c, np.asarray(getattr(c, name)) / closed_form(SLIDERS, np.asarray(c.amplitude))[i])
            for c in microslip.values()
        ]
        for i, name in ((1, "damping"), (0, "frequency"))
    )
    assert np.max(np.ptp(damping, axis=0)) < 1e-3
    assert np.max(np.ptp(frequency, axis=0)) < 1e-5


@pytest.mark.parametrize("i", range(4))
def test_the_embedded_hits_show_their_joint(i):
    """Through macroslip, beside another mode and in noise."""
    with np.load(FOLDER / f"hit{i + 1}.npz") as data:
        c = ringdown_curves(data["response"][:, 0], make_hits.SAMPLING_RATE, (85.0, 155.0))
    c = c.as_quantity("displacement")
    q, relative = np.asarray(c.amplitude), np.asarray(c.damping_std) / np.asarray(c.damping)
    # Not where amplitudes fall so fast that a line's length sees damping bend: about phi_max.
    seen = (relative < 0.1) & (relative > 0) & (q < 0.8 * make_hits.TRUTH.phi_max)
    assert seen.sum() >= 14
    f, zeta = closed_form(make_hits.TRUTH, q[seen])
    for name, truth in (("frequency", f), ("damping", zeta)):
        z = (np.asarray(getattr(c, name))[seen] - truth) / np.asarray(getattr(c, f"{name}_std"))[
            seen
        ]
        # Five deviations of chi-squared about its mean.
        assert np.sum(z**2) < z.size + 5.0 * np.sqrt(2.0 * z.size)
        assert np.max(np.abs(z)) < 4.5


# --- where a decay begins and ends ----------------------------------------------------------


def test_what_comes_before_the_hit_is_skipped():
    r = ringdown(record({"at": 0.5}), RATE, BAND)
    assert 0.5 <= r.signal_time[0] < 0.5 + SETTLED
    assert r.edges[0] == pytest.approx(r.signal_time[0] + SETTLED, abs=1.5 / RATE)
    assert_allclose(r.curves.frequency, 100.0, atol=5 * np.max(r.curves.frequency_std))


@pytest.mark.parametrize("later", [[(1.5, 1.0)], [(1.5, 0.2)], [(0.6, 0.6), (1.5, 0.5)]])
def test_the_decay_starts_after_the_last_contact(later):
    hits = [{}, *({"at": at, "amplitude": amplitude} for at, amplitude in later)]
    r = ringdown(record(*hits), RATE, BAND)
    assert 1.5 <= r.signal_time[0] < 1.5 + SETTLED
    z = (np.asarray(r.curves.damping) - 2e-3) / np.asarray(r.curves.damping_std)
    assert np.max(np.abs(z)) < 4.5


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_no_contact(seed):
    r = ringdown(record({}, noise=0.05, seconds=6.0, seed=seed), RATE, BAND)
    assert r.signal_time[0] < SETTLED


def test_the_decay_ends_before_the_noise():
    noise = 0.02
    r = ringdown(record({}, noise=noise, seconds=8.0), RATE, BAND)
    in_band = noise * np.sqrt(2.0 * (BAND[1] - BAND[0]) / RATE)
    reached = np.log(1.0 / (6.0 * in_band)) / (2.0 * np.pi * 100.0 * 2e-3)
    # Decided in windows of sixteen reciprocals of the bandwidth.
    assert r.edges[-1] == pytest.approx(reached, abs=16.0 / (BAND[1] - BAND[0]))
    assert_allclose(r.noise, in_band, rtol=0.3)


def test_start_and_end_are_honoured():
    x = record({})
    r = ringdown(x, RATE, BAND, start=0.5, end=2.0)
    assert r.signal_time[0] == 0.5
    assert r.signal_time[-1] == pytest.approx(2.0, abs=1.5 / RATE)
    assert r.edges[0] == pytest.approx(0.5 + SETTLED, abs=1.5 / RATE)
    assert r.edges[-1] == pytest.approx(2.0 - SETTLED, abs=1.5 / RATE)
    # What lies outside has no influence.
    x[: int(0.5 * RATE)] = 7.0
    x[int(2.0 * RATE) :] = -7.0
    again = ringdown(x, RATE, BAND, start=0.5, end=2.0)
    assert_allclose(again.curves.damping, r.curves.damping, rtol=1e-13)


def test_a_start_before_a_second_contact_is_the_users_choice():
    x = record({}, {"at": 2.0})
    assert ringdown(x, RATE, BAND, end=1.9).edges[-1] < 1.9
    assert ringdown(x, RATE, BAND).edges[0] > 2.0


# --- the result ----------------------------------------------------------------------------


def test_the_result_is_consistent_with_itself():
    x = record({"at": 0.2, "amplitude": 3.0})
    r = ringdown(x, RATE, BAND, "velocity", unit="m/s", name="mode 1")
    c = r.curves
    assert (c.quantity, c.unit, c.name, r.band) == ("velocity", "m/s", "mode 1", BAND)
    assert_allclose(r.time, 0.5 * (r.edges[1:] + r.edges[:-1]), atol=1.0 / RATE)
    assert np.all(np.diff(r.edges) > 0)
    at_middle = np.exp(np.interp(r.time, r.signal_time, np.log(r.envelope)))
    assert_allclose(c.amplitude, at_middle, rtol=0.02)
    # The struck mode has its amplitude at its own time, whatever the filter does there.
    assert_allclose(c.amplitude, 3.0 * np.exp(-2.0 * np.pi * 0.2 * (r.time - 0.2)), rtol=0.01)
    curves = ringdown_curves(x, RATE, BAND, quantity="velocity", unit="m/s", name="mode 1")
    assert np.array_equal(curves.damping, c.damping)


def test_a_channel_in_other_units_gives_the_same_curves():
    x = record({})
    one, other = (ringdown_curves(factor * x, RATE, BAND) for factor in (1.0, 1e-6))
    assert_allclose(other.amplitude, 1e-6 * np.asarray(one.amplitude), rtol=1e-9)
    assert_allclose(other.damping, one.damping, rtol=1e-9)
    assert_allclose(other.frequency_std, one.frequency_std, rtol=1e-6)


def test_intervals_are_as_long_as_the_precision_needs():
    x = record({}, noise=5e-3)
    coarse, fine = (ringdown(x, RATE, BAND, precision=p) for p in (0.01, 0.1))
    assert coarse.time.size < fine.time.size
    assert np.median(coarse.curves.damping_std) < np.median(fine.curves.damping_std)


# --- what is refused -------------------------------------------------------------------------


def with_nan():
    x = record({})
    x[7] = np.nan
    return x


T = np.arange(8000) / RATE
REFUSED = {
    "noise only": (record(), {}, "nothing stands out of the noise"),
    "no mode in the band": (record({}), {"band": (300.0, 500.0)}, "nothing stands out"),
    "stationary sine": (np.cos(200.0 * np.pi * T), {}, "ringdown: "),
    "growing": (np.exp(0.5 * T) * np.cos(200.0 * np.pi * T), {}, "ringdown: "),
    "two modes 10 Hz apart": (record({}, {"frequency": 110.0, "amplitude": 0.5}), {}, "ringdown: "),
    "two modes 20 Hz apart": (record({}, {"frequency": 120.0, "amplitude": 0.5}), {}, "ringdown: "),
    "few samples": (record({})[:50], {}, "50 samples; expected at least 64"),
    "too short for the filter": (record({})[:300], {}, "too short for the band"),
    "too short for three": (record({})[:700], {}, "too short for three intervals"),
    "band too narrow": (record({}), {"band": (99.0, 101.0)}, "widen the band"),
    "NaN": (with_nan(), {}, "1 NaN or infinite value.*sample 7"),
    "two axes": (record({})[:, None], {}, r"shape \(8000, 1\); expected one channel"),
    "text": (["a"] * 100, {}, "row of real numbers"),
    "dead": (np.full(500, 3.0), {}, "3 throughout"),
    "clipped": (np.clip(record({}, noise=0.0), -0.5, 0.5), {}, "clipped"),
    "beyond Nyquist": (record({}), {"band": (90.0, 1200.0)}, "Nyquist"),
    "quantity": (record({}), {"quantity": "speed"}, "quantity = 'speed'"),
    "precision": (record({}), {"precision": 0.0}, "precision = 0"),
    "start outside": (record({}), {"start": 9.0}, "start = 9 s lies outside"),
    "end outside": (record({}), {"end": -1.0}, "end = -1 s lies outside"),
    "end before start": (record({}), {"start": 2.0, "end": 1.0}, "too short"),
}


@pytest.mark.parametrize(("signal", "options", "message"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_free_decay_is_refused_in_one_line(signal, options, message):
    with pytest.raises(ij.InputError, match=message) as caught:
        ringdown(signal, RATE, **({"band": BAND} | options))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("apart", "share"),
    [
        (2.0, 0.5),
        (2.0, 0.1),
        pytest.param(
            5.0,
            0.5,
            marks=pytest.mark.xfail(
                strict=True, reason="the intervals average over this beat: taken for one mode"
            ),
        ),
    ],
)
def test_modes_that_beat_slowly_are_refused_too(apart, share):
    x = record({}, {"frequency": 100.0 + apart, "amplitude": share})
    with pytest.raises(ij.InputError):
        ringdown(x, RATE, BAND)


@pytest.mark.parametrize("order", [0, -1])
def test_an_order_that_no_filter_has_is_refused(order):
    with pytest.raises(ij.InputError, match="order"):
        ringdown(record({}), RATE, BAND, order=order)


# --- measured ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def beam(reference_data):
    """The hammer hit on the Brake-Reuss beam at Rice: sampling rate and three accelerations."""
    file = reference_data / "brb_rice" / "HammerImpact.mat"
    data = scipy.io.loadmat(file, squeeze_me=True, struct_as_record=False)["HIdata"]
    return 1.0 / (data.time[1] - data.time[0]), (data.acc1, data.acc2, data.acc3)


@pytest.fixture(scope="module")
def channels(beam):
    rate, signals = beam
    return [
        [ringdown(x, rate, band, "acceleration", unit="m/s^2") for x in signals]
        for band in ((60.0, 105.0), (250.0, 350.0))
    ]


def read(curves, amplitude):
    """Frequency and damping at an amplitude."""
    x = np.log(np.asarray(curves.amplitude))[::-1]
    return tuple(
        np.interp(np.log(amplitude), x, np.asarray(y)[::-1])
        for y in (curves.frequency, curves.damping)
    )


@pytest.mark.parametrize(
    ("amplitude", "frequency", "damping"), [(0.56, 80.587, 1.41e-3), (16.0, 80.406, 2.33e-3)]
)
def test_the_beams_first_mode(channels, amplitude, frequency, damping):
    f, zeta = read(channels[0][2].curves, amplitude)
    assert f == pytest.approx(frequency, abs=0.01)
    assert zeta == pytest.approx(damping, rel=0.05)


def test_three_channels_see_the_same_frequency_at_the_same_time(channels):
    """At the times of the one with the fewest levels; the others in between."""
    sparse = channels[0][1]
    others = [channels[0][i] for i in (0, 2)]
    inside = (sparse.time > max(r.time[0] for r in others)) & (
        sparse.time < min(r.time[-1] for r in others)
    )
    assert inside.sum() > 20
    t = sparse.time[inside]
    f = [np.interp(t, r.time, np.asarray(r.curves.frequency)) for r in (sparse, *others)]
    assert np.max(np.ptp(f, axis=0)) < 0.005


def test_the_beams_second_mode(channels):
    """297.51 Hz at 22 m/s^2 of the second channel; at the least that is known, 297.75 Hz."""
    lowest = []
    for r in channels[1]:
        c = r.curves
        known = np.asarray(c.frequency_std) < 0.02
        f, std = np.asarray(c.frequency)[known], np.asarray(c.frequency_std)[known]
        lowest.append(np.average(f[-3:], weights=std[-3:] ** -2.0))
    assert_allclose(lowest, 297.75, atol=0.03)
    f, zeta = read(channels[1][1].curves, 22.0)
    assert f == pytest.approx(297.51, abs=0.02)
    assert zeta > read(channels[1][1].curves, 1.0)[1]


@pytest.mark.parametrize("band", [(70.0, 103.0), (97.0, 140.0), (96.5, 103.5)])
def test_a_corner_beside_the_mode_takes_nothing_off_its_amplitude(band):
    """Other modes may be near; the gain at 100 Hz is 0.73, 0.96 and 1 here, and moves with it."""
    curves = ringdown_curves(flowing_signal(), RATE, band, quantity="acceleration")
    frequency, damping = flow(np.asarray(curves.amplitude))
    assert_allclose(curves.frequency, frequency, rtol=1e-4)
    assert_allclose(curves.damping, damping, rtol=0.01)
