"""The verb simulate: a study's cases in time."""

import json

import numpy as np
import pytest
from dynamics.test_step_length import Mistaken
from numpy.testing import assert_allclose
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.dynamics import half_sine, modal_input, ramp, sine, sweep
from iwanjax.dynamics.transient import QUANTITIES
from iwanjax.joints import JOINTS

STEP, SAMPLES = 0.05, 121
TIME = STEP * np.arange(SAMPLES)
# Cases of one shape share their compiled kernel.
STUDY = """\
name: chain
model: {builder: three_mass, options: {zeta: 1e-3}}
simulate:
  - name: hit
    dt: 0.05
    duration: 6
    excitation: {type: point_impact, input: u2, p: 50, omega: 1.744}
"""
CASE = "{type: point_impact, input: u2, p: 50, omega: 1.744}"
DRIVE = """\
name: element
model:
  builder: oscillator
  options: {stiffness: 5e5}
  joints:
    - {name: J1, type: iwan5, parameters: {R: 7e5, S: 9e3, chi: -0.6, phi_max: 6e-4, theta: 0.3}}
simulate:
  name: down/up
  dt: 2e-3
  duration: 4
  sliders: 10000
  drive: {amplitude: {from: 5.5e-4, to: 2e-4, duration: 2}}
"""


def run(study, out):
    return CliRunner().invoke(app, ["simulate", str(study), "--out", str(out)])


@pytest.fixture
def study(tmp_path):
    def write(text):
        path = tmp_path / "study.yaml"
        path.write_text(text)
        return path

    return write


def simulated(path, out):
    result = run(path, out)
    assert result.exit_code == 0, result.stderr
    assert result.stderr == ""
    with np.load(out / "simulate.npz") as file:
        arrays = dict(file)
    return result, json.loads((out / "simulate.json").read_text()), arrays


def expected(force, row, system=None, **options):
    """By the library, of which the command keeps the energy as well: one kernel for both."""
    keep = [*QUANTITIES, "energy"]
    structure = system or ij.three_mass(zeta=1e-3)
    return ij.simulate(structure, force, STEP, inputs=row, keep=keep, **options)


def test_numbers_and_pictures_are_written(study, tmp_path):
    out = tmp_path / "results" / "chain"
    result, told, arrays = simulated(study(STUDY), out)
    assert sorted(file.name for file in out.iterdir()) == [
        "simulate.json",
        "simulate.npz",
        "simulate_hit.png",
    ]
    assert (out / "simulate_hit.png").read_bytes().startswith(b"\x89PNG")
    assert result.stdout.splitlines()[-1] == f"wrote {out / 'simulate.json'}"
    assert "hit: 120 steps of 0.05 s (exact)" in result.stdout
    found = expected(half_sine(TIME, 50.0, 1.744), np.eye(3)[1])
    for name in ("time", "displacement", "velocity", "acceleration", "joint_force"):
        assert_allclose(arrays[f"hit_{name}"], getattr(found, name), rtol=1e-9, atol=1e-12)
    assert list(arrays["hit_sensors"]) == ["u1", "u2", "u3"]
    assert list(arrays["hit_joints"]) == ["J1"]
    assert (told["study"], told["iwanjax"]) == ("chain", ij.__version__)
    (case,) = told["cases"]
    assert case["balanced"]
    assert (case["steps"], case["dt"]) == (120, pytest.approx(STEP))
    peak = case["sensors"]["u3"]["displacement"]
    history = np.asarray(found.displacement)[:, 2]
    at = np.argmax(np.abs(history))
    assert_allclose([peak["value"], peak["time"]], [history[at], TIME[at]])
    energy = case["energy"]
    held = energy["kinetic"] + energy["elastic"] + energy["stored"]
    assert_allclose(energy["work"], held + energy["viscous"] + energy["joints"], rtol=1e-4)
    assert energy["imbalance"] < 1e-4 * energy["work"]


