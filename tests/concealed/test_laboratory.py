"""The laboratory's recordings obey the equation of motion, and its models are off as stated."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import yaml
from concealed import disturbances, frozen
from concealed.excitation import band, coloured, multisine, stepped, sweep
from concealed.lab_forces import happens, study_inputs
from concealed.lab_plan import LINES, OFF, TRUST, lab_plan
from concealed.laboratory import clean, lab_cases, needs, write
from concealed.rigs import ground_motion, on_shaken_ground, with_shaker
from concealed.structures import STRUCTURES, chain
from scipy.linalg import eigh
from scipy.signal import StateSpace, lsim

from iwanjax.trial import acquisition
from iwanjax.trial.structure import inexact, tangent_stiffness

STEP = 8


def short(excitation: str):
    """The first linear case of a kind of excitation, one short recording from rest."""
    case = next(c for c in lab_plan() if c.line[1] == excitation and not c.true and not c.tangent)
    take = replace(case.hardest, samples=400, divisor=1, lead=0, state="rest", part=None)
    return replace(case, takes=(take,))


def accelerations(structure, force_rows, forces, dt):
    """Of the sensors of a linear structure from rest, by SciPy's own simulation."""
    n = len(structure.M)
    inverse = np.linalg.inv(structure.M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ structure.K, -inverse @ structure.C]])
    B = np.vstack([np.zeros((n, len(force_rows))), inverse @ np.transpose(force_rows)])
    sensors = np.stack(list(structure.sensors.values()))
    system = StateSpace(A, B, sensors @ A[n:], sensors @ B[n:])
    return lsim(system, forces, dt * np.arange(len(forces)))[1]


EXCITED = ("hammer", "random", "multisine", "sweep", "stepped", "shaker", "two_inputs", "base")


@pytest.mark.parametrize("excitation", EXCITED)
def test_what_is_recorded_obeys_the_equation_of_motion_under_the_measured_force(excitation):
    case = short(excitation)
    (take,) = case.takes
    fine = happens(case, [take], oversampling=STEP)
    structure, dt = case.structure, 1.0 / (case.structure.rate * STEP)
    bare = on_shaken_ground(structure) if excitation == "base" else structure
    rows = [bare.inputs[name] for name in study_inputs(case)]
    expected = accelerations(bare, rows, fine.force[:, 0], dt)
    if excitation == "base":
        moved = np.stack(list(structure.sensors.values())) @ ground_motion(structure)
        expected = expected + fine.force[:, 0, -1:] * moved
        assert np.allclose(moved, 1.0)
    assert np.abs(fine.force).max() > 0.0
    assert np.max(np.abs(fine.response[:, 0] - expected)) < 2e-3 * np.max(np.abs(expected))


def test_a_free_decay_has_no_force_left():
    case = next(c for c in lab_plan() if c.line[:2] == ("chain3", "decay"))
    case = replace(case, takes=tuple(replace(t, samples=300) for t in case.takes[:1]))
    ((response, force),) = clean(case)
    assert np.abs(response).max() > 10.0
    assert np.abs(force).max() < 1e-3 * case.structure.peaks["m1"]


@pytest.mark.long
def test_a_periodic_recording_repeats_itself_to_below_its_noise():
    case = next(c for c in lab_plan() if c.line[:2] == ("chain4", "multisine"))
    take = case.takes[0]
    case = replace(case, takes=(replace(take, samples=2 * round(2048 / take.divisor)),))
    ((response, force),) = clean(case)
    period = len(response) // 2
    scatter = np.std(response[:period] - response[period:]) / np.std(response)
    assert scatter < 0.1 * case.noise.share
    assert np.allclose(force[:period], force[period:], atol=1e-6 * np.abs(force).max())


def test_the_force_of_a_shaker_drops_at_resonance():
    structure = chain(3)
    rigged, stinger = with_shaker(structure, "m1")
    stuck = tangent_stiffness(rigged)
    f = np.sqrt(eigh(tangent_stiffness(structure), structure.M, eigvals_only=True)) / (2 * np.pi)

    def measured(hz):
        w = 2 * np.pi * hz
        u = np.linalg.solve(stuck + 1j * w * rigged.C - w**2 * rigged.M, rigged.inputs["drive"])
        return abs(stinger @ u)

    assert measured(f[0]) < 0.5 * min(measured(0.85 * f[0]), measured(1.15 * f[0]))


