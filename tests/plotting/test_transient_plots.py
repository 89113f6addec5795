from dataclasses import replace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

import iwanjax as ij
from iwanjax.dynamics import Energies
from iwanjax.joints.hysteresis import last_amplitude
from iwanjax.plotting import plot, plot_hysteresis, plot_transient

ELEMENT = ij.Iwan5(F_S=10.0, K_T=1.0, chi=-0.5, beta=1.0, theta=0.5)


@pytest.fixture(autouse=True)
def _leave_matplotlib_as_it_was():
    before = dict(mpl.rcParams)
    yield
    plt.close("all")
    assert dict(mpl.rcParams) == before


def transient(samples=301, joints=("J1",), sensors=3):
    """A decay; sensor i moves i + 1 times as far."""
    t = np.linspace(0.0, 10.0, samples)
    x = np.exp(-0.3 * t) * np.sin(20.0 * t)
    d = np.stack([(j + 1) * x for j in range(len(joints))], axis=1)
    decay = 1.0 - np.exp(-0.6 * t)
    energy = Energies(1.0 - decay, 0 * t, 0 * t, 1.0 + 0 * t, 0.25 * decay, 0.75 * decay, decay)
    return ij.SimulatedResponse(
        time=t,
        displacement=np.stack([(i + 1) * x for i in range(sensors)], axis=1),
        velocity=np.stack([-(i + 1) * x for i in range(sensors)], axis=1),
        acceleration=None,
        joint_force=np.tanh(3.0 * d),
        joint_deflection=d,
        energy=energy,
        error=np.array(2e-3),
        imbalance=np.array(1e-4),
        substeps=1,
        balanced=np.array(True),
        labels=joints,
        method="exact",
    )


@pytest.fixture(scope="module")
def short():
    return transient()


def drawn(figure):
    """Render, so that a layout or a label that cannot be drawn fails here."""
    assert isinstance(figure, Figure)
    figure.canvas.draw()
    return figure


def points(line):
    return np.array(line.get_xydata()).T


def test_responses_energies_and_hysteresis_are_drawn_with_units(short):
    figure = drawn(plot_transient(short, length_unit="mm", force_unit="N"))
    *responses, energies, joint = figure.axes
    assert [ax.get_ylabel() for ax in responses] == [
        f"Displacement\nsensor {i} (mm)" for i in range(3)
    ]
    assert energies.get_ylabel() == "Energy (N mm)"
    assert energies.get_xlabel() == "Time $t$ (s)"
    assert (joint.get_xlabel(), joint.get_ylabel()) == ("Deflection $d$ (mm)", "Force $F$ (N)")
    assert joint.get_title(loc="left") == "J1"
    for i, ax in enumerate(responses):
        (line,) = ax.lines
        np.testing.assert_array_equal(points(line), [short.time, short.displacement[:, i]])
    (path,) = joint.lines
    np.testing.assert_array_equal(
        points(path), [short.joint_deflection[:, 0], short.joint_force[:, 0]]
    )


def test_the_energies_add_up(short):
    energies = plot_transient(short).axes[-2]
    work, *rest = (points(line)[1] for line in energies.lines)
    assert [text.get_text() for text in energies.get_legend().get_texts()] == [
        "work",
        "held",
        "lost in joints",
        "in damping",
    ]
    np.testing.assert_allclose(sum(rest), work)
    undamped = replace(short, energy=short.energy._replace(viscous=0 * short.time))
    assert len(plot_transient(undamped).axes[-2].lines) == 3


def test_another_quantity_of_chosen_sensors_by_name(short):
    axes = plot_transient(
        short, [2, 0], labels=["left", "middle", "tip"], quantity="velocity", length_unit="m"
    ).axes
    assert [ax.get_ylabel() for ax in axes[:2]] == ["Velocity\ntip (m/s)", "Velocity\nleft (m/s)"]
    np.testing.assert_array_equal(points(axes[0].lines[0])[1], short.velocity[:, 2])
    assert len(axes) == 4


def test_of_many_those_that_move_most_are_drawn():
    axes = plot_transient(transient(sensors=7, joints=("a", "b", "c", "d"))).axes
    labels = [ax.get_ylabel() for ax in axes[:4]]
    assert labels == [f"Displacement\nsensor {i}" for i in (3, 4, 5, 6)]
    assert [ax.get_title(loc="left") for ax in axes[5:]] == ["b", "c", "d"]


def test_what_was_not_kept_is_left_out(short):
    alone = replace(short, joint_force=None, energy=None)
    assert [ax.get_ylabel() for ax in drawn(plot_transient(alone)).axes] == [
        f"Displacement\nsensor {i}" for i in range(3)
    ]
    joints = replace(short, displacement=None, velocity=None, energy=None)
    assert [ax.get_ylabel() for ax in drawn(plot_transient(joints)).axes] == ["Force $F$"]


def test_a_million_samples_keep_their_peaks_and_become_few_points():
    long = transient(1_000_001)
    wild = np.array(long.displacement)
    wild[123_457, 0], wild[765_432, 0] = 9.0, -8.0
    long = replace(long, displacement=wild)
    figure = drawn(plot_transient(long))
    # Two for each of some 1000 columns of pixels, and the cloud of the hysteresis.
    assert max(len(line.get_xdata()) for ax in figure.axes for line in ax.lines) <= 12_000
    t, x = points(figure.axes[0].lines[0])
    assert t.size <= 2400
    assert np.all(np.diff(t) >= 0)
    assert t[np.argmax(x)] == long.time[123_457]
    assert t[np.argmin(x)] == long.time[765_432]
    assert (np.max(x), np.min(x)) == (9.0, -8.0)
    assert t[0] < 0.02
    assert t[-1] > 9.98