def test_newmark_tells_what_it_does_to_frequencies(study, tmp_path):
    text = STUDY.replace("duration: 6", "samples: 121\n    method: newmark\n    every: 2")
    result, told, arrays = simulated(study(text), tmp_path / "out")
    found = expected(half_sine(TIME, 50.0, 1.744), np.eye(3)[1], method="newmark", every=2)
    assert_allclose(arrays["hit_displacement"], found.displacement, rtol=1e-9, atol=1e-12)
    (case,) = told["cases"]
    omega = np.asarray(ij.three_mass().modes().omega)
    assert_allclose(case["frequency_error"], -((omega * STEP) ** 2) / 12.0, rtol=1e-12)
    assert case["steps"] == 120
    assert "newmark lowers natural frequencies by up to 0.063 %" in result.stdout


SYSTEM = ij.three_mass(zeta=1e-3)
FORCES = {
    "one mode": (
        "{type: modal_impact, mode: 1, p: 30, limit: high}",
        lambda: half_sine(TIME, 30.0, SYSTEM.modes().omega[1]),
        lambda: modal_input(SYSTEM, 1, "high"),
    ),
    "a blow of some length": (
        "{type: point_impact, input: u1, p: -5, duration: 2}",
        lambda: half_sine(TIME, -5.0, np.pi / 2.0),
        lambda: np.eye(3)[0],
    ),
    "a pair of forces": (
        "{type: sine, input: J1, amplitude: 2, frequency: 0.2}",
        lambda: sine(TIME, 2.0, 0.4 * np.pi),
        lambda: np.array([0.0, -1.0, 1.0]),
    ),
    "a ramp along a direction": (
        "{type: sine, input: [1, 0, -1], amplitude: {from: 6, to: 1, duration: 3}, omega: 1.2}",
        lambda: sine(TIME, ramp(TIME, 6.0, 1.0, 3.0), 1.2),
        lambda: np.array([1.0, 0.0, -1.0]),
    ),
    "a sweep": (
        "{type: sweep, input: u3, amplitude: 1, from: 0.3, to: 0.1, kind: log}",
        lambda: sweep(TIME, 1.0, (0.3, 0.1), "log"),
        lambda: np.eye(3)[2],
    ),
}


def test_every_kind_of_force_is_the_library_s(study, tmp_path):
    head, _, tail = STUDY.partition("  - name: hit\n")
    cases = [
        f"  - name: {name}\n" + tail.replace(CASE, text) for name, (text, *_) in FORCES.items()
    ]
    _, told, arrays = simulated(study(head + "".join(cases)), tmp_path / "out")
    assert [case["name"] for case in told["cases"]] == list(FORCES)
    for name, (_, force, row) in FORCES.items():
        found = expected(force(), row())
        label = name.replace(" ", "_")
        assert_allclose(arrays[f"{label}_displacement"], found.displacement, rtol=1e-9, atol=1e-12)
        assert np.any(found.displacement)
        assert (tmp_path / "out" / f"simulate_{label}.png").is_file()
    sines = [case for case in told["cases"] if "last_amplitude" in case]
    assert len(sines) == 2
    last = arrays["a_pair_of_forces_displacement"][-101:]
    assert_allclose(sines[0]["last_amplitude"]["u1"], 0.5 * np.ptp(last[:, 0]))


def test_a_recorded_force_brings_its_own_time(study, tmp_path):
    force = np.asarray(half_sine(TIME, 50.0, 1.744))
    np.savez(tmp_path / "rec1.npz", time=TIME, response=np.sin(TIME), hammer=force)
    text = STUDY.replace("    dt: 0.05\n    duration: 6\n", "").replace(
        CASE, "{type: recording, file: rec1.npz, array: hammer, input: u2}"
    )
    _, _, arrays = simulated(study(text), tmp_path / "out")
    found = expected(force, np.eye(3)[1])
    assert_allclose(arrays["hit_displacement"], found.displacement, rtol=1e-9, atol=1e-12)