@pytest.mark.parametrize("name", ["chain4", "lap_beam", "brake_reuss"])
def test_a_model_that_is_off_is_so_by_what_is_stated_and_keeps_its_shapes(name):
    structure, rng = STRUCTURES[name], np.random.default_rng(0)
    stuck = tangent_stiffness(structure)
    seen = eigh(stuck, structure.M, eigvals_only=True) < (2 * np.pi * band(structure)[1]) ** 2
    shifts = np.where(seen, 0.005 * rng.standard_normal(len(stuck)), 0.0)
    damped = np.where(seen, 0.2 * rng.standard_normal(len(stuck)), 0.0)
    K, C = inexact(structure, stuck, shifts, damped)
    squared, shapes = eigh(stuck, structure.M)
    off = K + stuck - structure.K
    modal = shapes.T @ off @ shapes
    assert np.sqrt(np.diag(modal) / squared) - 1 == pytest.approx(shifts, abs=1e-7)
    assert modal - np.diag(np.diag(modal)) == pytest.approx(0.0, abs=1e-7 * squared[-1])
    ratio = np.diag(shapes.T @ C @ shapes) / np.diag(shapes.T @ structure.C @ shapes)
    assert ratio / (1 + shifts) - 1 == pytest.approx(damped, abs=1e-9)


def test_the_deviations_of_all_models_have_the_trusted_size():
    off = [case for case in lab_plan() if case.line[4] == OFF]
    frequencies = np.concatenate([case.frequencies[case.frequencies != 0] for case in off])
    dampings = np.concatenate([case.dampings[case.dampings != 0] for case in off])
    assert len(frequencies) > 100
    assert np.std(frequencies) == pytest.approx(TRUST["frequencies"], rel=0.2)
    assert np.std(dampings) == pytest.approx(TRUST["damping"], rel=0.2)
    for case in off:
        # As a structure still: nothing lets go once all joints slip.
        before, after = (eigh(s.K, s.M, eigvals_only=True)[0] for s in (case.known, case.model()))
        assert after > 0.9 * before
    for case in lab_plan():
        if case.line[4] != OFF:
            given, known = case.model().K, case.known.K
            assert np.allclose(given, known, rtol=0.0, atol=1e-12 * np.abs(known).max())


def test_the_plan_is_balanced():
    assert len(LINES) == 60
    empty = [line for line in LINES if not line[5]]
    assert len(empty) == 20
    assert {line[4] for line in empty} == {OFF}
    assert min(Counter(line[1] for line in LINES).values()) >= 5
    assert min(Counter(line[1] for line in empty).values()) >= 2
    assert min(Counter(line[0] for line in LINES).values()) >= 5
    for case in lab_plan():
        assert {take.use for take in case.takes} == {"fit", "hold_out"}
        assert all(2000 <= take.samples <= 8000 for take in case.takes)
        assert all(1 < len(take.sensors) <= 6 for take in case.takes)


def test_excitations_hold_what_they_promise():
    rng, dt = np.random.default_rng(0), 1e-4
    time, edges = dt * np.arange(40000), (10.0, 100.0)
    f = np.fft.rfftfreq(len(time), dt)
    for signal in (coloured(time, 0.0, edges, rng), sweep(time, 0.0, 4.0, edges)):
        power = np.abs(np.fft.rfft(signal)) ** 2
        within = (f > 0.8 * edges[0]) & (f < 1.2 * edges[1])
        assert power[within].sum() > 0.99 * power.sum()
    lines = np.abs(np.fft.rfft(multisine(10000, 10000, dt, edges, rng)))
    assert lines[10:101] == pytest.approx(lines[10])
    assert lines[101:].max() < 1e-6 * lines[10]
    sine = stepped(time, 0.0, 4.0, np.array([20.0, 50.0]))
    assert np.argmax(np.abs(np.fft.rfft(sine[:20000]))) == 40
    assert np.abs(np.diff(sine)).max() < 1.01 * np.sqrt(2) * 2 * np.pi * 50.0 * dt


