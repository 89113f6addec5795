import csv
import time as clock

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from matlab73 import write_matlab73

from iwanjax.errors import InputError
from iwanjax.signals import Channel, read_recording, read_recordings
from iwanjax.signals.contents import file_contents

N, RATE = 600, 1024.0
TIME = 0.25 + np.arange(N) / RATE
ACC = np.column_stack(
    [
        np.exp(-0.004 * np.arange(N)) * np.sin(2 * np.pi * f * np.arange(N) / RATE)
        for f in (80.0, 122.0, 244.0)
    ]
)
FORCE = np.exp(-0.5 * ((np.arange(N) - 20.0) / 3.0) ** 2)
ARRAYS = {"time": TIME, "response": ACC, "force": FORCE}
STRUCT = {"time": TIME, "acc1": ACC[:, 0], "acc2": ACC[:, 1], "units": "s, m/s^2", "mass": 2.0}
SUFFIXES = [".npz", ".h5", ".mat", ".7.3.mat"]


def cell(rows):
    found = np.empty((len(rows), len(rows[0])), dtype=object)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            found[i, j] = entry
    return found


def put(group, name, value):
    if isinstance(value, dict):
        for key, entry in value.items():
            put(group.require_group(name), key, entry)
    else:
        group[name] = value


def write(path, content):
    if path.suffix == ".csv":
        path.write_text(content)
    elif path.suffix == ".npz":
        np.savez(path, **content)
    elif path.name.endswith(".7.3.mat"):
        write_matlab73(path, content)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, content)
    else:
        with h5py.File(path, "w") as file:
            for name, value in content.items():
                put(file, name, value)
    return path


def rows(columns):
    """CSV of columns by name."""
    lines = [",".join(columns)]
    lines += [",".join(map(repr, row)) for row in np.column_stack(list(columns.values())).tolist()]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("shape", ["columns", "rows"])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_arrays_of_every_format(tmp_path, suffix, shape):
    arrays = ARRAYS if shape == "columns" else {name: a.T[None] for name, a in ARRAYS.items()}
    arrays = {name: a[0] if a.ndim == 3 else a for name, a in arrays.items()}
    recording = read_recording(write(tmp_path / f"hit{suffix}", arrays))
    np.testing.assert_array_equal(recording.time, TIME)
    np.testing.assert_array_equal(recording.response, ACC)
    np.testing.assert_array_equal(recording.force[:, 0], FORCE)
    assert [c.name for c in recording.channels] == ["response[0]", "response[1]", "response[2]"]
    assert recording.inputs == (Channel("force", "force"),)
    assert recording.name == f"hit{suffix}"


@pytest.mark.parametrize("variable", [None, "HIdata"])
@pytest.mark.parametrize("suffix", SUFFIXES[1:])
def test_a_struct_or_group_of_channels(tmp_path, suffix, variable):
    content = {"HIdata": {**STRUCT, "force_hammer": FORCE}, "rig": {"bolts": 3.0}, "note": "x"}
    recording = read_recording(write(tmp_path / f"hit{suffix}", content), variable=variable)
    assert recording.channels == (
        Channel("acc1", "acceleration"),
        Channel("acc2", "acceleration"),
    )
    assert recording.inputs == (Channel("force_hammer", "force"),)
    np.testing.assert_array_equal(recording.channel("acc2"), ACC[:, 1])


@pytest.mark.parametrize("suffix", SUFFIXES[2:])
def test_a_cell_with_one_row_per_recording(tmp_path, suffix):
    hits = cell([[TIME, ACC[:, 0] + i, 3.0, np.zeros((0, 0))] for i in range(3)])
    path = write(tmp_path / f"hits{suffix}", {"xData": hits, "names": cell([["a", "b"]])})
    found = read_recordings(path, channels=["tip"], quantity="velocity", unit="m/s")
    assert [recording.name for recording in found] == [f"hits{suffix}[{i}]" for i in range(3)]
    assert found[0].channels == (Channel("tip", "velocity", "m/s"),)
    np.testing.assert_array_equal(found[2].channel("tip"), ACC[:, 0] + 2)
    assert read_recording(path, 1).response[0, 0] == ACC[0, 0] + 1
    check_refused(lambda: read_recording(path), [f"{path}: ", "3 recordings", "index=0 to 2"])
    for index in (3, -1):
        check_refused(lambda i=index: read_recording(path, i), [f"index is {index}", "0 to 2"])


