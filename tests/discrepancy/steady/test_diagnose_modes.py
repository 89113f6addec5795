"""What a structure lacks beside its joint, by curves of its modes: from NumPy's own sliders."""

import dataclasses
import json

import bolted_chain as chain
import numpy as np
import pytest
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.discrepancy import CATALOGUE, ForceKind
from iwanjax.discrepancy.steady.diagnose_modes import diagnose_modes, modes_parameters
from iwanjax.errors import InputError
from iwanjax.identification.steady.cycle import beside
from iwanjax.plotting import plot_diagnosis, plot_explained
from iwanjax.quasistatic.modal import about
from iwanjax.updating.background import as_damped_in

STIFFNESS = chain.TRUTH["K_T"]
FORCES = {
    "none": lambda d, v: 0.0 * d,
    "cubic_stiffness": lambda d, v: 0.01 * STIFFNESS / (3.0 * chain.slip()) ** 2 * d**3,
    "stiffness_error": lambda d, v: 0.01 * STIFFNESS * d,
    "quadratic_damping": lambda d, v: 55.0 * v * np.abs(v),
}
PLACE, GUESS = "m3-ground", {"F_S": 60.0, "K_T": 2.4e5, "chi": -0.5, "beta": 1.0}
TRIED = ("stiffness_error", "cubic_stiffness", "quadratic_stiffness", "quadratic_damping")


def structure():
    linear = ij.LinearStructure(chain.M, chain.damping(), chain.K)
    return ij.JointedStructure(linear, {"J1": (chain.ROWS["J1"], ij.Iwan4(**GUESS))})


def verdict(curves, **options):
    first = {mode: hits[0] for mode, hits in curves.items()}
    held_out = {mode: hits[1] for mode, hits in curves.items()}
    options = {"hypotheses": TRIED, "rows": chain.ROWS} | options
    return diagnose_modes(structure(), first, held_out, **options)


@pytest.fixture(scope="module")
def curves():
    return {name: chain.measured(PLACE, FORCES[name]) for name in ("none", "cubic_stiffness")}


@pytest.fixture(scope="module")
def told(curves):
    return {name: verdict(each) for name, each in curves.items()}


def test_damping_that_the_structure_is_given_is_held(curves):
    """Free in each mode, it would take the place of a missing dashpot or viscoelastic link."""
    modes = sorted(curves["none"])
    first = [curves["none"][mode][0] for mode in modes]
    given = modes_parameters(structure(), first, modes)
    undamped = ij.JointedStructure(
        ij.LinearStructure(chain.M, None, chain.K), {"J1": (chain.ROWS["J1"], ij.Iwan4(**GUESS))}
    )
    own = modes_parameters(undamped, first, modes)
    for mode in modes:
        assert given[f"mode{mode}.zeta_0"].fixed
        assert not own[f"mode{mode}.zeta_0"].fixed
    assert not given["J1.F_S"].fixed


def test_nothing_is_found_where_nothing_is_missing(told):
    found = told["none"]
    assert not found.detected
    assert found.probability_nothing_missing > 0.9
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert "cannot show quadratic_stiffness" in found.statement()


def test_a_cubic_spring_is_found_where_it_is(told):
    found = told["cubic_stiffness"]
    assert found.what[0].label == f"cubic_stiffness@{PLACE}"
    assert found.what[0].probability > 0.9
    truth = FORCES["cubic_stiffness"](1.0, 0.0)
    (size,) = found.what[0].parameters
    # By its first harmonic alone, beside a joint that takes part of it up.
    assert abs(size.value - truth) < 3.0 * size.std + 0.03 * truth
    assert size.std < 0.05 * truth
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out < found.before.hold_out
    assert found.scores[0].where == PLACE


def test_places_that_are_alike_are_said(curves):
    """A place and one like it with the sign turned see the same."""
    rows = {PLACE: chain.ROWS[PLACE], "the other way": -chain.ROWS[PLACE]}
    found = verdict(curves["cubic_stiffness"], rows=rows, hypotheses=("cubic_stiffness",))
    assert found.indistinguishable == (
        (f"cubic_stiffness@{PLACE}", "cubic_stiffness@the other way"),
    )
    assert found.what[0].probability == pytest.approx(0.5, abs=0.05)