def test_a_model_file_brings_its_own_labels(study, tmp_path):
    labels = {"row_labels": ["J1"], "sensor_labels": ["tip", "root"], "input_labels": ["hammer"]}
    np.savez(
        tmp_path / "model.npz",
        **{name: np.asarray(getattr(SYSTEM.structure, name)) for name in "MCK"},
        **{name: np.array(values) for name, values in labels.items()},
        rows=np.array([[0.0, -1.0, 1.0]]),
        sensor_rows=np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        input_rows=np.array([[0.0, 1.0, 0.0]]),
    )
    joints = "[{name: J1, type: iwan4, parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}}]"
    text = STUDY.replace(
        "{builder: three_mass, options: {zeta: 1e-3}}", f"{{file: model.npz, joints: {joints}}}"
    ).replace("input: u2", "input: hammer")
    path = study(text)
    _, _, arrays = simulated(path, tmp_path / "out")
    assert list(arrays["hit_sensors"]) == ["tip", "root"]
    found = expected(half_sine(TIME, 50.0, 1.744), np.eye(3)[1]).displacement
    assert_allclose(arrays["hit_displacement"], np.asarray(found)[:, [2, 0]], rtol=1e-8, atol=1e-9)
    chosen = "    sensors: [u2, root]\n    keep: displacement\n    excitation"
    _, told, arrays = simulated(study(text.replace("    excitation", chosen)), tmp_path / "out")
    assert_allclose(arrays["hit_displacement"], np.asarray(found)[:, [1, 0]], rtol=1e-8, atol=1e-9)
    assert "hit_velocity" not in arrays
    assert "energy" not in told["cases"][0]
    assert list(told["cases"][0]["sensors"]) == ["u2", "root"]


def test_a_case_may_have_other_joints(study, tmp_path):
    text = STUDY.replace("    dt", "    values: {J1.F_S: 2, J1.chi: -0.2}\n    dt")
    _, _, arrays = simulated(study(text), tmp_path / "out")
    other = SYSTEM.with_joints({"J1": ij.Iwan4(F_S=2.0, K_T=1.0, chi=-0.2, beta=5.0)})
    found = expected(half_sine(TIME, 50.0, 1.744), np.eye(3)[1], other)
    assert_allclose(arrays["hit_displacement"], found.displacement, rtol=1e-9, atol=1e-12)


def test_what_makes_no_picture_is_written_all_the_same(study, tmp_path):
    out = tmp_path / "out"
    _, told, arrays = simulated(
        study(STUDY.replace("    dt", "    keep: joint_force\n    dt")), out
    )
    assert sorted(file.name for file in out.iterdir()) == ["simulate.json", "simulate.npz"]
    assert list(told["cases"][0]["joints"]["J1"]) == ["force"]
    assert arrays["hit_joint_force"].shape == (SAMPLES, 1)


@pytest.mark.parametrize(
    ("joint", "drive", "area"),
    [
        # pi c omega d^2, by a thousand trapezia.
        ("dashpot, parameters: {c: 2}", "{amplitude: 3, frequency: 0.5}", 18.0 * np.pi**2),
        ("linear_spring, parameters: {k: 2}", "{amplitude: 3}", 0.0),
        ("linear_spring, parameters: {k: 2}", "{amplitude: 0}", None),
    ],
)
def test_other_elements_are_driven_too(study, tmp_path, joint, drive, area):
    text = (
        "name: a\nmodel: {builder: oscillator, options: {stiffness: 1}, joints: [{name: J1, "
        f"type: {joint}}}]}}\nsimulate: {{name: a, dt: 1e-3, duration: 4, drive: {drive}}}\n"
    )
    _, told, _ = simulated(study(text), tmp_path / "out")
    found = told["cases"][0]["last_loop"]["dissipation"]
    assert found == (None if area is None else pytest.approx(area, rel=1e-4, abs=1e-9))