@pytest.mark.parametrize("suffix", SUFFIXES[2:])
def test_a_cell_of_structs_and_one_of_responses(tmp_path, suffix):
    structs = cell([[{"t": TIME, "vel_tip": ACC[:, i]} for i in range(2)]])
    path = write(tmp_path / f"hits{suffix}", {"hits": structs})
    assert [r.channels[0].quantity for r in read_recordings(path)] == ["velocity"] * 2
    path = write(tmp_path / f"bare{suffix}", {"x": cell([[ACC[:, 0]], [ACC[:, 1]]])})
    found = read_recordings(path, sampling_rate=RATE)
    np.testing.assert_array_equal(found[1].response, ACC[:, 1:2])


def test_columns_of_a_csv_file(tmp_path):
    content = rows({"time_s": TIME, "disp_x": ACC[:, 0], "b": ACC[:, 1], "Force 1": FORCE})
    recording = read_recording(write(tmp_path / "hit.csv", content), unit="mm")
    assert recording.channels == (Channel("disp_x", "displacement", "mm"), Channel("b", "", "mm"))
    assert recording.inputs == (Channel("Force 1", "force"),)
    np.testing.assert_array_equal(recording.response, ACC[:, :2])
    np.testing.assert_array_equal(recording.time, TIME)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: "# " + text,
        lambda text: "\n" + text.replace("\n", "\r\n"),
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", " \t "),
        lambda text: text.replace("time", '"time"').replace("acc", '"acc"'),
        lambda text: text + "\n\n",
        lambda text: text.replace(",", ";").replace(".", ","),
        lambda text: text.replace("\n", ",\n"),
        lambda text: text.replace("\n", ",\n", 1),
        lambda text: "Operator: N. N.\nRig: 1, left\n\n" + text,
        lambda text: text.replace("acc\n", "acc\ns,m/s^2\n"),
    ],
    ids=[
        *("byte order mark", "hash", "Windows", "semicolons", "tabs", "quotes", "blank lines"),
        *("decimal commas", "empty last column", "separator after the names", "remarks", "units"),
    ],
)
def test_dialects_of_csv(tmp_path, change):
    path = tmp_path / "hit.csv"
    path.write_bytes(change(rows({"time": TIME, "acc": ACC[:, 0]})).encode())
    recording = read_recording(path)
    np.testing.assert_array_equal(recording.channel("acc"), ACC[:, 0])


