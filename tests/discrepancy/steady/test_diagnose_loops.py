"""What a joint lacks, by its loops: from sliders of a code of their own."""

import json
import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
from concealed.steady import (
    CUBIC,
    K_T,
    LEVELS,
    PHI,
    QUARTER,
    SIZES,
    SLIP,
    STIFFNESS,
    path,
    stretched,
)
from concealed.steady import LOOP_FORCES as FORCES
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.discrepancy import CATALOGUE
from iwanjax.discrepancy.steady.diagnose_loops import diagnose_loops
from iwanjax.errors import InputError
from iwanjax.identification.steady.loops import is_seen
from iwanjax.plotting import plot_loops
from iwanjax.signals.loop_histories import driven

pytestmark = pytest.mark.computes
GUESS = ij.Iwan4(F_S=7.0, K_T=1.2, chi=-0.3, beta=3.0)
TRIED = ("stiffness_error", "cubic_stiffness", "coulomb_friction", "viscous_damping")


def loops(name, steady=False):
    """Noise of 0.2 % of F_S and a load cell's offset; a steady loop alone if so asked."""
    random, found = np.random.default_rng(1), []
    for i, levels in enumerate(LEVELS):
        d = path(levels)
        force = stretched(d, SLIP, STIFFNESS) + FORCES[name](d, *SIZES[name])
        force = force + 0.3 + 0.02 * random.standard_normal(d.size)
        last = slice(-4 * QUARTER - 1, None) if steady else slice(None)
        found.append(ij.ForceLoop(d[last], force[last], f"loop{i}"))
    return found


def verdict(name, steady=False):
    several = loops(name, steady)
    return diagnose_loops(GUESS, several[:2], several[2], name="J1", hypotheses=TRIED)


@pytest.mark.parametrize("steady", [False, pytest.param(True, marks=pytest.mark.long)])
def test_nothing_is_missing_from_a_joint_that_is_all(steady):
    told = verdict("none", steady)
    assert not told.detected
    assert told.probability_nothing_missing > 0.95
    assert told.after.hold_out < 1.2 * told.noise_floor.hold_out


@pytest.mark.parametrize("steady", [pytest.param(False, marks=pytest.mark.long), True])
def test_a_cubic_spring_beside_it_is_found(steady):
    told = verdict("cubic_stiffness", steady)
    assert told.detected
    first = told.what[0]
    assert (first.kind.name, first.where) == ("cubic_stiffness", "J1")
    assert first.probability > 0.95
    (size,) = first.parameters
    assert size.value == pytest.approx(CUBIC, rel=0.05)
    assert told.after.hold_out < 1.3 * told.noise_floor.hold_out < 0.5 * told.before.hold_out
    assert any("viscous_damping" in line and "rate" in line for line in told.warnings)


@pytest.mark.long
def test_a_slider_beside_it_is_found_with_its_slip():
    told = verdict("coulomb_friction")
    assert told.what[0].kind.name == "coulomb_friction"
    size, shape = told.what[0].parameters
    assert size.value == pytest.approx(0.2 * K_T, rel=0.1)
    assert shape.value == pytest.approx(0.1 * PHI, rel=0.1)


@pytest.mark.long
def test_what_contains_the_law_that_is_missing_fits_no_worse():
    """A spring: a gap of no width, and a slider that never slips, which left twice as much.

    What is between them is the price of one number more, ln(N)/2.
    """
    random, several = np.random.default_rng(1), []
    for i, levels in enumerate(LEVELS):
        d = path(levels)
        force = stretched(d, SLIP, STIFFNESS) + 0.1 * K_T * d
        several.append(ij.ForceLoop(d, force + 0.02 * random.standard_normal(d.size), f"loop{i}"))
    tried = ("stiffness_error", "gap_contact", "coulomb_friction")
    told = diagnose_loops(GUESS, several[:2], several[2], name="J1", hypotheses=tried)
    # The best comes first, of a gap on both sides or on one.
    evidence = {each.label: each.log_evidence for each in reversed(told.what)}
    best = evidence.pop("stiffness_error@J1")
    price = 0.5 * np.log(sum(each.d.size for each in several[:2]))
    assert set(evidence) == {f"{kind}@J1" for kind in tried[1:]}
    assert min(evidence.values()) == pytest.approx(best - price, abs=1.0)


def test_the_picture_says_units_where_they_are_known_and_none_where_they_are_not():
    several = loops("cubic_stiffness")
    ends = {
        ("in", "kip"): ("Deflection $d$ (in)", "Force $F$ (kip)"),
        ("", ""): ("Deflection $d$", "Force $F$"),
    }
    for units, wanted in ends.items():
        measured = [ij.ForceLoop(x.d, x.force, x.name, x.dt, *units) for x in several]
        told = diagnose_loops(
            GUESS, measured[:2], measured[2], name="J1", hypotheses=("stiffness_error",)
        )
        figure = plot_loops(told)
        labels = {ax.get_xlabel() for ax in figure.axes} | {ax.get_ylabel() for ax in figure.axes}
        assert set(wanted) <= labels
        plt.close(figure)


def test_what_nothing_that_was_tried_explains_leaves_the_verdict_undecided():
    several = loops("cubic_stiffness")
    tried = ("stiffness_error", "bilinear_stiffness")
    told = diagnose_loops(GUESS, several[:2], several[2], name="J1", hypotheses=tried)
    assert told.before.hold_out > 3.0 * told.noise_floor.hold_out
    assert told.detected
    assert told.verdict.name == "undecided"
    assert told.probability_nothing_missing < 0.1
    assert told.probability_something_else > 0.5
    assert told.statement().startswith("Undecided")
    assert "Nothing is missing" not in told.statement()


