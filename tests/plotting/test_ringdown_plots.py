from dataclasses import replace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import iwanjax as ij
from iwanjax.plotting import plot, plot_contents, plot_merged, plot_ringdown
from iwanjax.signals import file_contents
from iwanjax.signals.hilbert import ringdown
from iwanjax.signals.merge import merge_curves

RATE, BAND = 2000.0, (70.0, 140.0)


@pytest.fixture(autouse=True)
def _leave_matplotlib_as_it_was():
    before = dict(mpl.rcParams)
    yield
    plt.close("all")
    assert dict(mpl.rcParams) == before


def hit(seed, amplitude=1.0):
    t = np.arange(8000) / RATE
    x = amplitude * np.exp(-1.2 * t) * np.cos(200.0 * np.pi * t)
    noise = 5e-3 * np.random.default_rng(seed).standard_normal(t.size)
    return ringdown(x + noise, RATE, BAND, unit="m/s", name="mode 1")


@pytest.fixture(scope="module")
def result():
    return hit(0)


@pytest.fixture(scope="module")
def merged():
    return merge_curves([hit(i, amplitude).curves for i, amplitude in enumerate((1.0, 0.8, 0.5))])


def drawn(figure):
    """Render, so that a layout or a label that cannot be drawn fails here."""
    assert isinstance(figure, Figure)
    figure.canvas.draw()
    return figure


def points(line):
    return np.array(line.get_xydata()).T


def texts(legend):
    return [text.get_text() for text in legend.get_texts()]


def test_a_ring_down_is_drawn_over_time_with_units(result):
    figure = drawn(plot_ringdown(result))
    upper, middle, lower = figure.axes
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "Velocity amplitude (m/s)",
        "Frequency $f$ (Hz)",
        r"Damping ratio $\zeta$ (–)",
    ]
    assert lower.get_xlabel() == "Time $t$ (s)"
    assert upper.get_yscale() == "log"
    assert upper.get_xlim() == middle.get_xlim() == lower.get_xlim()
    assert texts(figure.legends[0]) == [
        "fit at midpoints",
        "band-passed signal",
        "noise in the band",
        "not used",
    ]


def test_the_points_are_the_curves_at_their_midpoints(result):
    upper, middle, lower = plot_ringdown(result).axes
    _, fitted, noise = map(points, upper.lines)
    np.testing.assert_array_equal(fitted, [result.time, result.curves.amplitude])
    np.testing.assert_array_equal(noise, [result.time, result.noise])
    for ax, name in ((middle, "frequency"), (lower, "damping")):
        (bars,) = [c for c in ax.containers if isinstance(c, ErrorbarContainer)]
        value, std = (np.asarray(getattr(result.curves, n)) for n in (name, f"{name}_std"))
        np.testing.assert_array_equal(points(bars[0]), [result.time, value])
        (segments,) = [np.array(lines.get_segments()) for lines in bars[2]]
        np.testing.assert_allclose(segments[:, :, 1], np.stack([value - std, value + std], axis=1))
        # All is seen.
        low, high = ax.get_ylim()
        assert np.all((value - std > low) & (value + std < high))


def test_the_instantaneous_frequency_lies_about_the_points(result):
    t, f = points(plot_ringdown(result).axes[1].lines[0])
    early = (t > result.edges[0]) & (t < result.edges[0] + 0.3)
    assert np.mean(f[early]) == pytest.approx(100.0, abs=0.05)


def test_what_was_not_used_is_shaded(result):
    ends = (result.signal_time[0], result.edges[0], result.edges[-1], result.signal_time[-1])
    for ax in plot_ringdown(result).axes:
        spans = [patch for patch in ax.patches if isinstance(patch, Rectangle)]
        drawn_ends = [x for p in spans for x in (p.get_x(), p.get_x() + p.get_width())]
        np.testing.assert_allclose(drawn_ends, ends)


def test_a_point_that_is_not_known_does_not_stretch_the_axis(result):
    damping, std = (np.array(getattr(result.curves, n)) for n in ("damping", "damping_std"))
    damping[-1], std[-1] = -0.5, 0.7
    wild = replace(result, curves=replace(result.curves, damping=damping, damping_std=std))
    low, high = drawn(plot_ringdown(wild)).axes[2].get_ylim()
    assert 0.0 < low < high < 0.01