@settings(max_examples=20)
@given(
    values=st.lists(
        st.floats(-1e300, 1e300, allow_subnormal=False), min_size=17, max_size=30, unique=True
    )
)
def test_any_numbers_come_back(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("files")
    x, t = np.array(values), np.arange(len(values)) / RATE
    for suffix in SUFFIXES:
        path = write(folder / f"x{suffix}", {"response": x, "time": t})
        np.testing.assert_array_equal(read_recording(path).response[:, 0], x)
    path = write(folder / "x.csv", rows({"t": t, "x": x}))
    np.testing.assert_array_equal(read_recording(path).response[:, 0], x)


def test_what_to_take_and_how_to_call_it(tmp_path):
    path = write(tmp_path / "hit.h5", {"run": {**STRUCT, "push": FORCE, "zeit": TIME + 1.0}})
    recording = read_recording(
        path,
        variable="run",
        time="zeit",
        response=["acc2"],
        force="push",
        channels=["tip"],
        inputs=["hammer"],
        quantity="velocity",
    )
    assert recording.channels == (Channel("tip", "velocity"),)
    assert recording.inputs == (Channel("hammer", "force"),)
    assert recording.time[0] == 1.25
    assert read_recording(path, response="acc1", force=[]).force is None


def test_channels_beside_each_other_at_the_top(tmp_path):
    path = write(tmp_path / "hit.npz", {"t": TIME, "acc": ACC[:, 0], "forces": FORCE, "m": 2.0})
    recording = read_recording(path)
    assert [c.name for c in (*recording.channels, *recording.inputs)] == ["acc", "forces"]


@pytest.mark.parametrize("response", [ACC, ACC.T, ACC[:, 0]])
def test_a_rate_in_place_of_time(tmp_path, response):
    path = write(tmp_path / "hit.npz", {"response": response, "force": FORCE})
    recording = read_recording(path, sampling_rate=RATE)
    assert recording.size == N
    assert recording.sampling_rate == pytest.approx(RATE)
    check_refused(lambda: read_recording(path), ["no array 'time'", "sampling_rate=", "response ("])


def test_rounded_times_are_made_exact_by_the_rate(tmp_path):
    path = write(tmp_path / "hit.npz", {**ARRAYS, "time": np.round(TIME, 4)})
    check_refused(lambda: read_recording(path), ["not uniform", "sampling_rate"])
    np.testing.assert_allclose(read_recording(path, sampling_rate=RATE).time, TIME, atol=1e-4)


def test_a_rate_does_not_hide_a_gap(tmp_path):
    gap = TIME + (np.arange(N) > 300) / RATE
    check_refused(
        lambda: read_recording(write(tmp_path / "hit.npz", {**ARRAYS, "time": gap})),
        ["not uniform"],
    )
    check_refused(
        lambda: read_recording(tmp_path / "hit.npz", sampling_rate=RATE * (N - 1) / N),
        ["not uniform"],
    )


ROW = "0.1,1.0,2.0\n"
BAD_CSV = {
    "text": (f"time,a,b\n{ROW}0.2,x1,2\n", ["csv:3: ", "'a' holds 'x1'", "number"]),
    "missing cell": (f"time,a,b\n{ROW}\n0.2,,2\n", ["csv:4: ", "'a' is empty"]),
    "cell too few": (f"time,a,b\n{ROW}0.2,1\n", ["csv:3: ", "2 cells", "3", "cut short"]),
    "cell too many": (f"time,a,b\n{ROW}0.2,1,2,3\n", ["csv:3: ", "4 cells"]),
    "all too long": (f"time,a\n{ROW}{ROW}", ["csv:2: ", "3 cells", "2", "time, a"]),
    "decimal comma": ('time,a\n0.1,2\n"0,1",2\n', ["csv:3: ", "'0,1'", "decimal points"]),
    "comment": (f"time,a,b\n{ROW}# end\n", ["csv:3: ", "1 cells"]),
    "no header": (ROW * 3, ["csv:1: ", "numbers only", "names"]),
    "nameless": (f"time,,b\n{ROW}", ["csv:1: ", "column 2 has no name"]),
    "name twice": (f"time,a,a\n{ROW}", ["csv:1: ", "'a'"]),
    "no rows": ("time,a,b\n", ["csv: no rows"]),
    "empty": ("", ["csv: the file is empty"]),
    "no time": (rows({"a": ACC[:, 0]}), ["no array 'time'", "a (600 float64)", "sampling_rate"]),
    "time only": (rows({"time": TIME}), ["no response"]),
    "nan": (
        rows({"time": TIME, "acc1": np.where(np.arange(N) == 7, np.nan, ACC[:, 0])}),
        ["hit.csv: ", "'acc1' holds 1 NaN", "index 7"],
    ),
}


@pytest.mark.parametrize(("content", "words"), BAD_CSV.values(), ids=BAD_CSV)
def test_a_fault_in_csv_names_its_line_and_column(tmp_path, content, words):
    path = write(tmp_path / "hit.csv", content)
    check_refused(lambda: read_recording(path), [str(path), *words])


def test_csv_that_is_no_text(tmp_path):
    path = tmp_path / "hit.csv"
    path.write_bytes(b"time,a\n0.1,\xff\xfe\n")
    check_refused(lambda: read_recording(path), [f"{path}:2: column 'a' holds 'ÿþ'"])
    path.write_bytes(b"time,a\n0.1,\x00\n")
    check_refused(lambda: read_recording(path), [str(path)])
    write(path, rows({"time": TIME, "a": ACC[:, 0]}))
    check_refused(lambda: read_recording(path, variable="x"), ["'x'", "columns", "response="])


def test_long_csv_is_quick(tmp_path):
    path = tmp_path / "long.csv"
    block = "".join(f"{a:.7g},{b:.7g},{c:.7g}\n" for a, b, c in ACC[:500])
    path.write_text("a,b,c\n" + 400 * block)  # a fifth of a million
    start = clock.perf_counter()
    assert read_recording(path, sampling_rate=RATE).size == 200_000
    assert clock.perf_counter() - start < 2.0


BAD = {
    "no such array": ({}, {"response": "acc"}, ["no 'acc'", "response (600 x 3 float64)"]),
    "no such channel": ({}, {"response": ["respons"]}, ["did you mean 'response'?"]),
    "no such force": ({}, {"force": "hammer"}, ["no 'hammer'"]),
    "no such time": ({}, {"time": "tme"}, ["no time 'tme'", "did you mean 'time'?"]),
    "other length": ({"response": ACC[1:]}, {}, ["response has shape (599, 3)", "600 times"]),
    "other force": ({"force": FORCE[1:]}, {}, ["force has shape", "600 times"]),
    "three axes": ({"response": ACC[None]}, {}, ["response is 1 x 600 x 3", "(N, channels)"]),
    "complex": ({"response": ACC * 1j}, {}, ["response is 600 x 3 complex128"]),
    "text": ({"response": np.array(["a", "b"])}, {}, ["response is", "text", "numbers"]),
    "empty": ({"response": np.zeros((0, 3))}, {}, ["response is empty"]),
    "time of two axes": ({"time": ACC}, {}, ["time has shape (600, 3)"]),
    "NaN": (
        {"response": np.where(ACC[9, 1] == ACC, np.nan, ACC)},
        {"channels": ["a", "b", "c"]},
        ["'b' holds 1 NaN", "index 9"],
    ),
    "too few names": ({}, {"channels": ["a"]}, ["channels is ['a']", "3 column(s)"]),
    "one name for three": ({}, {"channels": "abc"}, ["channels is 'abc'", "list"]),
    "too many inputs": ({}, {"inputs": ["a", "b"]}, ["inputs is ['a', 'b']", "1 column(s)"]),
    "inputs of nothing": ({}, {"inputs": ["a"], "force": []}, ["inputs names 1", "none"]),
    "names twice": ({}, {"channels": ["a", "b", "a"]}, ["'a' names two"]),
    "another rate": ({}, {"sampling_rate": 2048}, ["1024 Hz", "sampling_rate is 2048 Hz"]),
    "unknown quantity": ({}, {"quantity": "acc"}, ["quantity 'acc'", "acceleration"]),
    "a matrix as variable": ({}, {"variable": "force"}, ["'force' is", "response='force'"]),
    "no such variable": ({}, {"variable": "resp"}, ["no variable 'resp'", "force ("]),
}


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".7.3.mat"])
@pytest.mark.parametrize(("change", "options", "words"), BAD.values(), ids=BAD)
def test_a_fault_in_arrays_is_told(tmp_path, suffix, change, options, words):
    path = write(tmp_path / f"hit{suffix}", {**ARRAYS, **change})
    if suffix != ".npz":  # MATLAB's vectors have two axes
        words = [word for word in words if "(599" not in word]
    check_refused(lambda: read_recording(path, **options), [f"{path}: ", *words])


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, "1 kHz"])
def test_a_rate_that_is_none(tmp_path, rate):
    path = write(tmp_path / "hit.npz", ARRAYS)
    check_refused(lambda: read_recording(path, sampling_rate=rate), ["sampling_rate is", "Hz"])


