"""What a mode lacks beside its joint, by its curves: from sliders of a code of their own."""

import json
import math
from dataclasses import replace

import jax
import numpy as np
import pytest
from bolted_mode import COLUMNS, TRUTH, decays, measured
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.discrepancy import CATALOGUE, ForceKind
from iwanjax.discrepancy.findings import Errors
from iwanjax.discrepancy.steady.diagnose_joint import diagnose_curves
from iwanjax.errors import InputError
from iwanjax.identification.steady.cycle import beside, shows
from iwanjax.plotting import plot_diagnosis, plot_explained
from iwanjax.quasistatic.modal import about

OMEGA2, PHI = TRUTH.omega_0**2, TRUTH.phi_max
CUBIC = 0.02 * OMEGA2 / PHI**2
FORCES = {
    "none": lambda x, v: 0.0 * x,
    "cubic_stiffness": lambda x, v: CUBIC * x**3,
    "gap_contact": lambda x, v: 0.05 * OMEGA2 * np.sign(x) * np.maximum(np.abs(x) - PHI, 0.0),
    "quadratic_damping": lambda x, v: 6e-4 / PHI * v * np.abs(v),
    "dashpot": lambda x, v: 2.0 * 5e-4 * TRUTH.omega_0 * v,
    "bilinear spring": lambda x, v: 0.01 * OMEGA2 * np.maximum(x, 0.0),
    "negative drag": lambda x, v: -1e-4 / PHI * v * np.abs(v),
}
Q = np.geomspace(1e-6, 1e-4, 9)
ELEMENTS = {
    "stiffness_error": ij.LinearSpring(1.0),
    "viscous_damping": ij.Dashpot(1.0),
    "cubic_stiffness": ij.CubicSpring(1.0),
    "gap_contact": ij.Gap(1.0, 3e-5),
    "coulomb_friction": ij.Jenkins(2e-6, 1.0),
    "quadratic_damping": ij.QuadraticDrag(1.0),
}
MODES = ("plain", "hardening")
SHAPES = {"gap_contact": 3e-5, "coulomb_friction": 2e-6}


def verdict(name, noise_db=-60.0, seed=1, **options):
    curves = measured(FORCES[name], noise_db, seed)
    return diagnose_curves("iwan4", curves[:3], curves[3:], name="mode1", **options)


@pytest.fixture(scope="module")
def told():
    tried = ("stiffness_error", "cubic_stiffness", "gap_contact", "quadratic_damping")
    return {name: verdict(name, hypotheses=tried) for name in ("none", "cubic_stiffness")}


@pytest.mark.parametrize("name", ELEMENTS)
def test_a_cycle_is_that_of_the_element(name):
    element, omega = ELEMENTS[name], 700.0
    unit = beside(CATALOGUE[name][0], SHAPES.get(name, 1.0), np.asarray(about(Q)), omega)
    # 256 steps a cycle resolve the corners of sliders and gaps to a thousandth.
    stiffness = np.asarray(element.harmonic_stiffness(Q))
    scale = max(float(np.max(np.abs(stiffness))), 1e-9)
    np.testing.assert_allclose(unit.stiffness[1], stiffness, rtol=2e-3, atol=2e-3 * scale)
    loss = np.asarray(element.dissipation(Q, omega=omega))
    np.testing.assert_allclose(unit.loss, loss, rtol=1e-2, atol=1e-9 * np.max(scale * Q**2))
    if name != "coulomb_friction":  # whose slope at the tip jumps where it starts to slip
        np.testing.assert_allclose(unit.tip, element.tip_stiffness(Q), rtol=1e-2, atol=1e-6)


def test_forces_that_are_the_modes_own_are_not_seen():
    q, forces = np.asarray(about(Q)), [k[0] for k in CATALOGUE.values()]
    hidden = {
        kind.name
        for kind in forces
        if isinstance(kind, ForceKind) and not shows(beside(kind, 1e-3, q, 700.0), q)
    }
    own = {"stiffness_error", "mass_error", "viscous_damping", "bilinear_stiffness", "viscoelastic"}
    # What changes with time does so at every amplitude.
    own |= {"changing_stiffness"}
    # A gap and sliders of a millimetre do nothing new within a tenth of one.
    assert hidden == own | {"quadratic_stiffness", "gap_contact", "coulomb_friction", "backlash"}


def test_nothing_is_found_where_nothing_is_missing(told):
    found = told["none"]
    assert not found.detected
    assert found.what == ()
    assert found.probability_nothing_missing > 0.9
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert "Nothing is missing" in found.statement()
    assert "cannot show stiffness_error" in found.statement()


