import re
import subprocess
import sys
from dataclasses import replace

import jax
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Annotation

import iwanjax as ij
from iwanjax.plotting import plot, plot_curves, plot_joint, plot_qsma
from iwanjax.plotting.style import PALETTE, paper_style

IWAN = {"F_S": 10.0, "K_T": 1.0, "chi": -0.5, "beta": 5.0}
LOSSY = {
    "Iwan4": ij.Iwan4(**IWAN),
    "Iwan5": ij.Iwan5(**IWAN, theta=0.3),
    "Jenkins": ij.Jenkins(F_S=10.0, K_T=2.0),
}
ELASTIC = {
    "LinearSpring": ij.LinearSpring(k=2.0),
    "CubicSpring": ij.CubicSpring(k3=3.0),
    "Gap": ij.Gap(k=1e4, gap=0.02),
    "closed gap": ij.Gap(k=1e4, gap=0.0),
}


@pytest.fixture(autouse=True)
def _leave_matplotlib_as_it_was():
    before = dict(mpl.rcParams)
    yield
    plt.close("all")
    assert dict(mpl.rcParams) == before


@pytest.fixture(scope="module")
def solution():
    return ij.qsma(ij.three_mass(), [0, 1, 2], np.geomspace(1e-2, 1e3, 60), zeta0=1e-4)


@pytest.fixture
def curves():
    q = np.geomspace(1e-3, 1.0, 30)
    f, zeta = 100.0 - q, 1e-3 * (1.0 + q)
    f[7] = np.nan
    return ij.ModalCurves(
        q,
        f,
        zeta,
        amplitude_std=0.05 * q,
        frequency_std=np.full(30, 0.1),
        damping_std=0.7 * zeta,
        quantity="velocity",
        unit="mm/s",
        name="measured",
    )


def labels(figure):
    return {label for ax in figure.axes for label in (ax.get_xlabel(), ax.get_ylabel()) if label}


def points(line):
    """The line's (x, y) as arrays."""
    return np.array(line.get_xydata()).T


def drawn(figure):
    """Render, so that a layout or a label that cannot be drawn fails here."""
    assert isinstance(figure, Figure)
    figure.canvas.draw()
    return figure


@pytest.mark.parametrize("joint", [*LOSSY.values(), *ELASTIC.values()], ids=[*LOSSY, *ELASTIC])
def test_a_joint_is_drawn_with_units(joint):
    figure = drawn(plot_joint(joint, length_unit="mm", force_unit="N"))
    expected = {
        "Deflection $d$ (mm)",
        "Force $F$ (N)",
        "Amplitude $d_0$ (mm)",
        "Secant stiffness $K$ (N/mm)",
    }
    if joint in LOSSY.values():
        expected |= {"Dissipation $D$ (N mm)"}
    assert labels(figure) == expected


def test_units_that_are_not_known_are_left_out():
    assert not any("(" in label for label in labels(plot_joint(LOSSY["Iwan4"])))


@pytest.mark.parametrize("joint", LOSSY.values(), ids=LOSSY)
def test_the_loop_at_macroslip_touches_the_backbone(joint):
    lines = {str(line.get_label()): points(line) for line in plot_joint(joint).axes[0].lines}
    (loop,) = [line for label, line in lines.items() if label.startswith("$d_0 =$$1\\,")]
    d, force = lines["backbone"]
    tip = np.argmax(loop[0])
    assert loop[1, tip] == pytest.approx(np.interp(loop[0, tip], d, force))


@pytest.mark.parametrize(("name", "slope"), [("Iwan4", "2.5"), ("Iwan5", "2.5"), ("Jenkins", "")])
def test_the_slope_of_microslip_is_marked_for_iwan_joints(name, slope):
    texts = " ".join(text.get_text() for ax in plot_joint(LOSSY[name]).axes for text in ax.texts)
    assert re.findall(r"slope \$\\chi\+3 = ([\d.]+)\$", texts) == ([slope] if slope else [])


