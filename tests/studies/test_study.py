"""A study from a file and one from what is in memory are the same, and do what the library does."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.studies import StudyResults

ROOT = Path(__file__).resolve().parents[2]
HITS = ROOT / "configs" / "modal_ringdown"
MODE = {"name": "mode1", "band": (90, 150), "joint": {"type": "iwan4"}}
JOINT = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
SENSORS = {f"u{i + 1}": row for i, row in enumerate(np.eye(3))}
BLOW = {"type": "point_impact", "input": "u2", "p": 50, "omega": 1.744}
CASES = [
    {"name": "hit", "dt": 0.05, "duration": 6, "excitation": BLOW},
    {"name": "weak", "dt": 0.05, "duration": 6, "values": {"J1.F_S": 0.1}, "excitation": BLOW},
    {"name": "loop", "dt": 0.01, "duration": 2, "drive": {"amplitude": 20}},
]
LEVELS = np.geomspace(1e-2, 1.0, 12)
QSMA = {"modes": (0, 2), "alpha": LEVELS, "zeta0": 1e-4}


def hits():
    options: dict[str, Any] = {"channels": ["tip"], "quantity": "velocity", "unit": "m/s"}
    return [ij.read_recording(HITS / f"hit{i}.npz", **options) for i in (1, 2, 3, 4)]


def modal(**sections):
    *fitted, last = hits()
    held_out = ij.Measurement(last, use="hold_out")
    return ij.Study(recordings=[*fitted, held_out], modal=[MODE], name="beam", **sections)


def chain(**more):
    return ij.Study(ij.three_mass(joint=JOINT, zeta=1e-3), sensors=SENSORS, **more)


@pytest.fixture(scope="module")
def fits():
    # Few starts, as many in both.
    given = modal(fit={"starts": 4}).fit()
    read = ij.load_study(ROOT / "configs" / "modal_ringdown.yaml")
    settings = read.setup.fit.model_copy(update={"starts": 4})
    return given, ij.Study.of(dataclasses.replace(read.setup, fit=settings)).fit()


def test_a_fit_of_arrays_is_that_of_the_file_and_near_the_truth(fits):
    given, read = (each["mode1"] for each in fits)
    assert given.solution.values == pytest.approx(read.solution.values, rel=1e-9)
    (one,), (other,) = given.held_out, read.held_out
    assert one.frequency_error == pytest.approx(other.frequency_error, rel=1e-6)
    truth = json.loads((HITS / "truth.json").read_text())["parameters"]
    f_0 = given.solution.values["f_0"]
    assert abs(f_0 - truth["f_0"]) < 3.0 * given.solution.std["f_0"]


def test_a_fit_tells_its_table_and_gives_a_model_to_simulate(fits):
    fit = fits[0].only
    summary = fits[0].summary()
    assert summary.startswith("mode1: ModalOscillator with Iwan4")
    assert "held out hit4.npz: predicted within" in summary
    low = fit.structure.modes().omega[0] / (2.0 * np.pi)
    assert_allclose(low, fit.solution.values["f_0"], rtol=1e-12)
    assert fit.structure.joints["J1"] == fit.solution.model.joint


def test_curves_are_those_of_the_library():
    study = modal()
    mode = study.curves().only
    assert [hit.name for hit in mode.hits] == ["hit1.npz", "hit2.npz", "hit3.npz"]
    recording = hits()[1]
    expected = ij.ringdown_curves(
        recording.response[:, 0], recording.sampling_rate, (90.0, 150.0), quantity="velocity"
    )
    assert_allclose(mode.hits[1].curves.damping, expected.damping, rtol=1e-12)
    assert_allclose(mode.curves.frequency, mode.merged.curves.frequency)
    assert "3 recording(s) to fit, 1 held out" in study.curves().summary()


def test_part_of_a_recording_is_analysed_as_it_is_in_a_file(tmp_path):
    first = hits()[0]
    given = ij.Study(recordings=[ij.Measurement(first, start=0.5, end=3.0)], modal=[MODE])
    text = (
        "name: a\nmodel: {modal: [{name: mode1, band: [90, 150], joint: {type: iwan4}}]}\n"
        f"recordings: [{{file: {HITS / 'hit1.npz'}, kind: free_decay, from: 0.5, to: 3,\n"
        "  response: {array: response, channel: tip, quantity: velocity}}]\n"
    )
    (tmp_path / "study.yaml").write_text(text)
    one, other = (
        each.curves().only.curves for each in (given, ij.load_study(tmp_path / "study.yaml"))
    )
    assert_allclose(one.damping, other.damping, rtol=1e-12)
    whole = modal().curves().only.hits[0].curves
    assert one.amplitude.size < whole.amplitude.size


def test_qsma_is_that_of_the_library():
    found = chain(qsma=QSMA).qsma()
    structure = ij.three_mass(joint=JOINT, zeta=1e-3)
    expected = ij.qsma(structure, [0, 2], LEVELS, 1e-4)
    assert_allclose(found.curves.damping, expected.curves.damping, rtol=1e-12)


@pytest.fixture(scope="module")
def simulated():
    return chain(simulate=CASES).simulate()


def test_simulations_are_those_of_the_library(simulated):
    t = 0.05 * np.arange(121)
    force = np.where(t < np.pi / 1.744, 50.0 * np.sin(1.744 * t), 0.0)
    structure = ij.three_mass(joint=JOINT, zeta=1e-3)
    expected = ij.simulate(structure, force[:, None], 0.05, inputs=[0, 1, 0])
    assert list(simulated) == ["hit", "weak", "loop"]
    assert_allclose(simulated["hit"].displacement, expected.displacement, atol=1e-12)
    assert all(simulated.seconds[name] > 0.0 for name in simulated)


def test_a_case_has_values_of_its_own(simulated):
    assert np.abs(simulated["weak"].joint_force).max() <= 0.1 * (1.0 + 1e-9)
    assert np.abs(simulated["hit"].joint_force).max() > 0.5


def test_a_driven_joint_closes_its_loop(simulated):
    loop = simulated["loop"]
    secant, dissipation = loop.steady_cycle()
    assert_allclose([loop.secant, loop.area], [secant, dissipation], rtol=1e-3)
    assert_allclose(dissipation, JOINT.dissipation(loop.amplitude), rtol=1e-12)


def test_a_study_of_fitted_joints_simulates_with_them(simulated):
    study = chain(simulate=CASES)
    softer = study.structure.with_joints({"J1": ij.Iwan4(F_S=3.0, K_T=0.5, chi=-0.2, beta=1.0)})
    found: Any = study.with_structure(softer).simulate("hit", "weak")
    assert np.abs(found["hit"].joint_force).max() < 3.0
    assert np.abs(found["hit"].displacement - simulated["hit"].displacement).max() > 1e-2
    # What a case says of its joints holds for any structure.
    assert np.abs(found["weak"].joint_force).max() <= 0.1 * (1.0 + 1e-9)
    assert study.structure.joints["J1"] == JOINT
    with pytest.raises(InputError, match="expected 3 coordinates with joints J1"):
        study.with_structure(ij.oscillator(stiffness=1.0, joint=JOINT))
    with pytest.raises(InputError, match="single modes"):
        modal().with_structure(softer)


def test_a_structure_is_fitted_to_curves_in_memory():
    structure = ij.three_mass(joint=JOINT)
    a, f, zeta = (
        np.asarray(getattr(ij.qsma(structure, 1, LEVELS, 1e-4).curves, name))
        for name in ("amplitude", "frequency", "damping")
    )
    curves = ij.ModalCurves(a, f, zeta, frequency_std=1e-5 * f, damping_std=1e-3 * zeta)
    measured = [ij.Measurement(curves, mode=1)]
    wrong = structure.with_joints({"J1": ij.Iwan4(F_S=10.0, K_T=1.3, chi=-0.4, beta=5.0)})
    fixed = {"J1.F_S": 10, "J1.beta": 5}
    fit = ij.Study(wrong, measured, name="chain", fixed=fixed, fit={"starts": 4}).fit()["chain"]
    joint: Any = fit.structure.joints["J1"]
    assert_allclose([joint.K_T, joint.chi], [1.0, -0.5], rtol=0.05)


def test_nothing_is_written_and_nothing_can_be_changed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study: Any = modal()
    curves: Any = study.curves()
    chain(simulate=CASES[0]).simulate()
    assert list(tmp_path.iterdir()) == []
    for frozen, name in ((study, "setup"), (study.setup, "seed"), (curves, "by_name")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(frozen, name, None)


def test_a_posterior_goes_on_where_its_chain_is_kept(fits, tmp_path):
    study = modal(posterior={"effective": 10, "walkers": 20, "most_steps": 250})
    chains = {"mode1": tmp_path / "chain.h5"}
    found = study.posterior(fits[0], chains=chains).only
    assert (tmp_path / "chain.h5").exists()
    assert_allclose(study.posterior(fits[0], chains=chains).only.chain, found.chain)


def test_priors_and_bounds_are_objects_or_as_in_a_file(fits):
    prior = ij.LogNormal(1.0, 0.5)
    study = modal(priors={"mode1.beta": prior}, bounds={"mode1.chi": (-0.9, -0.1)})
    change = study.setup.changes["mode1.beta"]
    assert change.prior is prior
    told = {"type": "log_normal", "median": 1, "sigma": 0.5}
    assert modal(priors={"mode1.beta": told}).setup.changes["mode1.beta"].prior == prior
    assert study.setup.changes["mode1.chi"].bounds == (-0.9, -0.1)


def test_it_says_what_it_is():
    assert repr(modal()) == "Study('beam': modes mode1; 4 recording(s))"
    assert repr(chain()) == "Study('study': 3 coordinates with J1; 0 recording(s))"


def test_rows_may_be_of_jax_or_lists():
    study = chain(rows={"m3": jnp.array([0.0, 0.0, 1.0])}, inputs={"f": [0, 1, 0]})
    assert list(study.setup.model.rows) == ["J1", "m3"]
    assert study.setup.model.inputs["f"].tolist() == [0.0, 1.0, 0.0]


def test_arrays_and_tuples_are_what_lists_are_in_a_file():
    study = chain(modes=np.array([0, 2]), bands={0: (0.05, np.float64(0.09))}, qsma=QSMA)
    assert study.setup.modes == (0, 2)
    assert study.setup.bands == {0: (0.05, 0.09)}
    ranged = chain(qsma={**QSMA, "alpha": {"from": 1e-2, "to": 1.0, "count": 12}})
    assert_allclose(study.setup.qsma.levels, ranged.setup.qsma.levels)


def test_a_single_one_needs_no_list():
    one, other = (
        ij.Study(recordings=given, modal=mode)
        for given, mode in (([hits()[0]], [MODE]), (hits()[0], MODE))
    )
    assert one.setup.modal == other.setup.modal
    (first,), (second,) = one.setup.recordings, other.setup.recordings
    assert (first.name, first.modes) == (second.name, second.modes) == ("hit1.npz", ("mode1",))


def test_recordings_without_names_are_told_apart():
    decay = hits()[0]
    unnamed = [ij.as_recording(decay.response, sampling_rate=2048.0) for _ in range(2)]
    study = ij.Study(recordings=[*unnamed, ij.Measurement(decay, name="last")], modal=[MODE])
    assert [each.name for each in study.setup.recordings] == [
        "recording[0]",
        "recording[1]",
        "last",
    ]


def test_results_are_shown_saved_and_loaded(fits, tmp_path):
    assert "<table" in fits[0]._repr_html_()
    fits[0].save(tmp_path / "fits.npz")
    again = StudyResults.load(tmp_path / "fits.npz")
    assert again.only.solution.values == fits[0].only.solution.values
    assert again.summary() == fits[0].summary()
    curves = modal().curves()
    curves.save(tmp_path / "curves.npz")
    mode = StudyResults.load(tmp_path / "curves.npz")["mode1"]
    assert mode.summary() == curves.summary()
    assert curves.to_dict()["by_name"]["mode1"]["band"] == [90.0, 150.0]


def test_a_result_draws_itself(fits, simulated):
    for result in (modal().curves(), fits[0], simulated["loop"]):
        figure = result.plot()
        assert figure.axes
        plt.close(figure)
