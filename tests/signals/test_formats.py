"""Recordings in the formats of analysers, LabVIEW, Test.Lab and tables."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import recording_samples as samples
import scipy.io
from recording_samples import HIT, RATE, ROOT, SAMPLES, TIP, N, sample

from iwanjax.errors import InputError
from iwanjax.signals import Channel, read_recording, read_recordings

NEEDS = {".uff": "pyuff", ".lvm": "lvm_read", ".tdms": "nptdms"}
# What a format rounds to.
ROUNDED = {"hit.lvm": 1e-8, "hit.uff": 1e-9, "hit.b.uff": 1e-12, "hit.wav": 1e-8}
NAMED = ["hit.csv", "hit.lvm", "hit.tdms", "hit.lab.mat"]


@pytest.mark.parametrize("name", SAMPLES)
def test_a_hit_is_the_same_in_every_format(tmp_path, name):
    if name.endswith(tuple(NEEDS)):
        pytest.importorskip(NEEDS["." + name.rpartition(".")[2]])
    recording = read_recording(sample(tmp_path, name))
    assert recording.size == N
    assert recording.sampling_rate == pytest.approx(RATE, rel=1e-6)
    assert recording.time[0] == 0.0
    near = ROUNDED.get(name, 0.0)
    if name == "hit.wav":
        assert [c.unit for c in recording.channels] == 3 * ["full scale"]
        np.testing.assert_allclose(2.0 * recording.response[:, :2], np.c_[TIP, ROOT], atol=near)
        return
    tip, root = sorted(recording.channels, key=lambda c: "root" in c.name)
    (force,) = recording.inputs
    np.testing.assert_allclose(recording.channel(tip.name), TIP, atol=near)
    np.testing.assert_allclose(recording.channel(root.name), ROOT, atol=near)
    np.testing.assert_allclose(recording.channel(force.name), HIT, atol=10.0 * near)
    assert (tip.quantity, root.quantity, force.quantity) == (*2 * ["acceleration"], "force")
    if name in NAMED:
        assert tip == Channel("tip", "acceleration", "m/s^2")
        assert force == Channel("hammer", "force", "N")


@pytest.mark.parametrize("name", ["hit.uff", "hit.b.uff"])
def test_universal_files_keep_nodes_directions_and_lines(tmp_path, name):
    pytest.importorskip("pyuff")
    recording = read_recording(sample(tmp_path, name))
    assert recording.channels[0] == Channel("tip:1:-Z", "acceleration", "m/s^2", "-z")
    assert recording.metadata == {"id1": "hit", "id3": "25-Nov-26 12:00:00"}


@pytest.mark.parametrize("name", ["hit.uff", "hit.b.uff"])
def test_channels_that_come_again_are_the_next_recording(tmp_path, name):
    pytest.importorskip("pyuff")
    path = sample(tmp_path, name)
    path.write_bytes(2 * path.read_bytes())
    found = read_recordings(path)
    assert [len(each.channels) for each in found] == [2, 2]
    assert found[1].name == f"{name}[1]"


@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("x_columns", ["One", "No"])
def test_dialects_of_lvm(tmp_path, comma, x_columns):
    pytest.importorskip("lvm_read")
    path = tmp_path / "hit.lvm"
    samples.lvm(path, comma=comma, x_columns=x_columns)
    recording = read_recording(path)
    assert recording.sampling_rate == pytest.approx(RATE, rel=1e-6)
    np.testing.assert_allclose(recording.channel("root"), ROOT, atol=1e-8)
    assert recording.metadata["X_Columns"] == x_columns


def test_groups_of_tdms_are_chosen_by_name(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(str(tmp_path / "two.tdms")) as file:
        for group, step in (("slow", 0.01), ("fast", 0.001)):
            about = {"wf_increment": step}
            file.write_segment([nptdms.ChannelObject(group, "acc", TIP, about)])
    path = tmp_path / "two.tdms"
    assert [each.sampling_rate for each in read_recordings(path)] == pytest.approx([100.0, 1000.0])
    assert read_recording(path, variable="fast").sampling_rate == pytest.approx(1000.0)
    with pytest.raises(InputError, match=r"groups slow, fast.*did you mean 'fast'"):
        read_recording(path, variable="fasst")


def test_spectra_in_a_universal_file_are_told(tmp_path):
    pytest.importorskip("pyuff")
    path = sample(tmp_path, "hit.uff")
    # Field 1 of record 6: a frequency response function.
    path.write_text(path.read_text().replace("\n    1         0", "\n    4         0"))
    with pytest.raises(InputError, match="no time response; found 3 x frequency response function"):
        read_recording(path)


@pytest.mark.parametrize("suffix", NEEDS)
def test_a_missing_library_names_the_extra(tmp_path, monkeypatch, suffix):
    pytest.importorskip(NEEDS[suffix])
    path = sample(tmp_path, f"hit{suffix}")
    monkeypatch.setitem(sys.modules, NEEDS[suffix], None)
    with pytest.raises(InputError, match=r"hit\S+: .* not installed; try .*iwanjax\[io\]"):
        read_recording(path)


def test_a_table_in_json_with_names_beside_it(tmp_path):
    path = tmp_path / "x.json"
    rows = np.c_[np.arange(N) / RATE, TIP].tolist()
    path.write_text(json.dumps({"data": rows, "sampling freq": RATE, "disp units": "in"}))
    assert [c.name for c in read_recording(path).channels] == ["column 2"]
    path.write_text(json.dumps({"data": rows, "columns": ["t", "disp"], "disp units": "in"}))
    assert read_recording(path).channels == (Channel("disp", "displacement", "in"),)


def test_names_and_units_beside_a_response(tmp_path):
    path = tmp_path / "hit.mat"
    names, units = np.empty((2, 3), dtype=object)
    names[:], units[:] = ["a", "b", "c"], ["m/s^2", "V", "N"]
    content = {"response": np.c_[TIP, ROOT, HIT], "Fs": RATE, "channels": names, "units": units}
    scipy.io.savemat(path, {**content, "operator": "N. N."})
    recording = read_recording(path)
    assert recording.channels[:2] == (Channel("a", "acceleration", "m/s^2"), Channel("b", "", "V"))
    assert recording.metadata["operator"] == "N. N."
    assert recording.sampling_rate == pytest.approx(RATE)


def test_times_in_milliseconds_become_seconds(tmp_path):
    path = tmp_path / "hit.csv"
    rows = "".join(f"{1e3 * t:.9f};{x:.15g}\n" for t, x in zip(samples.TIME, TIP, strict=True))
    for head in ("time;acc\nms;g\n", "Time (ms);acc (g)\n"):
        path.write_text(head + rows)
        recording = read_recording(path)
        assert recording.sampling_rate == pytest.approx(RATE)
        assert recording.channels[0].unit == "g"


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
def test_text_of_other_encodings(tmp_path, encoding):
    path = tmp_path / "hit.csv"
    rows = "".join(f"{t:.9f};{x:.15g}\n" for t, x in zip(samples.TIME, TIP, strict=True))
    path.write_bytes(f"time;acc\ns;m/s²\n{rows}".encode(encoding))
    assert read_recording(path).channels == (Channel("acc", "acceleration", "m/s²"),)


def test_a_last_column_without_name_or_without_values(tmp_path):
    path = tmp_path / "hit.csv"
    rows = [f"{t:.9f},{x:.15g}" for t, x in zip(samples.TIME, TIP, strict=True)]
    path.write_text("time,acc,\n" + "".join(f"{row},{i % 7}\n" for i, row in enumerate(rows)))
    assert [c.name for c in read_recording(path).channels] == ["acc", "column 3"]
    path.write_text("time,acc,remark\n" + "".join(f"{row},\n" for row in rows))
    assert [c.name for c in read_recording(path).channels] == ["acc"]
    path.write_text("time,acc,,\n" + "".join(f"{row},,\n" for row in rows))
    assert [c.name for c in read_recording(path).channels] == ["acc"]


def test_tables_of_pandas():
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"acc": TIP, "force": HIT}, index=samples.TIME)
    recording = read_recording(table)
    assert (recording.channels[0].name, recording.inputs[0].name) == ("acc", "force")
    assert recording.sampling_rate == pytest.approx(RATE)
    # A mere count of rows is no time.
    with pytest.raises(InputError, match="DataFrame: no array 'time'"):
        read_recording(table.reset_index(drop=True))
    counted = read_recording(table.reset_index(drop=True), sampling_rate=RATE, response="acc")
    np.testing.assert_array_equal(counted.channel("acc"), TIP)


def test_tables_of_xarray():
    """By what xarray's objects look like: the package itself is not needed."""

    def array(values, dims, coords, **more):
        return SimpleNamespace(values=values, dims=dims, coords=coords, **more)

    coords = {"time": samples.TIME, "channel": np.array(["a", "b"])}
    two = array(np.c_[TIP, ROOT], ("time", "channel"), coords, name=None, attrs={"units": "g"})
    recording = read_recording(two)
    assert recording.channels[1] == Channel("b", "acceleration", "g")
    one = array(HIT, ("time",), coords, name="force", attrs={"units": "N"})
    whole = SimpleNamespace(data_vars={"acc": array(TIP, ("time",), coords), "force": one})
    recording = read_recording(whole)
    assert recording.inputs == (Channel("force", "force", "N"),)
    np.testing.assert_array_equal(recording.channel("acc"), TIP)


def test_a_bare_array_is_asked_for_names():
    with pytest.raises(InputError, match="as_recording takes arrays"):
        read_recording(TIP)


def test_analysers_files_open(reference_data):
    pytest.importorskip("pyuff")
    folder = reference_data / "uff_samples"
    text, binary = (
        read_recording(folder / name)
        for name in ("Sample_UFF58_ascii.uff", "Sample_UFF58b_bin.uff")
    )
    assert text.size == binary.size == 79292
    assert text.channels == binary.channels == (Channel("Mic 01:+X", "", "Pa", "+x"),)
    np.testing.assert_allclose(text.response, binary.response, rtol=1e-5)
    with pytest.raises(InputError, match="no time response; found data sets 15, 18, 82, 151, 164"):
        read_recording(folder / "TestLab 161 164 18 15 82.uff")


@pytest.mark.parametrize("folder", ["f16", "friction_damper", "brb_rice", "double_beam"])
def test_measured_recordings_open(reference_data, folder):
    for path in sorted((reference_data / folder).iterdir()):
        if path.name != "response_control.csv":
            assert all(each.size > 1000 for each in read_recordings(path))
