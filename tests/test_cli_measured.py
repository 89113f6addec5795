"""The verbs that start from recordings: inspect, curves, fit, posterior."""

import html.parser
import json
import shutil
from pathlib import Path

import emcee
import h5py
import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.signals import read_curves, read_recording, ringdown

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
STUDY = CONFIGS / "modal_ringdown.yaml"
TRUTH = json.loads((CONFIGS / "modal_ringdown" / "truth.json").read_text())["parameters"]


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


# --- what is written ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def curves(tmp_path_factory):
    out = tmp_path_factory.mktemp("curves")
    return run("curves", STUDY, "--out", out), out


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    out = tmp_path_factory.mktemp("fit")
    return run("fit", STUDY, "--out", out), out


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The default study beside its data, with a walk of a hundred steps."""
    folder = tmp_path_factory.mktemp("walk")
    shutil.copytree(CONFIGS / "modal_ringdown", folder / "modal_ringdown")
    text = STUDY.read_text() + "posterior: {effective: 1000, walkers: 20, most_steps: 100}\n"
    (folder / STUDY.name).write_text(text)
    return folder / STUDY.name


def test_curves_writes_numbers_and_pictures(curves):
    result, out = curves
    assert result.exit_code == 0, result.stderr
    assert sorted(file.name for file in out.iterdir()) == [
        "curves.json",
        "curves.npz",
        "curves_mode1.npz",
        "curves_mode1.png",
        "ringdown_mode1.png",
    ]
    (mode,) = json.loads((out / "curves.json").read_text())["modes"]
    assert [hit["use"] for hit in mode["hits"]] == ["fit", "fit", "fit", "hold_out"]
    hit = CONFIGS / "modal_ringdown" / "hit2.npz"
    recording = read_recording(hit, quantity="velocity")
    expected = ringdown(recording.response[:, 0], recording.sampling_rate, (90.0, 150.0)).curves
    assert_allclose(mode["hits"][1]["frequency"], expected.frequency, rtol=1e-12)
    assert_allclose(mode["hits"][1]["damping_std"], expected.damping_std, rtol=1e-12)
    common = read_curves(out / "curves_mode1.npz", quantity="velocity")
    assert_allclose(common.frequency, mode["frequency"], rtol=1e-12)
    with np.load(out / "curves.npz") as file:
        arrays = dict(file)
    assert_allclose(arrays["mode1_hit1_damping"], expected.damping, rtol=1e-12)
    assert "1 held out" in result.stdout.splitlines()[0]


def test_fit_finds_the_joint_and_predicts_what_it_has_not_seen(fitted):
    result, out = fitted
    assert result.exit_code == 0, result.stderr
    assert {"fit.json", "fit.npz", "fit_mode1.png", "report.html"} == {
        file.name for file in out.iterdir()
    }
    (mode,) = json.loads((out / "fit.json").read_text())["fits"]
    assert 0.6 < mode["misfit"] < 1.4
    for name, p in mode["parameters"].items():
        assert p["determined"], name
        assert abs(p["value"] - TRUTH[name]) < 3.0 * p["std"], name
    (held_out,) = mode["held_out"]
    assert held_out["recording"] == "hit4.npz"
    assert held_out["frequency_error_hz"] < 0.01
    assert held_out["damping_error_percent"] < 4.0
    assert result.stdout.splitlines()[-1] == f"wrote {out / 'report.html'}"
    assert "held out hit4.npz: predicted within" in result.stdout


def test_the_report_stands_on_its_own(fitted):
    _, out = fitted
    page = (out / "report.html").read_text(encoding="utf-8")
    html.parser.HTMLParser().feed(page)
    assert page.count("data:image/png;base64,") >= 3
    assert 'src="http' not in page
    assert "<script" not in page


@pytest.mark.computes
def test_a_posterior_is_not_sampled_twice(study, tmp_path, monkeypatch):
    result = run("posterior", study, "--out", tmp_path)
    assert result.exit_code == 0, result.stderr
    (mode,) = json.loads((tmp_path / "posterior.json").read_text())["posteriors"]
    # 100 steps do not suffice, which is said.
    assert not mode["enough"]
    chain = np.load(tmp_path / "posterior.npz")["mode1_chain"]
    # A second walk from the same seed would be the same: none may be taken.
    monkeypatch.setattr(emcee.EnsembleSampler, "run_mcmc", None)
    again = run("posterior", study, "--out", tmp_path)
    assert again.exit_code == 0, again.stderr
    assert_allclose(np.load(tmp_path / "posterior.npz")["mode1_chain"], chain, rtol=1e-12)


@pytest.mark.long
def test_the_shipped_studys_posterior_covers_the_truth(tmp_path):
    out = tmp_path
    result = run("posterior", STUDY, "--out", out)
    assert result.exit_code == 0, result.stderr
    assert "effective samples" in result.stderr
    (mode,) = json.loads((out / "posterior.json").read_text())["posteriors"]
    assert mode["enough"]
    for name, true in TRUTH.items():
        if name == "phi_max":
            continue
        p = mode["parameters"][name]
        assert p["effective_samples"] >= 1000
        assert abs(p["mean"] - true) < 3.0 * p["std"], name


def test_inspect_tells_what_a_file_holds():
    result = run("inspect", CONFIGS / "modal_ringdown" / "hit1.npz")
    assert result.exit_code == 0, result.stderr
    for word in ("response", "11264", "2048", "time"):
        assert word in result.stdout
    missing = run("inspect", "nowhere.npz")
    assert missing.exit_code == 2
    assert missing.stderr.count("\n") == 1


# --- what is refused ---------------------------------------------------------------------------

RATE = 2000.0
T = np.arange(4000) / RATE
DECAY = np.exp(-2.0 * T) * np.cos(2.0 * np.pi * 100.0 * T)

BASE = """\
name: bad
model: {modal: [{name: m, band: [70, 140], joint: {type: iwan4}}]}
recordings:
  - {file: hit.npz, kind: free_decay, response: {array: response, quantity: velocity}}