def test_nuisances_have_their_size_and_colour():
    rng = np.random.default_rng(0)
    noise = disturbances.pink(16384, 2, rng)
    assert noise.std(axis=0) == pytest.approx(1.0, abs=0.05)
    power = np.mean(np.abs(np.fft.rfft(noise, axis=0)) ** 2, axis=1)
    assert power[10:40].mean() > 20 * power[4000:].mean()
    path = disturbances.wander(4000, rng)
    assert np.mean(path**2) == pytest.approx(1.0)
    assert np.mean(path) == pytest.approx(0.0, abs=1e-12)
    stored = disturbances.quantised(np.linspace(-1, 1, 999), 8.0)
    assert np.abs(stored - np.linspace(-1, 1, 999)).max() <= 0.5 * 8.0 / 2**15 + 1e-12
    time = 1e-4 * np.arange(100000)
    passed = acquisition.high_passed(np.sin(2 * np.pi * 10.0 * time), 10.0, 1e4)
    assert np.abs(passed[50000:]).max() == pytest.approx(np.sqrt(0.5), rel=1e-3)


@pytest.mark.long
def test_a_case_is_the_same_every_time_and_says_what_it_needs(tmp_path):
    case = next(c for c in lab_cases() if c.line[:2] == ("chain2", "hammer"))
    for name in ("first", "second"):
        write(case, tmp_path / name)
    for file in ("rec1.npz", "rec4.npz", "model.npz"):
        one, two = (np.load(tmp_path / name / file) for name in ("first", "second"))
        assert all(np.array_equal(one[key], two[key]) for key in one)
    study = yaml.safe_load((tmp_path / "first" / "study.yaml").read_text())
    assert [each["use"] for each in study["recordings"]] == ["fit", "fit", "fit", "hold_out"]
    assert study["recordings"][0]["initial"] == "unknown"
    assert study["recordings"][0]["from"] > 0
    truth = json.loads((tmp_path / "first" / "truth.json").read_text())
    assert (truth["kind"], truth["where"]) == ("sensor_high_pass", "a2")
    assert {"from, to", "initial: unknown", "sensor_high_pass"} <= set(truth["needs"])
    empty = next(c for c in lab_cases() if c.line[1] == "base")
    assert {"base", "trust"} <= set(needs(empty))


def test_a_summary_counts_by_excitation_and_forgives_mild_hum(tmp_path):
    for name, kind, tolerated in (("a", "none", ["sensor_hum@a1"]), ("b", "mass_error", [])):
        (tmp_path / name).mkdir()
        truth = {"kind": kind, "where": "m1", "excitation": "random", "tolerated": tolerated}
        (tmp_path / name / "truth.json").write_text(json.dumps(truth))
    assert frozen.graded(["sensor_hum@a1"], "something_missing", tmp_path / "a") == (True, False)
    assert frozen.graded(["sensor_gain@a1"], "something_missing", tmp_path / "a") == (False, True)
    assert frozen.graded([], "undecided", tmp_path / "a") == (False, False)
    assert frozen.graded(["mass_error@m1"], "something_missing", tmp_path / "b") == (True, False)
    floors = {"after": {"hold_out": 1.4}, "noise_floor": {"hold_out": 1.0}}
    kept = {
        "a": {"truth": [], "right": False, "alarm": True, "fit": floors},
        "b": {"truth": ["mass_error@m1"], "right": True, "alarm": False, "error": "none"},
    }
    (tmp_path / "kept.json").write_text(json.dumps(kept))
    lines = frozen.summary(tmp_path / "kept.json", tmp_path).splitlines()
    assert [" ".join(part.split()) for part in lines[1].split("|")] == [
        "all",
        "100 % of 1",
        "100 % of 1",
        "50 % of 2",
    ]
    assert lines[-1].endswith("b")