def test_long_hysteresis_shows_its_largest_and_its_last_loops():
    long = transient(200_001)
    cloud, largest, last = (points(line) for line in plot_transient(long).axes[-1].lines)
    d = long.joint_deflection[:, 0]
    assert largest[0].max() == pytest.approx(d.max(), rel=1e-3)
    assert np.abs(last[0]).max() < 0.1 * d.max()
    assert last[0][-1] == d[-1]
    assert max(largest.shape[1], last.shape[1]) <= 3001
    # The points are of the history.
    np.testing.assert_allclose(cloud[1], np.tanh(3.0 * cloud[0]), rtol=1e-12)


def test_what_follows_a_lost_balance_is_not_drawn(short):
    lost = np.array(short.displacement)
    lost[100:] = np.nan
    figure = drawn(plot_transient(replace(short, displacement=lost)))
    assert len(figure.axes) == 5
    long = transient(100_001)
    lost, d = np.array(long.displacement), np.array(long.joint_deflection)
    lost[50_000:], d[50_000:] = np.nan, np.nan
    figure = drawn(plot_transient(replace(long, displacement=lost, joint_deflection=d)))
    _, largest, _ = (points(line) for line in figure.axes[-1].lines)
    assert largest[0].max() == pytest.approx(np.nanmax(d), rel=1e-3)
    t, x = points(figure.axes[0].lines[0])
    assert np.nanmax(x) == np.nanmax(lost[:, 0])
    assert t[np.isfinite(x)].max() == pytest.approx(5.0, abs=0.02)


REFUSED = {
    "something else": (lambda short: (short.time,), {}, "expects a SimulatedResponse, got"),
    "a batch": (
        lambda short: (replace(short, balanced=np.array([True, True])),),
        {},
        "one case; this is a batch of 2",
    ),
    "nothing": (
        lambda short: (
            replace(short, displacement=None, velocity=None, joint_force=None, energy=None),
        ),
        {},
        "nothing was kept",
    ),
    "no such quantity": (
        lambda short: (short,),
        {"quantity": "acceleration"},
        "'acceleration'; expected one of displacement, velocity",
    ),
    "no such sensor": (lambda short: (short, [3]), {}, "sensor 3; expected 0 to 2"),
    "labels": (lambda short: (short,), {"labels": ["a"]}, "1 labels; expected 3"),
}


@pytest.mark.parametrize(("arguments", "options", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_drawn_is_refused(short, arguments, options, message):
    before = plt.get_fignums()
    with pytest.raises(ij.InputError, match=message):
        plot_transient(*arguments(short), **options)
    assert plt.get_fignums() == before


def cycles(amplitude=15.0, count=2):
    return amplitude * np.sin(np.linspace(0.0, 2.0 * np.pi * count, 100 * count + 1))


def test_a_driven_element_beside_its_closed_forms():
    d = cycles()
    force = np.asarray(ij.hysteresis(ELEMENT, d))
    figure = drawn(plot_hysteresis(d, force, ELEMENT, length_unit="mm", force_unit="N"))
    (ax,) = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Deflection $d$ (mm)", "Force $F$ (N)")
    path, virgin, loop = (points(line) for line in ax.lines)
    np.testing.assert_array_equal(path, [d, force])
    np.testing.assert_allclose(virgin[1], ELEMENT.backbone(virgin[0]), rtol=1e-12)
    assert [np.max(loop[0]), np.min(loop[0])] == pytest.approx([15.0, -15.0])
    np.testing.assert_allclose(loop, ELEMENT.loop(15.0), atol=1e-12)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "path",
        "virgin curve",
        "steady loop, $d_0 =$ 15 mm",
    ]


def test_a_path_alone():
    d = cycles()
    (ax,) = drawn(plot_hysteresis(d, d**2)).axes
    assert len(ax.lines) == 1
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Deflection $d$", "Force $F$")


@pytest.mark.parametrize(
    ("d", "expected"),
    [
        ([0.0, 1.0, 2.0], 1.0),
        ([0.0, 2.0, 2.0, -2.0], 2.0),
        ([0.0, 5.0, -5.0, 3.0, -1.0, 1.0], 2.0),
        ([3.0, 3.0], 0.0),
        ([3.0], 0.0),
    ],
)
def test_the_last_amplitude(d, expected):
    assert last_amplitude(np.array(d)) == expected


@pytest.mark.parametrize(
    ("d", "force"), [([0.0, 1.0], [0.0]), ([[0.0]], [[0.0]]), ([], []), ([0.0, np.nan], [0.0, 1.0])]
)
def test_histories_that_do_not_match_are_refused(d, force):
    before = plt.get_fignums()
    with pytest.raises(ij.InputError, match=r"expected \(N,\) both|d holds 1 NaN"):
        plot_hysteresis(d, force)
    assert plt.get_fignums() == before


def test_plot_knows_it(short):
    assert len(plot(short).axes) == 5
    assert plot_transient is plot_transient
    assert plot_hysteresis is plot_hysteresis


def test_the_style_does_not_depend_on_global_settings(short):
    with mpl.rc_context({"xtick.labelsize": 20, "lines.linewidth": 9}):
        axes = drawn(plot_transient(short)).axes
        assert all(line.get_linewidth() < 2 for ax in axes for line in ax.lines)
        assert all(label.get_fontsize() == 7.0 for label in axes[-1].get_xticklabels())
