import dataclasses
import io
import itertools
from html.parser import HTMLParser

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

import iwanjax as ij
from iwanjax.estimation.priors import LogNormal, Normal, Uniform
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.report import (
    Callout,
    FitEntry,
    HeldOut,
    NamedParagraph,
    PageSection,
    PageTable,
    fit_report,
    render,
)
from iwanjax.report.page import png
from iwanjax.report.words import (
    cautions,
    explanation,
    findings,
    length_unit,
    listed,
    macroslip,
    number,
    open_questions,
    prior_range,
    told,
    with_deviation,
)
from iwanjax.signals.hilbert import ringdown
from iwanjax.signals.merge import merge_curves
from iwanjax.updating.estimate import fit
from iwanjax.updating.posterior import Posterior

TRUTH = ModalOscillator(100.0, 1e-3, ij.Jenkins(F_S=0.4, K_T=2e4))
VOID = {"meta", "img", "br", "hr", "link", "input"}


@pytest.fixture(autouse=True)
def _leave_matplotlib_as_it_was():
    before, figures = dict(mpl.rcParams), plt.get_fignums()
    yield
    assert plt.get_fignums() == figures, "a figure was left open"
    assert dict(mpl.rcParams) == before


class Page(HTMLParser):
    """What a page holds; refuses tags that do not match."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.words, self.cells = [], [], [], []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "td":
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)
        if "td" in self.open:
            self.cells[-1] += data

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())

    def all(self, name):
        return [attrs for tag, attrs in self.tags if tag == name]


def check_contained(text):
    """No scripts, nothing fetched from anywhere."""
    page = Page(text)
    assert not {"script", "link", "iframe", "a", "object"} & {tag for tag, _ in page.tags}
    # Neither is possible within base64.
    assert "://" not in text
    assert "url(" not in text
    assert "@import" not in text
    for attrs in page.all("img"):
        assert attrs["src"].startswith("data:image/png;base64,")
        assert attrs["alt"]
    for _, attrs in page.tags:
        assert not any(name.startswith("on") for name in attrs)
    return page


def curve(seed, name):
    random = np.random.default_rng(seed)
    q = np.geomspace(2e-4, 2e-6, 15)
    c = TRUTH.curves(q)
    f_std, zeta_std = 5e-3, 0.03 * np.asarray(c.damping)
    return ij.ModalCurves(
        q,
        np.asarray(c.frequency) + f_std * random.standard_normal(q.size),
        np.asarray(c.damping) + zeta_std * random.standard_normal(q.size),
        frequency_std=np.full(q.size, f_std),
        damping_std=zeta_std,
        quantity="displacement",
        name=name,
    ).as_quantity("velocity", "m/s")


def decay(seed, amplitude=1.0):
    t = np.arange(6000) / 2000.0
    x = amplitude * np.exp(-1.2 * t) * np.cos(200.0 * np.pi * t)
    noise = 5e-3 * np.random.default_rng(seed).standard_normal(t.size)
    return ringdown(x + noise, 2000.0, (70.0, 140.0), unit="m/s", name=f"hit {seed}")


@pytest.fixture(scope="module")
def solution():
    return fit("jenkins", [curve(0, "hit 1"), curve(1, "hit 2")], starts=4)


def sampled(solution, **changes):
    random = np.random.default_rng(0)
    free = list(solution.problem.chart.free)
    mean = np.array([p.value for p in solution.parameters])[free]
    draws = random.multivariate_normal(
        mean, solution.covariance[np.ix_(free, free)], 2000, method="eigh"
    )
    scales = np.exp(0.1 * random.standard_normal((2000, 2)))
    names = tuple(solution.parameters[i].name for i in free)
    names += ("noise_scale_frequency", "noise_scale_damping")
    given = {
        "names": names,
        "chain": np.concatenate([draws, scales], axis=1).reshape(200, 10, -1),
        "log_density": np.zeros((200, 10)),
        "autocorrelation": dict.fromkeys(names, 5.0),
        "effective": dict.fromkeys(names, 400.0),
        "wanted": 300,
        "enough": True,
        "acceptance": 0.3,
        "burnt": 0,
        "solution": solution,
    }
    return Posterior(**given | changes)


class Finding:
    def statement(self):
        return "Free power laws have exponents 0.5 & 0.6"


@pytest.fixture(scope="module")
def whole(solution):
    """A report with all that an entry may hold, made once."""
    decays = tuple(decay(i, a) for i, a in enumerate((1.0, 0.8)))
    entry = FitEntry(
        "Mode <1>",
        solution,
        decays,
        merge_curves([d.curves for d in decays]),
        Finding(),
        (HeldOut("hit 3", 0.0123, 4.2, 0.011, 3.9, curve(2, "hit 3")), ("hit 4", 0.02, 5.0)),
        sampled(solution),
    )
    return fit_report("Beams & <bolts>", [entry])


def test_a_page_is_contained_and_escaped():
    figure = Figure(figsize=(2, 1))
    figure.subplots().plot([1, 2])
    text = render(
        "A < B & C",
        ["x < y", Callout("rests on <it>", "bound"), NamedParagraph("mode & 1", "found")],
        [
            PageSection(
                "Part <1>",
                ("a & b", Callout("look out")),
                (("a figure", figure), ('its "copy"', png(figure))),
                (
                    PageTable(
                        ("Name <n>", "Value"), (("k", "1.0"), ("<c>", "2.0")), "Numbers & all"
                    ),
                ),
            )
        ],
        "the end <now>",
    )
    page = check_contained(text)
    for words in ("A < B & C", "x < y", "Part <1>", "a & b", "Name <n>", "the end <now>"):
        assert words in page.text
    assert "<it>" not in text
    assert page.cells == ["k", "1.0", "<c>", "2.0"]
    assert [attrs["alt"] for attrs in page.all("img")] == ["a figure", 'its "copy"']
    notes = [a["class"] for tag, a in page.tags if tag == "p" and "class" in a]
    assert notes == ["callout bound", "callout warning"]
    assert [a.get("class") for a in page.all("td")] == [None, "number"] * 2


def test_a_page_suits_screen_print_and_both_schemes():
    text = render("t", ["words"], [])
    assert "prefers-color-scheme: dark" in text
    assert "@media print" in text
    assert "tabular-nums" in text
    assert "<footer>" not in text
    assert Page(text).all("html") == [{"lang": "en"}]


def test_a_figure_that_is_none_is_refused():
    with pytest.raises(ij.InputError, match="'photo': is neither a Figure nor a PNG"):
        render("t", [], [PageSection("s", figures=(("photo", b"\xff\xd8\xff"),))])


def test_a_row_of_the_wrong_length_is_refused():
    with pytest.raises(ij.InputError, match="'sizes': row 1 has 3 cells; expected 2"):
        PageTable(("a", "b"), (("1", "2"), ("1", "2", "3")), "sizes")


@pytest.mark.parametrize(
    ("value", "digits", "words"),
    [
        (0.0, 3, "0"),
        (117.99951, 3, "118"),
        (0.0123456, 3, "0.0123"),
        (27543.2, 2, "28000"),
        (1.19e-4, 3, "1.19×10⁻⁴"),
        (-5.2e-12, 2, "-5.2×10⁻¹²"),
        (9.999e-4, 2, "0.0010"),
        (1.5e7, 2, "1.5×10⁷"),
        (7.0, 2, "7.0"),
    ],
)
def test_numbers_are_short(value, digits, words):
    assert number(value, digits) == words


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [
        (117.99951, 0.00113, ("117.9995", "0.0011")),
        (27543.2, 1520.0, ("27500", "1500")),
        (9.986e-5, 2.6e-6, ("9.99×10⁻⁵", "0.26×10⁻⁵")),
        (-0.4492, 0.00137, ("-0.4492", "0.0014")),
        (0.2, 0.0, ("0.200000", "–")),
        (1.0, 0.0996, ("1.00", "0.10")),
        (0.3, 5.0, ("0.3", "5.0")),
    ],
)
def test_values_have_the_digits_that_their_deviation_leaves(value, std, words):
    assert with_deviation(value, std) == words


def test_values_are_told_with_unit_and_do_not_break():
    assert told("f_0", 118.0, 0.02, "Hz").replace("\xa0", " ") == "f_0 = 118.000 ± 0.020 Hz"
    assert told("q", 1e-5, 1e-6).replace("\xa0", " ") == "q = (1.00 ± 0.10)×10⁻⁵"
    assert " " not in told("f_0", 118.0, 0.02, "Hz")


def test_lists_and_priors_in_words():
    assert [listed(list("abc")), listed(["a"]), listed([])] == ["a, b and c", "a", ""]
    assert prior_range(Uniform(-1.0, 0.5)) == "-1.00 to 0.500"
    assert prior_range(Normal(118.0, 0.01)) == "117.984 to 118.016"
    low, high = prior_range(LogNormal(100.0, 1.5)).split(" to ")
    assert float(low) == pytest.approx(100.0 * np.exp(-1.645 * 1.5), rel=0.05)
    assert float(high) == pytest.approx(100.0 * np.exp(1.645 * 1.5), rel=0.05)


@pytest.mark.parametrize(
    ("quantity", "unit", "length"),
    [
        ("velocity", "mm/s", "mm"),
        ("acceleration", "m/s^2", "m"),
        ("acceleration", "m/s²", "m"),
        ("displacement", "µm", "µm"),
        ("acceleration", "g", ""),
        ("velocity", "", ""),
    ],
)
def test_the_unit_of_length_behind_an_amplitude(quantity, unit, length):
    c = ij.ModalCurves([1.0], [1.0], [1.0], quantity=quantity, unit=unit)
    assert length_unit(c) == length


def test_a_good_fit_in_words(solution):
    assert "30 levels of 2 hits, velocity amplitude" in explanation(solution)
    assert "explains the curves to their noise" in explanation(solution)
    assert "F_S" in findings(solution)
    assert not macroslip(solution)
    assert not cautions(dataclasses.replace(solution, agreeing=4))


def test_a_bad_fit_is_not_praised(solution):
    bad = dataclasses.replace(
        solution, misfit=7.04, misfit_frequency=6.5, misfit_damping=7.5, agreeing=1, converged=False
    )
    assert "leaves out something" in explanation(bad)
    assert "widened by the misfit, 7.0" in findings(bad)
    warned = " ".join(note.text for note in cautions(bad))
    for words in ("not converged", "Only one of", "7.0 times the stated deviations"):
        assert words in warned


def test_what_is_open_is_said(solution):
    from iwanjax.updating.solution import Direction

    determined = {**solution.determined, "F_S": False, "K_T": False}
    direction = Direction({"F_S": 0.7, "K_T": -0.71}, 0.93)
    text = open_questions(
        dataclasses.replace(solution, determined=determined, undetermined=(direction,))
    )
    assert "do not determine F_S and K_T on their own" in text
    assert "-0.71 K_T +0.70 F_S (known to 93 %" in text
    alone = dataclasses.replace(
        solution,
        determined={**solution.determined, "F_S": False},
        undetermined=(Direction({"F_S": 1.0, "K_T": 0.05}, 0.93),),
    )
    assert "93 %" not in open_questions(alone)
    assert "F_S on its own" in open_questions(alone)
    assert not open_questions(dataclasses.replace(solution, undetermined=()))


def test_macroslip_is_said_to_be_reached_or_not(solution):
    largest = float(np.max(solution.problem.measured.q))
    told_of = [
        macroslip(dataclasses.replace(solution, derived={"phi_max": (x * largest, 0.1 * largest)}))
        for x in (0.5, 2.0)
    ]
    assert "which the curves reach: they go up to 2.00×10⁻⁴ m." in told_of[0]
    assert told_of[1].endswith("its strength is an extrapolation.")


def test_other_minima_are_told(solution, monkeypatch):
    monkeypatch.setattr("iwanjax.report.fit.figures", lambda entry: [])
    rival = dataclasses.replace(
        solution, rivals={"F_S": (0.085, 1.8)}, derived={"phi_max": (1e-5, 8e-6)}
    )
    page = Page(fit_report("r", [FitEntry("a", rival)]))
    assert "as well, with F_S from 0.0850 to 1.80." in page.text
    assert "slips altogether is not determined" in page.text
    assert "not determined" in page.cells


def test_a_report_is_contained_and_escaped(whole):
    page = check_contained(whole)
    assert "Beams & <bolts>" in page.text
    assert "Mode <1>" in page.text
    assert "exponents 0.5 & 0.6." in page.text
    assert len(page.all("img")) == 6
    assert "Written by iwanjax" in page.text


def test_the_numbers_of_the_solution_are_in_the_table(whole, solution):
    cells = Page(whole).cells
    for p in solution.parameters:
        row = cells[cells.index(p.name) :][:6]
        assert float(row[1].split("×")[0]) == pytest.approx(
            p.value / (10.0 ** np.floor(np.log10(p.value)) if "×" in row[1] else 1.0), rel=0.05
        )
        assert row[1:3] == list(with_deviation(p.value, solution.std[p.name]))
        assert row[3] == p.unit
        assert " to " in row[4]
        assert row[5] == p.meaning
    assert "K_inf" in cells


def test_held_out_errors_stand_beside_the_repeatability(whole):
    page = Page(whole)
    at = page.cells.index("hit 3")
    assert page.cells[at : at + 10] == [
        "hit 3",
        "0.012",
        "0.011",
        "4.2",
        "3.9",
        "hit 4",
        "0.020",
        "–",
        "5.0",
        "–",
    ]
    assert "predicts 2 held-out hits to 0.020 Hz and 5.0 % of the damping" in page.text
    assert "as well as hits repeat each other" in page.text


def test_the_posterior_has_its_table(whole, solution):
    page = Page(whole)
    last = len(page.cells) - 1 - page.cells[::-1].index("noise_scale_damping")
    assert page.cells[last + 3] == "400"
    assert float(page.cells[last + 1]) == pytest.approx(1.0, abs=0.05)


def test_what_must_not_be_overlooked_is_called_out(solution, monkeypatch):
    """Bounds, a short chain, an estimate that the posterior does not know."""
    monkeypatch.setattr("iwanjax.report.fit.figures", lambda entry: [])
    bound = dataclasses.replace(solution, active_bounds={"zeta_0": 0.002})
    shifted = sampled(solution, enough=False, effective={"f_0": 12.0})
    shifted.chain[..., shifted.names.index("F_S")] *= 3.0
    text = fit_report("r", [FitEntry("a", bound, posterior=None), FitEntry("b", solution)])
    page = Page(text)
    kinds = list(itertools.chain(*(a["class"].split() for a in page.all("p") if "class" in a)))
    assert "bound" in kinds
    assert "zeta_0 rests on its bound 0.002" in page.text
    assert "on its bound" in page.cells
    names = [a for a in page.text.split() if a in ("a.", "b.")]
    assert names == ["a.", "b."]

    monkeypatch.setattr(
        "iwanjax.report.fit.posterior_table", lambda posterior: PageTable(("n",), ())
    )
    page = Page(fit_report("r", [FitEntry("a", solution, posterior=shifted)]))
    assert "not long enough: it got to 12 of 300" in page.text
    assert "outside the central 99 % of its posterior: F_S = " in page.text
    long = dataclasses.replace(shifted, effective={"f_0": 400.0})
    assert "too short to tell" in fit_report("r", [FitEntry("a", solution, posterior=long)])


def test_a_report_of_nothing_is_refused():
    with pytest.raises(ij.InputError, match="no fits"):
        fit_report("r", [])


@pytest.mark.parametrize("layout", ["constrained", None])
def test_a_picture_is_the_one_that_matplotlib_saves(layout):
    def figure() -> Figure:
        made, axes = plt.subplots(2, 2, figsize=(5.0, 3.0), layout=layout)
        for i, ax in enumerate(axes.flat):
            ax.loglog([1e-3, 1.0], [10.0**i, 2.0], label=f"level {i}")
            ax.set(xlabel="frequency (Hz)", ylabel="acceleration\n(m/s$^2$)")
        axes[0, 0].legend()
        made.colorbar(axes[1, 1].scatter([0.1], [10.0], c=[1.0]), ax=axes[1, 1])
        return made

    pictures = []
    for save in (png, saved_by_matplotlib):
        drawn = figure()
        pictures.append(plt.imread(io.BytesIO(save(drawn))))
        plt.close(drawn)
    np.testing.assert_array_equal(*pictures)


def saved_by_matplotlib(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=200)
    return buffer.getvalue()
