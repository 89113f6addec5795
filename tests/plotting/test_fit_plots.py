import dataclasses
import subprocess
import sys
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from matplotlib.text import Annotation

import iwanjax as ij
from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.estimation.priors import LogNormal, LogUniform, Normal, Uniform
from iwanjax.plotting import plot, plot_bands, plot_fit, plot_posterior
from iwanjax.plotting.scales import Scale, symbol
from iwanjax.plotting.style import PALETTE
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.updating.estimate import fit
from iwanjax.updating.posterior import Posterior
from iwanjax.updating.problem import AbstractProblem, Measured, Reference

TRUTH = ModalOscillator(100.0, 5e-4, ij.Jenkins(F_S=0.4, K_T=2e4))
"""It slips from 2e-5 on."""


@pytest.fixture(autouse=True)
def _leave_matplotlib_as_it_was():
    before = dict(mpl.rcParams)
    yield
    plt.close("all")
    assert dict(mpl.rcParams) == before


def measured(seed, low=2e-6, high=2e-4, quantity="velocity", unit="m/s", name="mode 1"):
    """Falling amplitudes, as of a ring-down."""
    random = np.random.default_rng(seed)
    q = np.geomspace(high, low, 20)
    c = TRUTH.curves(q)
    f_std, zeta_std = 5e-3, 0.03 * np.asarray(c.damping)
    noisy = ij.ModalCurves(
        q,
        np.asarray(c.frequency) + f_std * random.standard_normal(q.size),
        np.asarray(c.damping) + zeta_std * random.standard_normal(q.size),
        frequency_std=np.full(q.size, f_std),
        damping_std=zeta_std,
        quantity="displacement",
        name=name,
    )
    return noisy.as_quantity(quantity, unit)


@pytest.fixture(scope="module")
def hits():
    return measured(0), measured(1, high=5e-5)


@pytest.fixture(scope="module")
def solution(hits):
    return fit("jenkins", hits, starts=4)