def test_amplitudes_below_macroslip_leave_it_out():
    figure = drawn(plot_joint(LOSSY["Iwan4"], [0.01, 0.1, 1.0], length_unit="mm"))
    legend = figure.axes[0].get_legend()
    assert legend is not None
    shown = [text.get_text() for text in legend.get_texts()]
    assert shown == ["$d_0 =$0.333 mm", "$d_0 =$0.667 mm", "$d_0 =$1 mm", "backbone"]
    assert all(ax.get_xlim()[1] < LOSSY["Iwan4"].phi_max for ax in figure.axes)


@pytest.mark.parametrize(
    ("joint", "amplitudes", "message"),
    [
        (ij.Dashpot(c=1.0), None, "no quasi-static loop.*depends on rate"),
        (ij.Jenkins(F_S=[1.0, 2.0], K_T=1.0), None, "carries a batch"),
        (LOSSY["Jenkins"], [0.0, 1.0], "positive"),
        (LOSSY["Jenkins"], 1.0, "two or more"),
    ],
)
def test_what_a_joint_cannot_show_is_refused(joint, amplitudes, message):
    before = plt.get_fignums()
    with pytest.raises(ij.InputError, match=message):
        plot_joint(joint, amplitudes)
    assert plt.get_fignums() == before


@pytest.mark.parametrize("shift", [False, True])
def test_curves_carry_the_quantity_and_unit_of_their_amplitude(curves, shift):
    figure = drawn(plot_curves(curves, shift=shift))
    frequency = r"Frequency shift $\Delta f$ (Hz)" if shift else "Frequency $f$ (Hz)"
    assert labels(figure) == {
        "Velocity amplitude (mm/s)",
        frequency,
        r"Damping ratio $\zeta$ (–)",
    }
    upper, lower = figure.axes
    assert (upper.get_yscale(), lower.get_yscale()) == ("linear", "log")
    assert upper.get_xlim() == lower.get_xlim()


def test_a_shift_starts_at_the_lowest_amplitude_that_is_known(curves):
    frequency = np.array(curves.frequency)
    frequency[0] = np.nan
    falling = jax.tree.map(lambda x: x[::-1], replace(curves, frequency=frequency))
    _, y = points(plot_curves(falling, shift=True).axes[0].lines[0])
    assert np.isnan(y[-1])
    assert y[-2] == 0.0
    assert y[0] == pytest.approx(frequency[-1] - frequency[1])


def test_one_and_two_deviations_are_shaded_and_stay_on_the_axis(curves):
    upper, lower = drawn(plot_curves(curves)).axes
    # Two bands and the amplitude's bars; the missing level splits no collection.
    assert len(upper.collections) == len(lower.collections) == 3
    # Two deviations reach below zero here.
    assert lower.get_ylim()[0] == pytest.approx(1e-4 * (1 + 1e-3), rel=1e-6)


def test_several_curves_are_told_apart_by_name(curves):
    figure = drawn(plot_curves([curves, replace(curves, name="")]))
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["measured", "curve 2"]
    colors = [line.get_color() for line in figure.axes[0].lines if points(line).shape[1] == 30]
    assert colors == list(PALETTE[:2])


def test_a_batch_is_drawn_as_thin_lines(curves):
    batch = jax.tree.map(lambda x: np.stack([x, x, x])[:, None], curves)
    upper, lower = drawn(plot_curves(batch)).axes
    assert len(upper.lines) == len(lower.lines) == 3
    assert not upper.collections


@pytest.mark.parametrize(
    ("change", "message"), [({"unit": "m/s"}, "different amplitudes.*m/s"), (None, "expects Modal")]
)
def test_curves_that_do_not_fit_together_are_refused(curves, change, message):
    other = replace(curves, **change) if change else LOSSY["Iwan4"]
    with pytest.raises(ij.InputError, match=message):
        plot_curves([curves, other])


def test_no_curves_are_refused():
    with pytest.raises(ij.InputError, match="nothing to draw"):
        plot_curves([])