def test_a_square_response_without_time(tmp_path):
    path = write(tmp_path / "hit.npz", {"response": np.random.default_rng(0).normal(size=(20, 20))})
    check_refused(lambda: read_recording(path, sampling_rate=RATE), ["(20, 20)", "add an array"])


HITS = [[TIME, ACC[:, i], 1.0] for i in range(3)]
EMPTY = np.zeros((0, 0))
BAD_VARIABLES = {
    "wrong name": ({"xData": cell(HITS)}, "xdata", ["3 x 3 cell", "did you mean 'xData'?"]),
    "nothing": ({"label": "x", "m": 2.0}, None, ["no recording", "label (text)", "m (1 x 1"]),
    "two": ({"a": STRUCT, "b": STRUCT}, None, ["a, b", "variable="]),
    "text": ({"a": "tip"}, "a", ["'a' is text"]),
    "empty cell": ({"a": np.empty((0, 0), dtype=object), "t": TIME}, "a", ["a is an empty cell"]),
    "no second entry": (
        {"xData": cell([*HITS[:2], [TIME, EMPTY, 1.0]])},
        None,
        ["[2]: xData{3, 2} is empty (row 3, column 2", "response", "delete"],
    ),
    "no time": ({"xData": cell([HITS[0], [EMPTY, ACC, 1.0]])}, None, ["xData{2, 1}", "time"]),
    "text in a cell": ({"x": cell([["tip", ACC, 1.0]])}, "x", ["x{1, 1} is text", "time"]),
    "third series": ({"x": cell([[TIME, ACC, FORCE]])}, None, ["x{1, 3}", "struct"]),
    "faulty second": (
        {"xData": cell([HITS[0], [TIME, 0 * ACC, 1.0]])},
        None,
        ["[1]: channel 'response[0]' is 0 throughout"],
    ),
    "short channel": ({"s": {**STRUCT, "acc2": ACC[1:, 1]}}, None, ["acc2", "600 times"]),
    "empty channel": ({"s": {**STRUCT, "acc2": EMPTY}}, None, ["acc2 is empty"]),
}