def test_a_correction_that_diverges_beyond_what_was_fitted_is_refused():
    """What saturates is fitted by a negative cubic spring, of no use at five times the stroke."""
    random, several = np.random.default_rng(1), []
    for i, levels in enumerate(((0.05, 0.1), (0.2,), (0.15, 1.0))):
        d = path(levels)
        beside = 0.04 * K_T * PHI * np.tanh(d / (0.1 * PHI))
        force = stretched(d, SLIP, STIFFNESS) + beside + 0.002 * random.standard_normal(d.size)
        several.append(ij.ForceLoop(d, force, f"loop{i}"))
    tried = ("cubic_stiffness",)
    told = diagnose_loops(GUESS, several[:2], several[2], name="J1", hypotheses=tried)
    assert told.after.hold_out <= told.before.hold_out
    assert told.what == ()
    assert told.verdict.name == "undecided"
    (refused,) = told.refused
    assert refused.label == "cubic_stiffness@J1"
    assert refused.after > 5.0 * refused.before
    assert "falls" not in told.statement()
    assert "refused" in told.statement()


@pytest.mark.long
def test_a_joint_left_out_beside_a_spring_is_found():
    """The loops of an Iwan joint, taken for those of a spring: no single force makes them."""
    several = loops("none")
    tried = ("coulomb_friction", "iwan_joint")
    told = diagnose_loops(
        ij.LinearSpring(0.5 * K_T), several[:2], several[2], name="J1", hypotheses=tried
    )
    first = told.what[0]
    assert (first.kind.name, first.where) == ("iwan_joint", "J1")
    assert first.probability > 0.9
    values = {each.info.name: each for each in first.parameters}
    # A spring beside it is free: the joint's own stiffness is what slips of both.
    assert values["F_S"].value == pytest.approx(10.0, rel=0.05)
    assert values["K_T"].value == pytest.approx(K_T, rel=0.05)
    assert told.after.hold_out < 1.2 * told.noise_floor.hold_out < 0.1 * told.before.hold_out


def test_which_forces_loops_without_time_show():
    histories = driven(loops("none"), (1.0, 1.0, 1.0), 2, True)
    slow = {
        kinds[0].name
        for kinds in CATALOGUE.values()
        if hasattr(kinds[0], "unit_force") and is_seen(kinds[0], histories)
    }
    rate = {"mass_error", "viscous_damping", "quadratic_damping", "viscoelastic"}
    assert not slow & rate
    assert {"cubic_stiffness", "gap_contact", "coulomb_friction", "bilinear_stiffness"} <= slow


def test_a_long_loop_is_drawn_by_fewer_values_that_keep_its_turns():
    (loop,) = loops("none")[2:]
    few = driven([loop], (1.0,), 1, False, 50)
    assert few.d.shape[1] <= 52
    assert set(np.asarray(few.d)[0]) >= {
        *loop.before(False),
        loop.d.max(),
        loop.d.min(),
        loop.d[-1],
    }


def test_it_is_refused_without_loops():
    with pytest.raises(InputError, match="no loops to fit"):
        diagnose_loops(GUESS, [])


def test_a_budget_that_is_spent_leaves_the_joint_alone():
    told = diagnose_loops(GUESS, loops("none")[:1], budget=0.0)
    assert not told.complete
    assert not told.detected


# --- the command -------------------------------------------------------------------------------


def study(folder, several, uses, **files):
    entries = []
    for loop, use in zip(several, uses, strict=True):
        held = {"displacement": loop.d.tolist(), "force": loop.force.tolist()}
        (folder / f"{loop.name}.json").write_text(json.dumps(held) if not files else files["text"])
        entries.append(f"  - {{file: {loop.name}.json, kind: loop, joint: J1, use: {use}}}")
    lines = ["name: J1 on its own", "model: {builder: three_mass}", "recordings:", *entries]
    lines += ["hypotheses: [cubic_stiffness]", "fit: {starts: 16}"]
    (folder / "study.yaml").write_text("\n".join(lines))
    arguments = ["diagnose", str(folder / "study.yaml"), "--out", str(folder / "out")]
    return CliRunner().invoke(app, arguments), folder / "out"


def test_the_command_takes_loops(tmp_path):
    result, out = study(tmp_path, loops("cubic_stiffness"), ("fit", "fit", "hold_out"))
    assert result.exit_code == 0, result.stderr
    found = json.loads((out / "diagnosis.json").read_text())
    assert [(each["kind"], each["where"]) for each in found["what"]] == [("cubic_stiffness", "J1")]
    assert found["fit"]["after"]["hold_out"] < 0.5 * found["fit"]["before"]["hold_out"]
    assert sorted(file.name for file in out.iterdir()) == [
        "diagnosis.json",
        "diagnosis.png",
        "prediction.png",
        "report.html",
    ]
    assert "J1: what it rests on" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("uses", "files", "told"),
    [
        (("hold_out",) * 3, {}, "all loops of J1 are held out"),
        (("fit",) * 3, {"text": "[1"}, r"recordings\[0\]: .*loop0.json: is no JSON"),
    ],
)
def test_the_command_refuses_what_it_cannot_use(tmp_path, uses, files, told):
    result, out = study(tmp_path, loops("none"), uses, **files)
    assert result.exit_code == 2
    assert not out.exists()
    assert re.search(told, result.stderr)