def test_qsma_has_a_column_for_each_mode(solution):
    figure = drawn(plot_qsma(solution))
    assert len(figure.axes) == 9
    assert labels(figure) == {
        "Modal displacement amplitude",
        "Frequency $f$ (Hz)",
        r"Damping ratio $\zeta$ (–)",
        "Share $|q_k/q_r|$ (–)",
    }
    assert [ax.get_title() for ax in figure.axes[:3]] == ["Mode 0", "Mode 1", "Mode 2"]


def test_macroslip_is_marked_where_the_joint_reaches_it(solution):
    figure = plot_qsma(solution)
    d = np.abs(np.asarray(solution.deflection))[..., 0]
    for r in range(3):
        (text,) = figure.axes[r].texts
        assert isinstance(text, Annotation)
        assert text.get_text() == "macroslip J1"
        after = np.argmax(d[r] >= 11.25)
        assert solution.q[r, after - 1] < text.xy[0] <= solution.q[r, after]


def test_joints_that_slip_together_share_a_mark():
    row = np.array([0.0, -1.0, 1.0])
    joint = ij.Jenkins(F_S=1.0, K_T=0.5)
    js = ij.JointedStructure(
        ij.three_mass().structure,
        {"left": (row, joint), "right": (row, joint), "stop": (row, ij.Gap(k=0.1, gap=20.0))},
    )
    figure = drawn(plot_qsma(ij.qsma(js, 1, np.geomspace(1e-2, 1e3, 60))))
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == ["macroslip left, right", "contact stop"]


def test_shares_that_are_not_known_are_left_out():
    js, alpha = ij.three_mass(), np.geomspace(1e-2, 1.0, 5)
    stiffer = js.with_joints({"J1": ij.Iwan4(**{**IWAN, "K_T": 1.1})})
    assert len(plot_qsma(ij.qsma(js, 1, alpha)).axes) == 3
    assert len(plot_qsma(ij.qsma(js, 1, alpha, deflections=False)).axes) == 2
    assert len(plot_qsma(ij.qsma(stiffer, 1, alpha)).axes) == 2
    single = ij.oscillator(stiffness=9.0, joint=LOSSY["Iwan4"])
    assert len(plot_qsma(ij.qsma(single, 0, alpha)).axes) == 2


def test_a_batch_of_parameter_sets_is_referred_to_plot_curves():
    js = ij.three_mass()
    batch = js.with_joints({"J1": ij.Iwan4(**{**IWAN, "F_S": [9.0, 10.0]})})
    with pytest.raises(ij.InputError, match="plot_curves"):
        plot_qsma(ij.qsma(batch, 1, [1.0]))


def test_plot_knows_what_suits_an_object(solution, curves):
    for obj in (LOSSY["Iwan4"], curves, solution):
        assert isinstance(plot(obj), Figure)
    assert "Force $F$ (N)" in labels(plot(LOSSY["Iwan4"], force_unit="N"))
    with pytest.raises(ij.InputError, match="no figure for a dict"):
        plot({})


def test_the_style_does_not_depend_on_global_settings(curves):
    """Ticks are made when a figure is drawn, after the style has ended."""
    with mpl.rc_context({"xtick.labelsize": 20, "axes.grid": False, "lines.linewidth": 9}):
        upper, lower = drawn(plot_curves(curves)).axes
        assert upper.lines[0].get_linewidth() < 2
        assert all(label.get_fontsize() == 7.0 for label in lower.get_xticklabels())
        assert lower.xaxis.get_gridlines()[0].get_visible()


def test_the_first_figure_of_a_notebook_may_switch_to_interactive_mode():
    """It does so while the style holds, and the figures after it depend on it."""
    assert not mpl.is_interactive()
    with paper_style():
        mpl.interactive(True)
    try:
        assert mpl.is_interactive()
    finally:
        mpl.interactive(False)


def test_plotting_is_loaded_on_demand():
    probe = (
        "import sys, iwanjax; print('matplotlib' in sys.modules, 'iwanjax.plotting' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "False"]
