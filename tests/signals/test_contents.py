"""What inspect tells of recordings whose faults are known, and the study that it proposes."""

import json

import numpy as np
import pytest
import scipy.signal
from recording_samples import SAMPLES, sample
from test_formats import NEEDS

import iwanjax as ij
from iwanjax.config.study import read_study
from iwanjax.signals import file_contents
from iwanjax.signals.channel_checks import band_with_energy, dropouts, hum
from iwanjax.verbs.inspect import run

RATE, N = 2048.0, 16384
TIME = np.arange(N) / RATE
HIT = np.where(np.abs(TIME - 0.1) < 1e-3, 50.0 * np.cos(500.0 * np.pi * (TIME - 0.1)) ** 2, 0.0)


def accelerations(force):
    """Of an oscillator of 1 kg, 77 Hz, 1 %, and of a sensor elsewhere that moves the other way."""
    w = 2.0 * np.pi * 77.0
    # d(t) = sin(w t) exp(-0.01 w t) / w answers a blow of 1 N s; its second difference is a(t).
    answer = np.sin(w * TIME) * np.exp(-0.01 * w * TIME) / w
    d = scipy.signal.fftconvolve(force, answer)[:N] / RATE
    a = np.diff(d, 2, prepend=[0.0, 0.0]) * RATE**2
    random = np.random.default_rng(3)
    return [x + 1e-3 * random.standard_normal(N) for x in (a, -0.4 * a)]


def remarks(tmp_path, *, push=HIT, **changes):
    """What is remarked on a hit whose channels were changed."""
    near, far = accelerations(push)
    held = {"time": TIME, "acc_near": near, "acc_far": far, "force": push}
    for name, change in changes.items():
        held[name] = change(held[name])
    np.savez(tmp_path / "hit.npz", **held)
    (recording,) = file_contents(tmp_path / "hit.npz").recordings
    return list(recording.remarks)


def frozen(x):
    x = x.copy()
    x[900:930] = x[899]
    return x


FAULTS = {
    "hum": ({"acc_near": lambda x: x + 0.3 * np.sin(100 * np.pi * TIME)}, "acc_near hums: 0.3"),
    "hum of 60": ({"force": lambda x: x + 0.2 * np.sin(120 * np.pi * TIME)}, "force hums: 0.2"),
    "offset": ({"acc_far": lambda x: x + 5.0}, "acc_far rests at 5"),
    "drift": ({"acc_far": lambda x: x + 4.0 * TIME / TIME[-1]}, "acc_far drifts by 3"),
    "dropout": ({"acc_near": frozen}, "acc_near drops out: 31 samples"),
    "zeros": ({"acc_near": lambda x: np.where(abs(TIME - 0.3) < 5e-3, 0.0, x)}, "drops out: 2"),
    "clipped": ({"acc_far": lambda x: np.clip(x, -5.0, 5.0)}, "acc_far is clipped"),
    "polarity": ({"acc_near": np.negative}, "acc_near moves most while force acts and moves aga"),
}


def test_a_sound_hit_has_no_remark(tmp_path):
    assert remarks(tmp_path) == []


@pytest.mark.parametrize(("changes", "words"), FAULTS.values(), ids=FAULTS)
def test_a_fault_is_remarked_and_nothing_else(tmp_path, changes, words):
    told = remarks(tmp_path, **changes)
    assert any(words in each for each in told)
    assert all(each.startswith(tuple(changes)) for each in told)


def test_a_double_hit(tmp_path):
    (told,) = remarks(tmp_path, push=HIT + 0.4 * np.roll(HIT, 60))
    assert told.startswith("force hits 2 times, at 0.09")


def test_a_rattling_contact_is_one_hit(tmp_path):
    assert remarks(tmp_path, push=HIT + 0.4 * np.roll(HIT, 5)) == []


def test_a_mode_near_the_mains_that_decays_is_no_hum():
    x = np.exp(-0.5 * TIME) * np.sin(2 * np.pi * 50.3 * TIME)
    assert hum(x, RATE).frequency == 0.0
    assert hum(np.random.default_rng(0).standard_normal(N), RATE).frequency == 0.0


def test_the_crest_of_a_slow_wave_in_coarse_counts_is_no_dropout():
    x = np.round(40.0 * np.sin(2 * np.pi * 5.0 * TIME + 0.3))
    assert dropouts(x) == 0
    assert dropouts(np.round(x * np.exp(-TIME))) == 0


def test_the_band_with_energy_is_that_of_the_noise():
    x = scipy.signal.sosfilt(
        scipy.signal.butter(8, (100.0, 200.0), "bandpass", fs=RATE, output="sos"),
        np.random.default_rng(2).standard_normal(N),
    )
    assert band_with_energy(x, RATE) == pytest.approx((100.0, 200.0), abs=10.0)


@pytest.mark.parametrize("name", SAMPLES)
def test_the_proposed_study_loads_and_reads(tmp_path, name):
    if name.endswith(tuple(NEEDS)):
        pytest.importorskip(NEEDS["." + name.rpartition(".")[2]])
    contents = file_contents(sample(tmp_path, name))
    (tmp_path / "study.yaml").write_text(contents.study)
    (entry,) = read_study(tmp_path / "study.yaml").recordings
    assert entry.kind == ("free_decay" if name == "hit.wav" else "transient")
    ((low, high),) = (mode.band for mode in read_study(tmp_path / "study.yaml").modal)
    assert low < 80.0 < high
    assert isinstance(ij.load_study(tmp_path / "study.yaml"), ij.Study)