@pytest.mark.reference
def test_a_driven_element_gives_table_4_1(study, tmp_path):
    out = tmp_path / "out"
    result, told, arrays = simulated(study(DRIVE), out)
    (case,) = told["cases"]
    assert (case["joint"], case["sliders"], case["steps"]) == ("J1", 10_000, 2000)
    loop, steady = case["last_loop"], case["steady_cycle"]
    assert loop["amplitude"] == pytest.approx(2e-4)
    # Sliders in place of a distribution; the last digits are those of its closed forms.
    assert loop["secant_stiffness"] == pytest.approx(3.9188e4, rel=1e-4)
    assert loop["dissipation"] == pytest.approx(1.5953e-3, rel=1e-3)
    # The second cycle at one amplitude closes.
    assert abs(loop["gap"]) < 1e-9 * loop["secant_stiffness"] * 2e-4
    assert steady["secant_stiffness"] == pytest.approx(4.5980e4, rel=1e-4)
    assert steady["dissipation"] == pytest.approx(8.4574e-4, rel=1e-4)
    assert "down/up: J1, 2000 steps; last loop of amplitude 0.0002: secant" in result.stdout
    assert (out / "simulate_down_up.png").is_file()
    joint = ij.Iwan5.from_distribution(R=7e5, S=9e3, chi=-0.6, phi_max=6e-4, theta=0.3)
    d = arrays["down_up_joint_deflection"]
    assert_allclose(d[[0, 250, 1000, 2000]], [5.5e-4, -4.625e-4, 2e-4, 2e-4], rtol=1e-9)
    assert_allclose(arrays["down_up_joint_force"], ij.hysteresis(joint, d, sliders=10_000))


def test_less_than_a_loop_has_no_area(study, tmp_path):
    text = DRIVE.replace("duration: 4\n", "duration: 0.5\n")
    result, told, _ = simulated(study(text), tmp_path / "out")
    assert told["cases"][0]["last_loop"]["dissipation"] is None
    assert "no whole loop at the end" in result.stdout