def test_a_ring_down_without_noise_is_drawn():
    t = np.arange(8000) / RATE
    clean = ringdown(np.exp(-1.2 * t) * np.cos(200.0 * np.pi * t), RATE, BAND)
    assert drawn(plot_ringdown(clean)).axes[0].get_ylabel() == "Velocity amplitude"


def test_merged_hits_are_drawn_with_units(merged):
    figure = drawn(plot_merged(merged))
    upper, middle, lower = figure.axes
    assert lower.get_xlabel() == "Velocity amplitude (m/s)"
    assert [ax.get_ylabel() for ax in (upper, middle)] == [
        "Frequency $f$ (Hz)",
        r"Damping ratio $\zeta$ (–)",
    ]
    assert (upper.get_xscale(), middle.get_yscale(), lower.get_yscale()) == ("log",) * 3
    assert [texts(legend) for legend in figure.legends] == [
        ["common curve", "3 hits", r"next hit, $\pm\sigma$, $\pm 2\sigma$"],
        ["frequency", "damping", "hit to hit", "noise"],
    ]


def test_every_hit_and_the_common_curve_are_there(merged):
    upper, middle, _ = plot_merged(merged).axes
    for ax, name in ((upper, "frequency"), (middle, "damping")):
        *hits, common = map(points, ax.lines)
        assert len(hits) == 3
        for (x, y), curves in zip(hits, merged.hits, strict=True):
            known = np.isfinite(y)
            assert known.any()
            np.testing.assert_array_equal(x, curves.amplitude)
            np.testing.assert_array_equal(y[known], np.asarray(getattr(curves, name))[known])
        np.testing.assert_array_equal(
            common, [merged.curves.amplitude, getattr(merged.curves, name)]
        )
        # Bands of two deviations and of one.
        wide, narrow = (
            np.ptp(np.asarray(band.get_paths()[0].vertices)[:, 1]) for band in ax.collections
        )
        assert wide > narrow


def test_the_deviations_are_taken_apart(merged):
    lower = plot_merged(merged).axes[2]
    kinds = [(n, k) for n in ("frequency", "damping") for k in ("repeatability", "estimator")]
    assert [line.get_linestyle() for line in lower.lines] == ["-", "--", "-", "--"]
    for line, (name, kind) in zip(lower.lines, kinds, strict=True):
        share = getattr(merged, f"{name}_{kind}") / np.asarray(getattr(merged.curves, name))
        np.testing.assert_allclose(points(line)[1], np.where(share > 0, share, np.nan))


def test_plot_knows_both(result, merged):
    assert plot(result).axes[2].get_xlabel() == "Time $t$ (s)"
    assert len(plot(merged).legends) == 2
    assert plot_ringdown is plot_ringdown
    assert plot_merged is plot_merged


@pytest.mark.parametrize(
    ("draw", "message"), [(plot_ringdown, "expects a RingDown"), (plot_merged, "expects Merged")]
)
def test_other_objects_are_refused(result, draw, message):
    before = plt.get_fignums()
    with pytest.raises(ij.InputError, match=f"{message}.*ModalCurves"):
        draw(result.curves)
    assert plt.get_fignums() == before


def test_the_style_does_not_depend_on_global_settings(result):
    with mpl.rc_context({"xtick.labelsize": 20, "lines.linewidth": 9}):
        axes = drawn(plot_ringdown(result)).axes
        assert all(line.get_linewidth() < 2 for ax in axes for line in ax.lines)
        assert all(label.get_fontsize() == 7.0 for label in axes[2].get_xticklabels())


def test_a_sine_has_its_own_amplitude_in_the_spectrum(tmp_path):
    """It was drawn at half of it: a Hann window lets half of a sine through."""
    t = np.arange(4096) / 1024.0
    np.savez(tmp_path / "sine.npz", time=t, tip=3.0 * np.sin(200.0 * np.pi * t))
    _, right = drawn(plot_contents(file_contents(tmp_path / "sine.npz"))).axes
    frequency, amplitude = points(right.lines[0])
    assert frequency[np.argmax(amplitude)] == pytest.approx(100.0)
    assert np.max(amplitude) == pytest.approx(3.0, rel=1e-3)