def sampled(solution, count=2000):
    """A posterior as the linearised fit has it, without a walk."""
    random = np.random.default_rng(0)
    free = list(solution.problem.chart.free)
    mean = np.array([p.value for p in solution.parameters])[free]
    draws = random.multivariate_normal(
        mean, solution.covariance[np.ix_(free, free)], count, method="eigh"
    )
    scales = np.exp(0.1 * random.standard_normal((count, 2)))
    names = (
        *(solution.parameters[i].name for i in free),
        "noise_scale_frequency",
        "noise_scale_damping",
    )
    return Posterior(
        names,
        np.concatenate([draws, scales], axis=1).reshape(count // 10, 10, -1),
        np.zeros((count // 10, 10)),
        dict.fromkeys(names, 5.0),
        dict.fromkeys(names, float(count)),
        1000,
        True,
        0.3,
        0,
        solution,
    )


@pytest.fixture(scope="module")
def posterior(solution):
    return sampled(solution)


class LineProblem(AbstractProblem):
    """Two modes whose curves are straight in the logarithm of amplitude."""

    measured: Measured
    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)

    def predict(self, theta):
        return theta[0] - theta[1] * jnp.log(self.measured.q), 1e-3 * theta[1] * self.measured.q

    def model(self, theta):
        return ij.three_mass()


def structural(solution, reference="shift", offset=0.5):
    """A fit of two modes of a structure, made by hand from another."""
    q = np.geomspace(0.1, 1.0, 8)[::-1]
    curves = [
        ij.ModalCurves(
            q,
            20.0 + offset - 0.3 * np.log(q),
            3e-4 * q,
            frequency_std=np.full(8, 0.01),
            damping_std=1e-5 * q,
            unit="mm",
            name=name,
        )
        for name in ("bending", "torsion")
    ]
    parameters = (
        Parameter("J1.a", 20.0, Normal(20.0, 5.0), unit="Hz"),
        Parameter("J1.b", 0.3, LogNormal(0.3, 1.0), lower=0.0, transform="log"),
    )
    names = ("J1.a", "J1.b")
    problem = LineProblem(Measured.of(curves), Chart(parameters), names, reference)
    theta = np.array([20.0, 0.3])
    f, zeta = problem.predict(jnp.asarray(theta))
    predicted = tuple(
        ij.ModalCurves(q, f[part], zeta[part], unit="mm", name=each.name)
        for each, part in zip(curves, problem.measured.slices, strict=True)
    )
    return dataclasses.replace(
        solution,
        parameters=parameters,
        covariance=np.diag([4.0, 1e-4]),
        derived={},
        undetermined=(),
        determined=dict.fromkeys(names, True),
        active_bounds={},
        model=problem.model(theta),
        measured=tuple(curves),
        predicted=predicted,
        problem=problem,
    )


def drawn(figure):
    """Render, so that a layout or a label that cannot be drawn fails here."""
    assert isinstance(figure, Figure)
    figure.canvas.draw()
    return figure


def points(line):
    return np.array(line.get_xydata()).T


def of_color(ax, color):
    return [points(line) for line in ax.lines if line.get_color() == color]


def band(ax):
    """Corners of the shade in a panel."""
    (area,) = [c for c in ax.collections if isinstance(c, PolyCollection)]
    return np.asarray(area.get_paths()[0].vertices)


def texts(legend):
    return [text.get_text() for text in legend.get_texts()]


def test_a_fit_is_drawn_with_units_and_residuals(solution, hits):
    figure = drawn(plot_fit(solution, [measured(2)]))
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "Frequency $f$ (Hz)",
        r"$\Delta/\sigma$ (–)",
        r"Damping ratio $\zeta$ (–)",
        r"$\Delta/\sigma$ (–)",
    ]
    assert figure.axes[3].get_xlabel() == "Velocity amplitude (m/s)"
    assert texts(figure.legends[0]) == [
        "measured, 2 hits",
        "held out",
        "model",
        r"$\pm\sigma$ of the fit",
    ]
    assert all(ax.get_xscale() == "log" for ax in figure.axes)


def test_curves_that_other_modes_were_taken_off_are_called_so(solution):
    figure = plot_fit(dataclasses.replace(solution, coupling=()))
    assert texts(figure.legends[0])[0].endswith("measured, 2 hits, less what other modes did")


def test_the_model_is_a_smooth_line_over_all_hits(solution, hits):
    held = measured(2, low=1e-6)
    upper, _, lower, _ = plot_fit(solution, [held]).axes
    ((x, f),), ((_, zeta),) = of_color(upper, PALETTE[1]), of_color(lower, PALETTE[1])
    assert x.size >= 200
    assert x[0] < np.min(held.amplitude) < np.max(hits[0].amplitude) < x[-1]
    want = solution.model.curves(np.geomspace(3e-6, 1e-4, 9)).as_quantity("velocity")
    at = np.asarray(want.amplitude)
    assert np.interp(at, x, f) == pytest.approx(np.asarray(want.frequency), rel=1e-5)
    assert np.interp(at, x, zeta) == pytest.approx(np.asarray(want.damping), rel=1e-2)


def test_residuals_are_those_of_the_problem(solution, hits):
    _, f, _, zeta = plot_fit(solution).axes
    theta = jnp.asarray([p.value for p in solution.parameters])
    for ax, want in zip((f, zeta), solution.problem.differences(theta), strict=True):
        shown = np.concatenate([points(line)[1] for line in ax.lines if line.get_marker() == "."])
        assert shown == pytest.approx(-np.asarray(want), abs=1e-6)
        levels = {float(points(line)[1, 0]) for line in ax.lines if line.get_marker() == "None"}
        assert {-2.0, -1.0, 0.0, 1.0, 2.0} <= levels


def test_the_band_is_the_spread_of_the_fit(solution):
    """Linear propagation against draws, where the parameters are well determined."""
    corners = band(plot_fit(solution).axes[0])
    x = np.unique(corners[:, 0])[10]
    ends = np.unique(corners[corners[:, 0] == x, 1])
    free = list(solution.problem.chart.free)
    theta = np.array([p.value for p in solution.parameters])
    random = np.random.default_rng(0)
    f = []
    for _ in range(400):
        draw = theta.copy()
        draw[free] = random.multivariate_normal(theta[free], solution.covariance[free][:, free])
        model = solution.problem.model(jnp.asarray(draw))
        omega = 2.0 * np.pi * float(solution.model.f_0)
        f.append(float(model.frequency_and_damping(x / omega)[0]))
    assert np.ptp(ends) / 2.0 == pytest.approx(np.std(f), rel=0.2)


def test_macroslip_is_marked_where_it_is_near(solution, hits):
    slip = float(solution.model.joint.F_S / solution.model.joint.K_T)
    figure = plot_fit(solution)
    (mark,) = figure.axes[0].texts
    assert isinstance(mark, Annotation)
    assert mark.get_text() == "macroslip"
    at = float(solution.model.curves([slip]).as_quantity("velocity").amplitude[0])
    assert mark.xy[0] == pytest.approx(at)
    several = dataclasses.replace(solution, rivals={"F_S": (0.1, 0.4)})
    assert not plot_fit(several).axes[0].texts
    low = dataclasses.replace(solution, measured=(measured(0, high=6e-6),))
    low = dataclasses.replace(low, predicted=low.measured)
    assert not plot_fit(low).axes[0].texts


def test_damping_is_logarithmic_only_where_it_spans_much(solution):
    assert plot_fit(solution).axes[2].get_yscale() == "log"
    little = measured(0, low=1e-6, high=1.5e-5)
    same = dataclasses.replace(solution, measured=(little,), predicted=(little,))
    assert plot_fit(same).axes[2].get_yscale() == "linear"


def test_points_that_are_hardly_known_do_not_stretch_the_axis(solution, hits):
    def wild(curve):
        arrays = {"damping": curve.damping.at[-1].set(3.0)}
        arrays["damping_std"] = curve.damping_std.at[-1].set(5.0)
        return eqx.tree_at(
            lambda c: (c.damping, c.damping_std), curve, (arrays["damping"], arrays["damping_std"])
        )

    before = plot_fit(solution).axes[2].get_ylim()
    changed = dataclasses.replace(solution, measured=(wild(hits[0]), hits[1]))
    assert drawn(plot_fit(changed)).axes[2].get_ylim()[1] < 2.0 * before[1]


def test_held_out_hits_without_deviations_have_no_residuals(solution):
    held = measured(2)
    bare = ij.ModalCurves(
        held.amplitude, held.frequency, held.damping, quantity="velocity", unit="m/s"
    )
    upper, residual, _, _ = drawn(plot_fit(solution, [bare])).axes
    assert len(of_color(upper, PALETTE[2])) == 1
    assert not of_color(residual, PALETTE[2])


def test_a_structure_has_a_column_for_each_mode(solution):
    solution = structural(solution, "absolute")
    (held,) = [curve for curve in solution.measured if curve.name == "torsion"]
    figure = drawn(plot_fit(solution, [held]))
    assert len(figure.axes) == 8
    assert [ax.get_title() for ax in figure.axes[:2]] == ["bending", "torsion"]
    assert not of_color(figure.axes[0], PALETTE[2])
    assert len(of_color(figure.axes[1], PALETTE[2])) == 1
    ((x, f),) = of_color(figure.axes[0], PALETTE[1])
    assert np.all(np.diff(x) > 0)
    assert f == pytest.approx(20.0 - 0.3 * np.log(x))


def test_a_shift_is_shown_where_offsets_are_free(solution):
    """Neither the offset nor what is not known of it, which is large here, is to be seen."""
    figure = drawn(plot_fit(structural(solution, "shift", offset=0.5)))
    top, residual = figure.axes[0], figure.axes[2]
    assert top.get_ylabel() == r"Frequency shift $\Delta f$ (Hz)"
    assert top.get_ylim()[1] < 0.1
    assert np.ptp(top.get_ylim()) < 1.0
    (shown,) = [points(line)[1] for line in residual.lines if line.get_marker() == "."]
    assert shown == pytest.approx(np.zeros(8), abs=1e-6)
    assert np.ptp(band(top)[:, 1]) < 1.0


@pytest.mark.parametrize(
    ("held", "message"),
    [
        (measured(2, quantity="acceleration"), "Acceleration amplitude.*Velocity amplitude"),
        ("hit.npz", "holds a str"),
    ],
)
def test_held_out_hits_that_do_not_fit_are_refused(solution, held, message):
    with pytest.raises(ij.InputError, match=message):
        plot_fit(solution, [held])


def test_a_held_out_hit_of_no_mode_is_refused(solution):
    solution = structural(solution)
    ours = solution.measured[0]
    stranger = ij.ModalCurves(ours.amplitude, ours.frequency, ours.damping, unit="mm", name="axial")
    with pytest.raises(ij.InputError, match=r"'axial'.*bending, torsion"):
        plot_fit(solution, [stranger])


def test_what_is_no_fit_is_refused(hits):
    with pytest.raises(ij.InputError, match="expects a FitSolution, got ModalCurves"):
        plot_fit(hits[0])
    for draw in (plot_posterior, plot_bands):
        with pytest.raises(ij.InputError, match="expected a Posterior, got ModalCurves"):
            draw(hits[0])


def test_a_posterior_without_draws_is_refused(posterior):
    empty = dataclasses.replace(posterior, chain=posterior.chain[:0])
    with pytest.raises(ij.InputError, match="no draws"):
        plot_posterior(empty)


def test_the_corner_has_every_pair_once(posterior):
    figure = drawn(plot_posterior(posterior))
    count = len(posterior.names)
    assert len(figure.axes) == count * (count + 1) // 2
    below = [ax.get_xlabel() for ax in figure.axes if ax.get_xlabel()]
    assert [label.split("\n")[0].split(" ")[0] for label in below] == [
        "$f_0$",
        r"$\zeta_0$",
        r"$F_{\mathrm{S}}$",
        r"$K_{\mathrm{T}}$",
        "$s_f$",
        r"$s_\zeta$",
    ]
    assert texts(figure.legends[0]) == ["68 % of the draws", "95 % of the draws", "prior", "fit"]


def test_labels_of_the_corner_stay_apart(posterior):
    figure = drawn(plot_posterior(posterior))
    bottom = [ax for ax in figure.axes if ax.get_xlabel()]
    boxes = [ax.xaxis.label.get_window_extent() for ax in bottom]
    assert all(a.x1 < b.x0 for a, b in pairwise(boxes))
    for ax in bottom:
        ticks = [text.get_window_extent() for text in ax.get_xticklabels() if text.get_text()]
        assert 1 <= len(ticks) <= 6
        assert ax.xaxis.label.get_window_extent().y1 < min(box.y0 for box in ticks) + 1.0
    assert all(figure.bbox.contains(box.x0, box.y0) for box in boxes)


def test_contours_hold_their_share_of_the_draws(posterior):
    figure = plot_posterior(posterior)
    ax = figure.axes[1]
    f, zeta = posterior.samples["f_0"], posterior.samples["zeta_0"]
    scales = [
        Scale.of(p.name, posterior.samples[p.name], p) for p in posterior.solution.parameters[:2]
    ]
    places = np.column_stack([s.of_values(v) for s, v in zip(scales, (f, zeta), strict=True)])
    (lines,) = [c for c in ax.collections if isinstance(c, ContourSet) and not c.filled]
    shares = [np.mean(path.contains_points(places)) for path in lines.get_paths()]
    assert sorted(shares) == pytest.approx([0.68, 0.95], abs=0.04)


def test_prior_and_histogram_are_densities_of_one_kind(solution):
    """A posterior that is its prior lies under the prior's line, on either kind of axis."""
    random = np.random.default_rng(1)
    solution = structural(solution)
    parameters = (
        dataclasses.replace(solution.parameters[0], prior=Normal(20.0, 1e-3)),
        solution.parameters[1],
    )
    solution = dataclasses.replace(solution, parameters=parameters)
    draws = [p.prior.draw(random, 40_000) for p in parameters]
    chain = np.column_stack([*draws, *np.ones((2, 40_000))]).reshape(4000, 10, 4)
    chain[..., 2:] *= np.exp(0.1 * random.standard_normal((4000, 10, 2)))
    names = ("J1.a", "J1.b", "noise_scale_frequency", "noise_scale_damping")
    posterior = dataclasses.replace(sampled(solution), chain=chain, names=names)
    figure = plot_posterior(posterior)
    for i in (0, 2):
        ax = figure.axes[i]
        (line,) = [line for line in ax.lines if line.get_linestyle() == "--"]
        (stairs, _) = [p for p in ax.patches if isinstance(p, StepPatch)]
        values, edges, _ = stairs.get_data()
        middles = 0.5 * (edges[1:] + edges[:-1])
        assert values == pytest.approx(
            np.interp(middles, *points(line)), abs=0.12 * float(np.max(values))
        )


@pytest.mark.parametrize(
    ("values", "parameter", "label"),
    [
        ((122.3401, 1e-4), Parameter("f_0", 122.34, Normal(1, 1), unit="Hz"), "$f_0$ $-$ 122.34"),
        ((-0.45, 1e-3), Parameter("chi", -0.45, Uniform(-1, 0)), r"$\chi$ $+$ 0.45"),
        ((3e4, 2e3), Parameter("K_T", 3e4, Uniform(1, 9), unit="N/m"), r"$K_{\mathrm{T}}$"),
        ((0.5, 0.1), Parameter("J1.beta", 0.5, Uniform(0, 9)), r"J1 $\beta$"),
    ],
)
def test_values_that_differ_in_their_last_digits_are_told_by_an_offset(values, parameter, label):
    draws = np.random.default_rng(0).normal(*values, 1000)
    scale = Scale.of(parameter.name, draws, parameter)
    assert scale.label.split("\n")[0].startswith(label)
    shown = scale.of_values(draws)
    assert scale.to_values(shown) == pytest.approx(draws)
    assert np.max(np.abs(shown)) < 1000.0
    assert not scale.logarithmic


def test_a_strength_of_unknown_size_has_a_logarithmic_axis():
    prior = LogUniform(1.0, 1e3)
    p = Parameter("F_S", 30.0, prior, unit="N", lower=0.0, transform="log")
    draws = prior.draw(np.random.default_rng(0), 5000)
    scale = Scale.of("F_S", draws, p)
    assert scale.logarithmic
    assert scale.estimate == pytest.approx(np.log10(30.0))
    assert scale.to_values(np.array(scale.estimate)) == pytest.approx(30.0)


def test_an_axis_ends_at_the_bounds():
    p = Parameter("chi", -0.01, Uniform(-1, 0), lower=-1.0, upper=0.0, transform="logit")
    draws = -np.abs(np.random.default_rng(0).normal(0.0, 0.1, 4000))
    assert Scale.of("chi", draws, p).high == 0.0


def test_symbols_are_those_of_formulas():
    assert symbol("J1.F_S") == r"J1 $F_{\mathrm{S}}$"
    assert symbol("noise_scale_damping") == r"$s_\zeta$"
    assert symbol("k") == "$k$"


def test_bands_are_the_quantiles_of_the_draws(posterior):
    figure = drawn(plot_bands(posterior))
    assert texts(figure.legends[0]) == ["measured, 2 hits", "median", "50 %", "90 %"]
    upper, lower = figure.axes
    ((x, middle),) = of_color(upper, PALETTE[1])
    bands = posterior.bands(0.5)
    assert np.all(np.diff(x) >= 0)
    assert np.sort(middle) == pytest.approx(
        np.sort(np.concatenate([b.frequency[1] for b in bands]))
    )
    assert lower.get_xlabel() == "Velocity amplitude (m/s)"


def test_bands_lie_on_the_points_where_offsets_are_free(solution):
    figure = drawn(plot_bands(sampled(structural(solution, "shift", offset=0.5))))
    ((_, middle),) = of_color(figure.axes[0], PALETTE[1])
    assert figure.axes[0].get_ylabel() == r"Frequency shift $\Delta f$ (Hz)"
    low, high = figure.axes[0].get_ylim()
    assert np.all((low < middle) & (middle < high))


def test_plot_knows_fits_and_posteriors(solution, posterior):
    assert len(plot(solution, held_out=[measured(2)]).axes) == 4
    assert len(plot(posterior).axes) == 21


def test_plotting_loads_no_optimiser():
    probe = (
        "import sys, iwanjax.plotting; "
        "print([m for m in ('optimistix', 'jaxopt', 'emcee') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