BAD = {
    # what: (text to replace, its replacement, line, words of the message)
    "misspelt key": ("duration:", "duraton:", 6, ["simulate[0].duraton: unknown", "'duration'"]),
    "misspelt force": ("omega:", "omge:", 7, ["excitation.omge: unknown", "'omega'"]),
    "unknown type": ("point_impact", "impact", 7, ["'impact'", "modal_impact, point_impact"]),
    "no type": ("type: point_impact, ", "", 7, ["'type' is missing", "sweep"]),
    "no force": (f"    excitation: {CASE}\n", "", 4, ["neither", "excitation and drive"]),
    "not a force": (CASE, "3", 7, ["'3'", "mapping with type"]),
    "unknown input": ("input: u2", "input: u4", 7, ["no input 'u4'", "u1, u2, u3, J1"]),
    "an index": ("input: u2", "input: 1", 7, ["no input '1'", "u1, u2, u3"]),
    "direction too short": ("input: u2", "input: [1, 0]", 7, ["2 number(s)", "expected 3"]),
    "direction of nothing": ("input: u2", "input: [0, 0, 0]", 7, ["not all 0"]),
    "two lengths": ("omega: 1.744", "omega: 1, duration: 1", 7, ["omega and duration"]),
    "no such mode": (CASE, "{type: modal_impact, mode: 3, p: 1}", 7, ["got 3", "0 to 2"]),
    "no step": ("    dt: 0.05\n", "", 4, ["'dt' is missing", "dt: 1e-3"]),
    "negative step": ("dt: 0.05", "dt: -1", 5, ["dt", "'-1'"]),
    "no duration": ("    duration: 6\n", "", 4, ["neither", "duration and samples"]),
    "shorter than a step": ("duration: 6", "duration: 0.01", 6, ["0.2 steps of dt = 0.05"]),
    "too many steps": ("dt: 0.05", "dt: 5e-12", 6, ["1.2e+12 steps", "1e+08"]),
    "endless": (
        "    dt: 0.05\n    duration: 6",
        "    dt: 1e-300\n    duration: 1e300",
        6,
        ["inf steps"],
    ),
    "unknown method": ("duration: 6", "duration: 6\n    method: newmak", 7, ["'newmark'"]),
    "unknown sensor": ("duration: 6", "duration: 6\n    sensors: tip", 7, ["no sensor 'tip'"]),
    "unknown quantity": ("duration: 6", "duration: 6\n    keep: [veloc]", 7, ["'velocity'"]),
    "every beyond": ("duration: 6", "duration: 6\n    every: 121", 7, ["every", "120 steps"]),
    "too many modes": ("duration: 6", "duration: 6\n    modes: 9", 4, ["modes = 9", "1 to 3"]),
    "energy without modes": (
        "duration: 6",
        "duration: 6\n    modes: 1\n    keep: energy",
        8,
        ["needs all modes"],
    ),
    "unknown parameter": (
        "duration: 6",
        "duration: 6\n    values: {J1.theta: 1}",
        7,
        ["values.J1.theta: unknown", "J1.chi"],
    ),
    "parameter out of range": (
        "duration: 6",
        "duration: 6\n    values: {J1.chi: -2}",
        7,
        ["values.J1.chi: got -2", "(-1, inf)"],
    ),
    "sweep that stays": (
        CASE,
        "{type: sweep, input: u1, amplitude: 1, from: 1, to: 1}",
        7,
        ["excitation.to", "another"],
    ),
    "ramp without end": (
        CASE,
        "{type: sine, input: u1, amplitude: {from: 1, duration: 2}, omega: 1}",
        7,
        ["excitation.amplitude", "'to' is missing"],
    ),
    "a drive and a force": (
        f"    excitation: {CASE}\n",
        f"    excitation: {CASE}\n    drive: {{amplitude: 1}}\n",
        4,
        ["excitation and drive"],
    ),
    "drive by newmark": (
        f"    excitation: {CASE}\n",
        "    method: newmark\n    drive: {amplitude: 1}\n",
        7,
        ["simulate[0].method", "means nothing"],
    ),
    "no such joint": (
        f"    excitation: {CASE}\n",
        "    drive: {joint: J2, amplitude: 1}\n",
        7,
        ["drive.joint", "no joint 'J2'"],
    ),
    "no such recording": (
        f"    dt: 0.05\n    duration: 6\n    excitation: {CASE}\n",
        "    excitation: {type: recording, file: rec.npz, input: u1}\n",
        5,
        ["excitation.file", "rec.npz does not exist"],
    ),
    "a recording's step": (
        CASE,
        "{type: recording, file: study.yaml, input: u1}",
        5,
        ["simulate[0].dt", "has its own"],
    ),
    "not a recording": (
        f"    dt: 0.05\n    duration: 6\n    excitation: {CASE}\n",
        "    excitation: {type: recording, file: study.yaml, input: u1}\n",
        4,
        ["simulate[0]", "study.yaml"],
    ),
    "name twice": (
        f"    excitation: {CASE}\n",
        f"    excitation: {CASE}\n  - {{name: hit, dt: 1, duration: 9, excitation: {CASE}}}\n",
        8,
        ["simulate[1].name", "'hit' again"],
    ),
    "no cases": (STUDY[STUDY.index("simulate") :], "simulate: []\n", 3, ["at least one"]),
    "a word": (STUDY[STUDY.index("simulate") :], "simulate: hit\n", 3, ["'hit'", "a list"]),
    "no section": (STUDY[STUDY.index("simulate") :], "", None, ["simulate: {name: hit"]),
    "damping of a mechanism": ("zeta: 1e-3", "zeta: -1", 2, ["model.options.zeta", "negative"]),
}


@pytest.mark.parametrize(("old", "new", "line", "words"), BAD.values(), ids=BAD)
def test_bad_input_gives_one_line_and_no_results(study, tmp_path, old, new, line, words):
    assert old in STUDY
    path = study(STUDY.replace(old, new, 1))
    result = run(path, tmp_path / "out")
    assert result.exit_code == 2, result.stdout
    assert result.stdout == ""
    (said,) = result.stderr.splitlines()
    assert said.startswith(f"{path}: " if line is None else f"{path}:{line}: ")
    for word in words:
        assert word in said
    assert not (tmp_path / "out").exists()