@pytest.mark.parametrize("suffix", [".mat", ".7.3.mat"])
@pytest.mark.parametrize(
    ("content", "variable", "words"), BAD_VARIABLES.values(), ids=BAD_VARIABLES
)
def test_a_fault_in_a_variable_is_told(tmp_path, suffix, content, variable, words):
    path = write(tmp_path / f"hits{suffix}", content)
    check_refused(lambda: read_recordings(path, variable=variable), [str(path), *words])


def test_one_good_recording_among_faulty_ones(tmp_path):
    path = write(tmp_path / "hits.mat", {"xData": cell([*HITS[:2], [TIME, EMPTY, 1.0]])})
    assert read_recording(path, 1).size == N


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".csv"])
def test_a_file_cut_short(tmp_path, suffix):
    content = rows({"time": TIME, "a": FORCE}) if suffix == ".csv" else ARRAYS
    path = write(tmp_path / f"hit{suffix}", content)
    path.write_bytes(path.read_bytes()[: -path.stat().st_size // 3])
    if suffix == ".csv":
        path.write_text(path.read_text().rsplit(",", 1)[0])
    check_refused(lambda: read_recording(path), [str(path), "cut short"])


def test_files_that_are_none(tmp_path):
    check_refused(lambda: read_recording(tmp_path / "a.npz"), ["does not exist", ".csv"])
    check_refused(lambda: read_recording(tmp_path), ["is a folder"])
    path = tmp_path / "hit.doc"
    path.write_bytes(b"RIFF")
    check_refused(lambda: read_recording(path), ["'.doc'", ".csv", ".npz, .mat, .h5 or .hdf5"])
    np.savez(tmp_path / "o.npz", time=TIME, response=np.array([None], dtype=object))
    check_refused(lambda: read_recording(tmp_path / "o.npz"), ["response holds pickled"])


def check_refused(call, words):
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_contents_of_a_sound_file(tmp_path):
    contents = file_contents(write(tmp_path / "hit.mat", {"HIdata": {**STRUCT, "force": FORCE}}))
    assert contents.variables == (
        ("HIdata", "struct or group of time, acc1, acc2, units, mass, force"),
    )
    (recording,) = contents.recordings
    assert (recording.samples, recording.fault) == (N, "")
    assert recording.rate == pytest.approx(RATE)
    assert [channel.name for channel in recording.channels] == ["acc1", "acc2", "force"]
    first = recording.channels[0]
    assert first.peaks[0] == pytest.approx(80.0, abs=RATE / (N // 4))
    assert (first.largest, first.missing, first.clipped) == (np.max(ACC[:, 0]), 0, 0)
    text = str(contents)
    for word in ("HIdata", "600 samples, 1024 Hz", "acceleration", "peaks Hz"):
        assert word in text


def test_the_noise_floor_is_that_of_the_noise(tmp_path):
    noise = 1e-3 * np.random.default_rng(1).standard_normal(8192)
    x = np.sin(2 * np.pi * 80.0 * np.arange(8192) / RATE) + noise
    path = write(tmp_path / "x.npz", {"response": x})
    (recording,) = file_contents(path, sampling_rate=RATE).recordings
    assert recording.channels[0].noise_db == pytest.approx(-60.0, abs=1.5)
    assert recording.channels[0].peaks[0] == pytest.approx(80.0, abs=0.5)


def test_contents_tell_faults_and_go_on(tmp_path):
    bad = np.where(np.arange(N) % 100 == 7, np.nan, np.clip(ACC[:, 0], -0.4, 0.4))
    hits = cell([HITS[0], [TIME, EMPTY, 1.0], [TIME, bad, 1.0], [TIME[::-1], ACC, 1.0]])
    contents = file_contents(write(tmp_path / "hits.mat", {"xData": hits}))
    faults = [recording.fault for recording in contents.recordings]
    assert faults[0] == ""
    assert faults[1].startswith("xData{2, 2} is empty")
    assert "6 NaN" in faults[2]
    assert "time does not increase" in faults[3]
    assert contents.recordings[2].channels[0].missing == 6
    assert contents.recordings[2].channels[0].clipped > 5
    assert str(contents).count("fault: ") == 3


def test_contents_of_many_recordings_are_cut(tmp_path):
    path = write(tmp_path / "hits.mat", {"xData": cell(25 * [HITS[0]])})
    assert "... and 5 more" in str(file_contents(path))


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("model.npz", {"M": np.eye(3), "K": np.eye(3)}, "no array 'time'"),
        ("two.mat", {"a": STRUCT, "b": STRUCT}, "variable="),
        ("bad.csv", "time,a\n0.1,x\n", "bad.csv:2: column 'a'"),
        ("note.mat", {"note": "nothing here"}, "no recording"),
    ],
)
def test_contents_of_files_without_recordings(tmp_path, name, content, word):
    contents = file_contents(write(tmp_path / name, content))
    assert contents.recordings == ()
    assert word in contents.fault
    assert word in str(contents)


def test_contents_of_a_damaged_file(tmp_path):
    path = write(tmp_path / "hit.npz", ARRAYS)
    path.write_bytes(path.read_bytes()[:-100])
    assert "cut short" in file_contents(path).fault
    check_refused(lambda: file_contents(tmp_path / "none.npz"), ["does not exist"])


def test_the_brake_reuss_beam_s_hammer_test(reference_data):
    recording = read_recording(reference_data / "brb_rice" / "HammerImpact.mat")
    assert [c.name for c in recording.channels] == ["acc1", "acc2", "acc3"]
    assert {c.quantity for c in recording.channels} == {"acceleration"}
    assert recording.force is None
    assert recording.sampling_rate == pytest.approx(12800.0)
    assert recording.duration == pytest.approx(5.12)
    assert recording.time[0] == pytest.approx(-0.01)
    assert recording.clipped == {}


def test_the_double_beam_s_twelve_hits(reference_data):
    path = reference_data / "double_beam" / "data.mat"
    found = read_recordings(path, variable="xData", channels=["tip"], quantity="velocity")
    assert len(found) == 12
    for recording in found:
        assert recording.size == 15719
        assert recording.sampling_rate == pytest.approx(5120.33, rel=1e-4)
        assert recording.channels == (Channel("tip", "velocity"),)
    assert found[3].name == "data.mat[3]"
    contents = file_contents(path)
    assert all(recording.fault == "" for recording in contents.recordings)
    assert contents.recordings[0].channels[0].peaks[:2] == pytest.approx((122.0, 244.0), abs=2.0)


def test_csv_module_agrees(tmp_path):
    """The quick way through NumPy gives what the csv module gives."""
    path = write(tmp_path / "hit.csv", rows({"time": TIME, "a": ACC[:, 0]}))
    with path.open(newline="") as file:
        content = [list(map(float, row)) for row in list(csv.reader(file))[1:]]
    np.testing.assert_array_equal(read_recording(path).response[:, 0], np.array(content)[:, 1])