def test_a_cubic_spring_is_found_and_predicts_what_was_held_out(told):
    found = told["cubic_stiffness"]
    assert found.what[0].label == "cubic_stiffness@mode1"
    assert found.what[0].probability > 0.9
    # By its first harmonic alone, at a tenth of the mode's stiffness: two per cent too much.
    assert found.what[0].parameters[0].value == pytest.approx(CUBIC, rel=0.05)
    assert found.after.hold_out < 1.5 * found.noise_floor.hold_out
    assert found.before.hold_out > 10.0 * found.after.hold_out
    assert {each.quantity for each in found.observables} == {"frequency", "damping"}


def test_what_nothing_that_was_tried_explains_leaves_the_verdict_undecided(told):
    curves = told["cubic_stiffness"].runs[0].measured
    found = diagnose_curves("iwan4", curves[:3], curves[3:], hypotheses=("stiffness_error",))
    assert found.before.hold_out > 10.0 * found.noise_floor.hold_out
    assert found.detected
    assert found.verdict.name == "undecided"
    assert found.probability_nothing_missing < 0.1
    assert found.statement().startswith("Undecided")


@pytest.mark.parametrize(("times", "said"), [(0.5, False), (3.0, True)])
def test_parameters_that_leave_much_open_are_said(told, times, said):
    for found in told.values():
        spread = Errors(0.0, times * found.noise_floor.hold_out)
        statement = replace(found, parameter_spread=spread).statement()
        assert ("leave open of the parameters" in statement) == said


def test_the_pictures_show_both(told):
    for found in told.values():
        figure = plot_explained(found)
        f, zeta, _, _ = figure.axes
        assert f.get_ylabel().endswith("(Hz)")
        assert len(f.get_lines()) >= 1 + found.detected
        assert zeta.get_yscale() == "log"
        assert plot_diagnosis(found).axes
    with pytest.raises(InputError, match="plot_explained"):
        ij.plotting.plot_prediction(told["none"])


@pytest.mark.long
@pytest.mark.parametrize("name", ["gap_contact", "quadratic_damping"])
def test_others_are_found_too(name):
    found = verdict(name)
    assert found.detected
    assert found.what[0].kind.name == name
    assert found.after.hold_out < 1.5 * found.noise_floor.hold_out


@pytest.mark.long
@pytest.mark.parametrize("name", ["dashpot", "bilinear spring"])
def test_what_curves_cannot_show_is_no_alarm(name):
    assert not verdict(name).detected


@pytest.mark.long
def test_a_force_that_gives_energy_is_no_verdict():
    found = verdict("negative drag")
    assert all(each.kind.name != "quadratic_damping" for each in found.what)
    assert "gives energy" in found.statement()


@pytest.mark.long
def test_no_alarm_in_twenty_empty_cases():
    v = decays(FORCES["none"])
    for seed in range(20):
        for noise_db in (-40.0, -70.0):
            curves = measured(FORCES["none"], noise_db, seed, v)
            assert not diagnose_curves("iwan4", curves[:3], curves[3:]).detected


def test_bad_curves_get_one_clear_line(told):
    run = told["none"].runs[0]
    with pytest.raises(InputError, match="no curves"):
        diagnose_curves("iwan4", [])
    other = run.measured[0].as_quantity("displacement")
    with pytest.raises(InputError, match="different quantities"):
        diagnose_curves("iwan4", run.measured[0], other)
    with pytest.raises(InputError, match="cubic_stifness"):
        diagnose_curves("iwan4", run.measured[0], hypotheses=("cubic_stifness",))


def test_a_budget_that_is_too_short_is_said(told):
    curves = told["none"].runs[0].measured
    found = diagnose_curves("iwan4", curves[:3], curves[3:], budget=0.0)
    assert not found.complete
    assert not found.detected
    assert "too short" in found.statement()
    assert math.isfinite(found.before.hold_out)


# --- the command -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(told, tmp_path_factory):
    """A study of two modes from files of curves, of which one has a cubic spring."""
    folder = tmp_path_factory.mktemp("two_modes")
    entries = []
    for mode, name in (("plain", "none"), ("hardening", "cubic_stiffness")):
        for i, curve in enumerate(told[name].runs[0].measured):
            file, use = f"{mode}{i}.csv", "hold_out" if i == 3 else "fit"
            seen = curve.as_quantity("displacement")
            columns = [np.asarray(getattr(seen, each)) for each in COLUMNS]
            header = "amplitude,frequency_hz,damping,frequency_std,damping_std"
            np.savetxt(
                folder / file, np.transpose(columns), delimiter=",", header=header, comments=""
            )
            entries.append(f"  - {{file: {file}, kind: curves, use: {use}, mode: {mode}}}")
    modes = [f"    - {{name: {m}, band: [90, 150], joint: {{type: iwan4}}}}" for m in MODES]
    text = ["name: two modes", "model:", "  modal:", *modes, "recordings:", *entries]
    text += ["hypotheses: [cubic_stiffness]", "fit: {starts: 16}"]
    (folder / "study.yaml").write_text("\n".join(text))
    arguments = ["diagnose", str(folder / "study.yaml"), "--out", str(folder / "out")]
    return CliRunner().invoke(app, arguments), folder / "out"


