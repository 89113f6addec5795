"""``offset`` takes off what channels of a file show where nothing moves or acts."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.config import read_study
from iwanjax.config.reading import recordings_of

RATE = 100.0
X = np.random.default_rng(0).standard_normal((400, 4))
STUDY = """\
name: two
model: {{file: model.npz}}
recordings:
  - file: rec.npz
    sampling_rate: 100
    from: 1
    to: 2
    response: {{array: response, sensors: [a, b], quantity: displacement{response}}}
    force: {{array: force, inputs: [f, g]{force}}}
"""


def read(folder, **offsets):
    """The recording of a study with such offsets, from its beginning to its end."""
    rows = {name: np.eye(2) for name in ("rows", "sensor_rows", "input_rows")}
    labels = {"row_labels": ["a", "b"], "sensor_labels": ["a", "b"], "input_labels": ["f", "g"]}
    np.savez(folder / "model.npz", M=np.eye(2), C=np.eye(2), K=np.eye(2), **rows, **labels)
    np.savez(folder / "rec.npz", response=X[:, :2], force=X[:, 2:])
    said = {"response": "", "force": ""}
    said |= {key: f", offset: {given}" for key, given in offsets.items()}
    path = folder / "study.yaml"
    path.write_text(STUDY.format(**said), encoding="utf-8")
    ((_, recording),) = recordings_of(read_study(path).recordings[0])
    return np.hstack([recording.response, recording.force])


@pytest.mark.parametrize(
    ("offsets", "expected"),
    [
        ({}, [0.0, 0.0, 0.0, 0.0]),
        ({"response": "[0.5, -2]"}, [0.5, -2.0, 0.0, 0.0]),
        ({"force": "[6.2e-3, 1e-1]"}, [0.0, 0.0, 6.2e-3, 0.1]),
        # Over the part that is used.
        ({"response": "mean"}, [*X[100:201, :2].mean(axis=0), 0.0, 0.0]),
        ({"response": "[1, 1]", "force": "mean"}, [1.0, 1.0, *X[100:201, 2:].mean(axis=0)]),
    ],
)
def test_it_is_taken_off_each_channel(tmp_path, offsets, expected):
    assert_allclose(read(tmp_path, **offsets), X - np.array(expected), atol=1e-15)


@pytest.mark.parametrize(
    ("offsets", "words"),
    [
        ({"response": "1"}, ["recordings[0]: response: offset: got 1 number(s) for 2 channel(s)"]),
        ({"force": "[1, 2, 3]"}, ["force: offset: got 3 number(s)", "expected one each, or mean"]),
        ({"response": "median"}, ["study.yaml:8: recordings[0].response.offset", "'median'"]),
        ({"force": "[1, x]"}, ["study.yaml:9: recordings[0].force.offset"]),
    ],
)
def test_what_is_no_offset_is_refused(tmp_path, offsets, words):
    with pytest.raises(ij.InputError) as refused:
        read(tmp_path, **offsets)
    for word in words:
        assert word in str(refused.value)