def test_single_modes_have_no_structure(study, tmp_path):
    text = "model: {modal: [{name: a, band: [1, 2], joint: {type: iwan4}}]}"
    path = study(STUDY.replace(STUDY.splitlines()[1], text))
    result = run(path, tmp_path / "out")
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{path}:3: simulate: needs a structure" in result.stderr
    path.write_text(path.read_text()[: path.read_text().index("simulate")])
    result = run(path, tmp_path / "out")
    assert "simulate needs a structure" in result.stderr
    assert not (tmp_path / "out").exists()


def test_steps_without_balance_are_told(study, tmp_path, monkeypatch):
    def lost(*arguments, **options):
        found = ij.simulate(*arguments, **options)
        nothing = np.where(TIME[:, None] > 3.0, np.nan, np.asarray(found.displacement))
        return ij.SimulatedResponse(**{**vars(found), "displacement": nothing, "balanced": False})

    monkeypatch.setattr("iwanjax.studies.simulations.simulate", lost)
    result, told, _ = simulated(study(STUDY), tmp_path / "out")
    assert "hit: the joints found no balance" in result.stdout
    (case,) = told["cases"]
    assert not case["balanced"]
    assert 0 < case["sensors"]["u3"]["displacement"]["time"] <= 3.0


def test_nothing_is_left_half_written(study, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", full)
    out = tmp_path / "out"
    result = run(study(STUDY), out)
    assert result.exit_code == 2
    assert "No space left" in result.stderr
    assert list(out.iterdir()) == []


def test_a_step_that_is_too_long_is_shortened_or_refused(study, tmp_path):
    # 3.6 s is a period of the fastest mode; the blow's samples are straight lines all the same.
    longer = STUDY.replace("dt: 0.05", "dt: 1.8").replace("duration: 6", "duration: 216")
    longer = longer.replace("p: 50, omega: 1.744", "p: 5000, omega: 0.4")
    result, told, _ = simulated(study(longer), tmp_path / "out")
    (case,) = told["cases"]
    assert case["refined"] > 1
    assert case["dt"] == pytest.approx(1.8 / case["refined"])
    assert case["estimated_error"] <= 0.01
    assert case["energy_imbalance"] <= 0.01
    assert f"was divided by {case['refined']}" in result.stdout
    hopeless = longer.replace("dt: 1.8", "dt: 400").replace("duration: 216", "duration: 48000")
    hopeless = hopeless.replace("omega: 0.4", "omega: 0.0018")
    result = run(study(hopeless), tmp_path / "none")
    assert result.exit_code == 2
    assert "study.yaml:4: simulate[0]" in result.stderr
    assert "try steps of" in result.stderr
    assert not (tmp_path / "none").exists()
    # On request it may be had, unjudged.
    asked = hopeless.replace("dt: 400", "dt: 400\n    accuracy: null")
    result, told, _ = simulated(study(asked), tmp_path / "asked")
    assert told["cases"][0]["estimated_error"] is None


@pytest.mark.long
def test_energy_that_is_missing_ends_the_command(study, tmp_path, monkeypatch):
    monkeypatch.setitem(JOINTS, "mistaken", Mistaken)
    joint = "{name: J1, type: mistaken, parameters: {k3: 1}}"
    text = STUDY.replace(
        "{builder: three_mass, options: {zeta: 1e-3}}",
        f"{{builder: oscillator, options: {{stiffness: 1}}, joints: [{joint}]}}",
    ).replace("input: u2", "input: u1")
    result = run(study(text), tmp_path / "out")
    assert (result.exit_code, result.stdout) == (2, "")
    (said,) = result.stderr.splitlines()
    assert "study.yaml:4: simulate[0]" in said
    assert "% of the energy is missing" in said
    assert not (tmp_path / "out").exists()