def test_the_command_says_which_mode_lacks_what(written):
    result, out = written
    assert result.exit_code == 0, result.stderr
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["detected"]
    assert [(each["kind"], each["where"]) for each in found["what"]] == [
        ("cubic_stiffness", "hardening")
    ]
    assert found["what"][0]["parameters"]["k3"]["unit"] == "force/length^3"
    assert found["probability_nothing_missing"] < 0.01
    assert [found["modes"][mode]["detected"] for mode in MODES] == [False, True]
    assert found["fit"]["after"]["hold_out"] < found["fit"]["before"]["hold_out"]
    assert {each["mode"] for each in found["observables"]} == {1}
    assert "Nothing is missing" in result.stdout
    assert "hardening: A cubic spring is missing at hardening: k3 = " in result.stdout


def test_the_command_writes_pictures_and_a_page_of_both(written):
    _, out = written
    pictures = [f"{kind}_{mode}.png" for kind in ("diagnosis", "prediction") for mode in MODES]
    assert sorted(file.name for file in out.iterdir()) == sorted(
        [*pictures, "diagnosis.json", "report.html"]
    )
    page = (out / "report.html").read_text()
    assert all(f"{mode}: what it rests on" in page for mode in MODES)


@pytest.mark.long
def test_a_joint_left_out_of_a_linear_mode_is_found():
    """Its damping rises sixfold; a slider alone leaves a third of it."""
    curves = measured(FORCES["none"], -60.0, 1)
    damping = np.asarray(curves[0].damping)
    assert damping.max() > 4.5 * damping.min()
    tried = ("coulomb_friction", "iwan_joint")
    found = diagnose_curves("linear_spring", curves[:3], curves[3:], hypotheses=tried)
    first = found.what[0]
    assert first.kind.name == "iwan_joint"
    assert first.probability > 0.9
    values = {each.info.name: each for each in first.parameters}
    for name in ("F_S", "K_T", "chi", "beta"):
        assert abs(values[name].value - getattr(TRUTH, name)) < 3.0 * values[name].std
    # The modal mass is one: a force is an acceleration there.
    assert values["F_S"].info.dimension == "m/s^2"
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert found.before.hold_out > 0.5
    slider = next(each for each in found.what if each.kind.name == "coulomb_friction")
    assert slider.log_evidence < -100.0


@pytest.mark.long
def test_a_joint_left_out_with_a_hardening_neighbour_is_found():
    """Frequency falls, then turns upward: neither alone does both."""
    q = np.geomspace(1e-6, 3e-4, 24)
    joint = ij.Iwan4(F_S=5.0, K_T=2.0e4, chi=-0.3, beta=0.5)
    (cubic,) = CATALOGUE["cubic_stiffness"]
    assert isinstance(cubic, ForceKind)
    further = beside(cubic, 1.0, np.asarray(about(q)), 2.0 * np.pi * 80.0)
    further = jax.tree.map(lambda x: 1.5e11 * x, further)
    mode = ij.ModalOscillator(80.0, 1e-3, joint)
    f, zeta = map(np.asarray, mode.ringdown_frequency_and_damping(q, further))
    lowest = int(np.argmin(f))
    assert 0 < lowest < len(q) - 4
    assert f[0] - f[lowest] > 0.15
    rng, std = np.random.default_rng(0), (3e-3, 1e-2 * zeta)
    noisy = f + std[0] * rng.standard_normal(q.size), zeta + std[1] * rng.standard_normal(q.size)
    curves = [
        ij.ModalCurves(
            q[part],
            noisy[0][part],
            noisy[1][part],
            frequency_std=np.full(q.size, std[0])[part],
            damping_std=std[1][part],
            quantity="displacement",
            unit="m",
            name=name,
        )
        for name, part in (("fitted", slice(0, 21)), ("harder", slice(21, 24)))
    ]
    tried = ("cubic_stiffness", "iwan_joint")
    found = diagnose_curves("linear_spring", curves[:1], curves[1:], hypotheses=tried)
    assert found.verdict.name == "something_missing"
    assert {each.label for each in found.found} == {"iwan_joint@mode", "cubic_stiffness@mode"}
    (hardening,) = next(each for each in found.found if each.kind is cubic).parameters
    assert abs(hardening.value - 1.5e11) < 3.0 * hardening.std
    assert found.after.hold_out < 3.0 * np.hypot(
        found.noise_floor.hold_out, found.parameter_spread.hold_out
    )
    assert "joint" in found.statement()
    assert "cubic spring" in found.statement()