"""


def write(path, response=DECAY, time=T, **more):
    np.savez(path / "hit.npz", time=time, response=np.asarray(response)[:, None], **more)


def cut(path, share=0.5):
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])


def cut_short(folder):
    write(folder)
    cut(folder / "hit.npz")


def with_nan(folder):
    response = DECAY.copy()
    response[123] = np.nan
    write(folder, response)


def unsorted(folder):
    time = T.copy()
    time[[10, 11]] = time[[11, 10]]
    write(folder, time=time)


def jitter(folder):
    time = T.copy()
    time[2000:] += 0.3 / RATE
    write(folder, time=time)


def truncated_hdf5(folder):
    with h5py.File(folder / "hit.h5", "w") as file:
        file["time"], file["response"] = T, DECAY[:, None]
    cut(folder / "hit.h5")


def empty_cell(folder):
    cell = np.empty((2, 2), object)
    cell[0, 0], cell[0, 1], cell[1, 0], cell[1, 1] = T, DECAY, T, np.empty(0)
    scipy.io.savemat(folder / "hit.mat", {"hits": cell})


def text_in_csv(folder):
    (folder / "hit.csv").write_text("time,tip\n0,1\n0.1,x\n" + "0.2,1\n" * 20)


def two_channels(folder):
    np.savez(folder / "hit.npz", time=T, response=np.column_stack([DECAY, 0.5 * DECAY]))


def nothing(folder):
    pass


def percent(folder):
    rows = "\n".join(f"{a},100,{z}" for a, z in ((1, 1.5), (2, 1.6), (3, 1.7), (4, 1.9)))
    (folder / "c.csv").write_text(f"amplitude,frequency_hz,damping\n{rows}\n")


def no_deviations(folder):
    rows = "\n".join(f"{a},100,{z}" for a, z in ((1, 0.01), (2, 0.02), (3, 0.03), (4, 0.04)))
    (folder / "c.csv").write_text(f"amplitude,frequency_hz,damping\n{rows}\n")


CURVES = BASE.replace(
    "{file: hit.npz, kind: free_decay, response: {array: response, quantity: velocity}}",
    "{file: c.csv, kind: curves}",
)
HDF5, MAT, CSV = (BASE.replace("hit.npz", f"hit.{ending}") for ending in ("h5", "mat", "csv"))

BAD = {
    "no recordings": (nothing, BASE[: BASE.index("recordings")], ["no recordings"]),
    "missing file": (nothing, BASE, ["study.yaml:4: ", "hit.npz"]),
    "cut short": (cut_short, BASE, ["study.yaml:4: ", "hit.npz", "zip"]),
    "truncated HDF5": (truncated_hdf5, HDF5, ["study.yaml:4: ", "hit.h5"]),
    "empty MAT cell": (
        empty_cell,
        MAT.replace("array: response, ", ""),
        ["study.yaml:4: ", "hit.mat", "empty"],
    ),
    "text in CSV": (
        text_in_csv,
        CSV.replace("array: response, ", ""),
        ["hit.csv:3", "tip", "'x'"],
    ),
    "NaN": (with_nan, BASE, ["hit.npz", "1 ", "NaN"]),
    "unsorted time": (unsorted, BASE, ["hit.npz", "time"]),
    "gap in time": (jitter, BASE, ["hit.npz", "time"]),
    "wrong array": (
        write,
        BASE.replace("array: response", "array: respnse"),
        ["respnse", "'response'"],
    ),
    "two channels": (two_channels, BASE, ["hit.npz", "channel"]),
    "no quantity": (write, BASE.replace(", quantity: velocity", ""), ["quantity"]),
    "dead channel": (lambda f: write(f, 0.0 * DECAY), BASE, ["hit.npz", "0 throughout"]),
    "clipped": (lambda f: write(f, np.clip(DECAY, -0.4, 0.4)), BASE, ["hit.npz", "clipped"]),
    "no decay": (
        lambda f: write(f, np.cos(200.0 * np.pi * T)),
        BASE,
        ["hit.npz", "no decay in 70 to 140 Hz"],
    ),
    "only noise": (
        lambda f: write(f, np.random.default_rng(0).standard_normal(T.size)),
        BASE,
        ["hit.npz", "noise"],
    ),
    "too short": (lambda f: write(f, DECAY[:200], T[:200]), BASE, ["hit.npz", "too short"]),
    "very short": (lambda f: write(f, DECAY[:5], T[:5]), BASE, ["hit.npz", "5"]),
    "beyond Nyquist": (write, BASE.replace("[70, 140]", "[70, 1400]"), ["Nyquist", "1000 Hz"]),
    "band upside down": (write, BASE.replace("[70, 140]", "[140, 70]"), ["study.yaml:2: ", "band"]),
    "from outside": (
        write,
        BASE.replace("kind: f", "from: 99, kind: f"),
        ["study.yaml:4: recordings[0].from: got 99 s", "lasts from 0 to"],
    ),
    "to outside": (
        write,
        BASE.replace("kind: f", "to: 99, kind: f"),
        ["study.yaml:4: recordings[0].to: got 99 s"],
    ),
    "from the end": (
        write,
        BASE.replace("kind: f", "from: 1.998, kind: f"),
        ["study.yaml:4: recordings[0].from: leaves", "at least 16"],
    ),
    "no such index": (write, BASE.replace("kind: f", "index: 3, kind: f"), ["index 3"]),
    "unknown joint": (write, BASE.replace("iwan4", "iwan44"), ["study.yaml:2: ", "'iwan4'"]),
    "chi outside its range": (write, BASE + "values: {m.chi: -1.5}\n", ["study.yaml:5: ", "chi"]),
    "misspelt key": (write, BASE.replace("kind", "knd"), ["study.yaml:4: ", "'kind'"]),
    "text for a number": (write, BASE + "fit: {starts: many}\n", ["study.yaml:5: ", "'many'"]),
    "nothing to fit": (write, BASE.replace("kind: f", "use: hold_out, kind: f"), ["use: fit"]),
    "damping in percent": (percent, CURVES, ["c.csv", "percent"]),
    "no deviations": (no_deviations, CURVES, ["standard deviations"]),
    "all fixed": (
        write,
        BASE + "fixed: {m.f_0: 100, m.zeta_0: 1e-3, m.F_S: 1, m.K_T: 1, m.chi: -0.5, m.beta: 1}\n",
        ["fixed"],
    ),
}


def test_curves_without_deviations_are_fitted_with_the_models_own_error(tmp_path):
    q = np.geomspace(1e-6, 1e-4, 12)
    mode = ij.ModalOscillator(100.0, 1e-3, ij.Iwan4(F_S=10.0, K_T=4e4, chi=-0.5, beta=1.0))
    f, zeta = (np.asarray(x) for x in mode.frequency_and_damping(q))
    rows = "\n".join(f"{a:.9g},{b:.12g},{c:.12g}" for a, b, c in zip(q, f, zeta, strict=True))
    (tmp_path / "c.csv").write_text(f"amplitude,frequency_hz,damping\n{rows}\n")
    study = tmp_path / "study.yaml"
    study.write_text(
        CURVES.replace("kind: curves", "kind: curves, response: {quantity: displacement}")
        + "fixed: {m.F_S: 10}\nfit: {starts: 4, model_error: {frequency: 1e-4, damping: 0.02}}\n"
    )
    result = run("fit", study, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    (told,) = json.loads((tmp_path / "out" / "fit.json").read_text())["fits"]
    assert told["model_error"] == {"frequency": 1e-4, "damping": 0.02}
    assert (told["parameters"]["F_S"]["value"], told["parameters"]["F_S"]["fixed"]) == (10.0, True)
    assert told["derived"]["R"].keys() == {"value", "std", "determined", "at_least"}
    report = (tmp_path / "out" / "report.html").read_text()
    assert "for the model's own error" in html.unescape(report)


def test_a_mode_that_no_recording_is_of_has_no_damping_to_fix(tmp_path):
    q = np.geomspace(1.0, 10.0, 5)
    rows = "\n".join(f"{a:g},0.19,1e-3,1e-5,1e-5" for a in q)
    head = "amplitude,frequency_hz,damping,frequency_hz_std,damping_std"
    (tmp_path / "c.csv").write_text(f"{head}\n{rows}\n")
    study = tmp_path / "study.yaml"
    study.write_text(
        "name: a\nmodel: {builder: three_mass}\n"
        "recordings: [{file: c.csv, kind: curves, mode: 1}]\n"
        "fixed: {mode2.zeta_0: 1e-4}\n"
    )
    result = run("fit", study, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert "study.yaml:4: fixed.mode2.zeta_0: no recording is of this mode" in result.stderr


@pytest.mark.parametrize(("prepare", "text", "words"), BAD.values(), ids=BAD)
def test_bad_input_gives_one_line_and_no_results(tmp_path, prepare, text, words):
    prepare(tmp_path)
    study = tmp_path / "study.yaml"
    study.write_text(text)
    result = run("fit", study, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    for word in words:
        assert word in line
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())