def test_the_pictures_show_all_modes(told):
    figure = plot_explained(told["cubic_stiffness"])
    assert [ax.get_title(loc="left") for ax in figure.axes[::4]] == ["mode 0", "mode 1", "mode 2"]
    assert len(plot_diagnosis(told["none"]).axes) >= 1


def test_a_joint_more_changes_what_a_given_c_damps_modes_by(curves):
    """One ratio in all modes with the joint stuck; without it not."""
    modes = sorted(curves["none"])
    first = [curves["none"][mode][0] for mode in modes]
    linear = ij.LinearStructure(chain.M, chain.damping(), chain.K)
    spring = {"J1": (chain.ROWS["J1"], ij.LinearSpring(chain.TRUTH["K_T"]))}
    bare, stuck = (ij.JointedStructure(linear, joints) for joints in ({}, spring))
    held = list(modes_parameters(bare, first, modes).values())
    assert max(abs(p.value / chain.ZETA - 1.0) for p in held) > 0.05
    held[1] = dataclasses.replace(held[1], value=1e-3)
    held[2] = dataclasses.replace(held[2], fixed=False)
    moved = [p.value for p in as_damped_in(stuck, bare, modes, held)]
    # Fixed at a value of one's own, or free, a ratio stays.
    assert moved == pytest.approx([chain.ZETA, 1e-3, held[2].value], rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", ["stiffness_error", "quadratic_damping"])
def test_others_are_found_too(name):
    found = verdict(chain.measured("m2-m3", FORCES[name]), hypotheses=())
    assert found.what[0].label == f"{name}@m2-m3"
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    if name == "stiffness_error":
        # Half of a spring that acts on one side only does the same to a single mode; and what has
        # a spring for its limit does at its limit.
        alike = [other for first, other in found.indistinguishable if first == f"{name}@m2-m3"]
        assert alike[0] == "bilinear_stiffness@m2-m3"
        containing = {"gap_contact@m2-m3", "coulomb_friction@m2-m3", "viscoelastic@m2-m3"}
        assert set(alike[1:]) <= containing
        odds = {each.label: each.probability for each in found.what}
        assert all(odds[each] < 0.2 * odds[alike[0]] for each in alike[1:])


@pytest.mark.long
def test_what_contains_the_law_that_is_missing_fits_no_worse():
    """A gap of no width and a slider that never slips are the spring; one number more costs."""
    several = chain.measured("m2-m3", FORCES["stiffness_error"])
    tried = ("stiffness_error", "gap_contact", "coulomb_friction")
    found = verdict(several, hypotheses=tried)
    evidence = {x.kind.name: x.log_evidence for x in reversed(found.what) if x.where == "m2-m3"}
    assert set(evidence) == set(tried)
    best = evidence.pop("stiffness_error")
    # Frequency and damping of each level.
    price = 0.5 * np.log(2 * sum(hits[0].amplitude.size for hits in several.values()))
    assert min(evidence.values()) > best - price - 1.0


@pytest.mark.long
def test_offsets_of_frequencies_are_left_out_of_a_shift():
    curves = chain.measured("m2-m3", FORCES["stiffness_error"])
    found = verdict(curves, reference="shift")
    assert found.after.hold_out < 2.0 * found.noise_floor.hold_out


def test_one_sided_forces_have_two_tips():
    kind, d = CATALOGUE["bilinear_stiffness"][0], np.array([[1.0, 2.0]])
    assert isinstance(kind, ForceKind)
    unit = beside(kind, 1.0, np.asarray(about(d)), np.array([[3.0]]))
    np.testing.assert_allclose(unit.tip, 0.5, rtol=1e-2)
    np.testing.assert_allclose(unit.stiffness[1], 0.5, rtol=1e-3)


def test_bad_curves_get_one_clear_line(curves):
    first = curves["none"][0][0]
    js, rows = structure(), chain.ROWS
    for given, options, said in (
        ({}, {}, "no curves"),
        ({0: first.scaled(1.0, "velocity")}, {}, "modal displacement"),
        ({7: first}, {}, "mode 7 does not exist"),
        ({0: first}, {"hold_out": {1: first}}, "mode 1 is held out only"),
        ({0: first}, {"rows": {}}, "no rows"),
        ({0: first}, {"rows": {"a": np.ones(2)}}, r"rows\['a'\] has shape \(2,\)"),
        ({0: first}, {"hypotheses": ("cubic",)}, "cubic_stiffness"),
    ):
        with pytest.raises(InputError, match=said):
            diagnose_modes(js, given, **({"rows": rows} | options))


def test_a_budget_that_is_too_short_is_said(curves):
    found = verdict(curves["cubic_stiffness"], budget=0.0)
    assert not found.complete
    # The joints alone are 8 times the noise off: undecided, with nothing tried yet.
    assert found.detected
    assert found.verdict.name == "undecided"
    assert found.what == ()
    assert "too short" in found.statement()


def test_the_command_takes_curves_of_a_structure(curves, tmp_path):
    np.savez(
        tmp_path / "model.npz",
        M=chain.M,
        C=chain.damping(),
        K=chain.K,
        row_labels=list(chain.ROWS),
        rows=np.stack(list(chain.ROWS.values())),
        sensor_labels=["a3"],
        sensor_rows=chain.ROWS["m3-ground"][None],
        input_labels=["m1"],
        input_rows=chain.ROWS["m1-ground"][None],
    )
    entries = []
    for mode, hits in curves["cubic_stiffness"].items():
        for use, curve in zip(chain.LEVELS, hits, strict=True):
            file = f"mode{mode}_{use}.npz"
            names = ("amplitude", "frequency", "damping", "frequency_std", "damping_std")
            np.savez(tmp_path / file, **{x: np.asarray(getattr(curve, x)) for x in names})
            entries.append(f"  - {{file: {file}, kind: curves, use: {use}, mode: {mode}}}")
    joint = ", ".join(f"{name}: {value}" for name, value in GUESS.items())
    text = [
        "name: chain",
        "model:",
        "  file: model.npz",
        f"  joints: [{{name: J1, row: J1, type: iwan4, parameters: {{{joint}}}}}]",
        f"hypotheses: [{', '.join(TRIED)}]",
        "recordings:",
        *entries,
    ]
    (tmp_path / "study.yaml").write_text("\n".join(text))
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["diagnose", str(tmp_path / "study.yaml"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    found = json.loads((out / "diagnosis.json").read_text())
    assert (found["what"][0]["kind"], found["what"][0]["where"]) == ("cubic_stiffness", PLACE)
    assert set(found["recordings"]) == {
        f"mode {mode}: mode{mode}_{use}.npz" for mode in range(3) for use in chain.LEVELS
    }
    assert {"report.html", "prediction.png", "places.png"} <= {p.name for p in out.iterdir()}


@pytest.mark.long
def test_a_joint_left_out_of_a_linear_structure_is_found_at_its_place(curves):
    """The damping of its third mode rises 3.5-fold; a slider alone leaves 0.9 of the fall."""
    row, k = chain.ROWS["m2-m3"], 1e5
    rest = chain.K - k * np.outer(row, row)
    linear = ij.LinearStructure(chain.M, chain.damping(), rest)
    found = diagnose_modes(
        ij.JointedStructure(linear, {"S": (row, ij.LinearSpring(k))}),
        {mode: each[0] for mode, each in curves["none"].items()},
        {mode: each[1] for mode, each in curves["none"].items()},
        rows=chain.ROWS,
        hypotheses=("coulomb_friction", "iwan_joint"),
    )
    assert found.what[0].label == "iwan_joint@J1"
    values = {each.info.name: each.value for each in found.what[0].parameters}
    # Far below macroslip F_S and beta are open, K_T and chi are not.
    assert values["K_T"] == pytest.approx(chain.TRUTH["K_T"], rel=1e-3)
    assert values["chi"] == pytest.approx(chain.TRUTH["chi"], abs=0.01)
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