def test_every_mode_that_holds_energy_is_proposed_in_a_band_of_its_own(tmp_path):
    """The third is 60 dB below: no mode to begin with."""
    decay = sum(
        size * np.exp(-0.005 * 2.0 * np.pi * f * TIME) * np.sin(2.0 * np.pi * f * TIME)
        for size, f in ((1.0, 120.0), (0.8, 170.0), (1e-3, 400.0))
    )
    noise = 1e-6 * np.random.default_rng(0).standard_normal(N)
    np.savez(tmp_path / "decay.npz", time=TIME, response=decay + noise)
    (tmp_path / "study.yaml").write_text(file_contents(tmp_path / "decay.npz").study)
    first, second = (mode.band for mode in read_study(tmp_path / "study.yaml").modal)
    assert first[0] < 120.0 < first[1] <= second[0] < 170.0 < second[1]


def test_curves_loops_and_stepped_sines_are_known(tmp_path):
    (tmp_path / "curves.csv").write_text(
        "amplitude,frequency_hz,damping\n" + "".join(f"{a},{100 - a},0.01\n" for a in range(1, 9))
    )
    x = np.linspace(0.0, 6.0, 40)
    loop = {"displacement": np.sin(x).tolist(), "force": np.cos(x).tolist()}
    (tmp_path / "loop.json").write_text(json.dumps(loop))
    for name, kind in (("curves.csv", "curves"), ("loop.json", "loop")):
        (tmp_path / "study.yaml").write_text(file_contents(tmp_path / name).study)
        assert read_study(tmp_path / "study.yaml").recordings[0].kind == kind


def test_the_command_writes_figure_study_and_numbers(tmp_path):
    near, _ = accelerations(HIT)
    (tmp_path / "lab").mkdir()
    np.savez(tmp_path / "lab" / "hit.npz", time=TIME, acc=near, force=HIT)
    told = run([tmp_path / "lab" / "hit.npz"], tmp_path / "out")
    assert "kind: transient" in told
    names = sorted(file.name for file in (tmp_path / "out").iterdir())
    assert names == ["channels.png", "contents.json", "study.yaml"]
    (recording,) = json.loads((tmp_path / "out" / "contents.json").read_text())["recordings"]
    assert recording["channels"][0]["band"][0] == pytest.approx(77.0, abs=5.0)
    assert read_study(tmp_path / "out" / "study.yaml").recordings[0].path.is_file()
    summary = file_contents(tmp_path / "lab" / "hit.npz").summary()
    assert summary in told


def test_a_folder_of_hits_becomes_one_study_whose_last_is_held_out(tmp_path):
    lab, out = tmp_path / "lab", tmp_path / "out"
    lab.mkdir()
    for i, push in enumerate((HIT, 3.0 * HIT, 2.0 * HIT)):
        np.savez(lab / f"hit{i}.npz", time=TIME, acc=accelerations(push)[0])
    (lab / "notes.doc").write_text("of no interest")
    (lab / "loop.json").write_text(
        json.dumps({"displacement": np.sin(TIME[:99]).tolist(), "force": TIME[:99].tolist()})
    )
    told = run([lab], out)
    assert all(f"hit{i}.npz" in told for i in range(3))
    assert "loop.json is left out of the study" in told
    study = read_study(out / "study.yaml")
    assert [each.use for each in study.recordings] == ["fit", "fit", "hold_out"]
    assert all(each.path.is_file() for each in study.recordings)
    assert len(study.modal) == 1
    assert len(json.loads((out / "contents.json").read_text())["files"]) == 4
    assert (out / "hit1.npz.channels.png").is_file()
    # Without a folder to write to, it is one for a file beside the hits.
    text = run([lab / "hit0.npz", lab / "hit1.npz"])
    (lab / "study.yaml").write_text(text[text.index("name:") :])
    assert [each.use for each in read_study(lab / "study.yaml").recordings] == ["fit", "fit"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(ij.InputError, match="no file in it is of a kind that is read"):
        run([tmp_path / "empty"])


def test_measured_files_propose_studies_that_load(reference_data, tmp_path):
    pytest.importorskip("pyuff")
    for path in sorted(reference_data.glob("*/*")):
        if "Level" in path.name and "Level1" not in path.name:
            continue
        rate = {"sampling_rate": 610.35} if "silverbox" in str(path) else {}
        contents = file_contents(path, **rate)
        if path.suffix == ".npz" or path.name.startswith("TestLab"):
            assert contents.fault
            continue
        (tmp_path / path.name).symlink_to(path)
        (tmp_path / "study.yaml").write_text(contents.study)
        assert read_study(tmp_path / "study.yaml").recordings
        if "silverbox" in str(path):  # its offset of 6.2 mV
            assert contents.recordings[0].remarks[0].startswith("V1 rests at 0.006")
