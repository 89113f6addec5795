"""What cannot be used is refused in one line: what arrived, what was expected, where."""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.errors import InputError

CHAIN = ij.three_mass()
SENSORS = {"a1": np.eye(3)[0], "a2": np.eye(3)[1]}
INPUTS = {"m1": np.eye(3)[0]}
MODE = {"name": "m", "band": (70, 140), "joint": {"type": "iwan4"}}
T = np.arange(2000) / 1000.0
DECAY = np.exp(-2.0 * T) * np.cos(2.0 * np.pi * 100.0 * T)
CURVES = ij.ModalCurves([1.0, 2.0, 3.0], [0.1, 0.1, 0.1], [0.01, 0.01, 0.01])


def recorded(sensors="tip", force=None, **options):
    return ij.as_recording(DECAY, force, sampling_rate=1000.0, sensors=sensors, **options)


def on_chain(*recordings, **more):
    return ij.Study(CHAIN, recordings, sensors=SENSORS, inputs=INPUTS, **more)


BAD = {
    "nothing": (lambda: ij.Study(), ["study 'study': model", "neither", "modal"]),
    "both": (lambda: ij.Study(CHAIN, modal=[MODE]), ["structure and modal"]),
    "a matrix": (
        lambda: ij.Study(np.eye(3)),
        ["structure is a ndarray", "JointedStructure"],
    ),
    "unknown section": (
        lambda: ij.Study(CHAIN, fitt={"starts": 3}),
        ["study 'study': fitt: unknown key", "did you mean 'fit'"],
    ),
    "unknown key": (
        lambda: ij.Study(CHAIN, name="b", fit={"start": 3}),
        ["study 'b': fit.start: unknown key", "did you mean 'starts'"],
    ),
    "text for a number": (
        lambda: ij.Study(CHAIN, fit={"starts": "many"}),
        ["fit.starts: got 'many'", "whole number"],
    ),
    "unknown joint type": (
        lambda: ij.Study(modal=[{**MODE, "joint": {"type": "iwan44"}}]),
        ["model.modal[0].joint.type", "'iwan4'"],
    ),
    "band upside down": (lambda: ij.Study(modal=[{**MODE, "band": (140, 70)}]), ["band[1]", "70"]),
    "row too short": (
        lambda: ij.Study(CHAIN, sensors={"a1": [1, 0]}),
        ["sensors.a1: got shape (2,)", "(3,)"],
    ),
    "rows without names": (
        lambda: ij.Study(CHAIN, sensors=np.eye(3)),
        ["sensors: got a ndarray", "mapping of names to rows (3,)"],
    ),
    "row with NaN": (lambda: ij.Study(CHAIN, inputs={"m1": [np.nan, 0, 0]}), ["inputs.m1", "NaN"]),
    "an array": (
        lambda: on_chain(DECAY),
        ["recordings[0]: got a ndarray", "as_recording"],
    ),
    "an array within": (
        lambda: on_chain(recorded("a1"), ij.Measurement(DECAY)),
        ["recordings[1]: got a ndarray"],
    ),
    "unknown sensor": (
        lambda: on_chain(recorded("a3")),
        ["recordings[0].response.sensors[0]", "no sensor 'a3'", "a1, a2"],
    ),
    "unknown input": (
        lambda: on_chain(recorded("a1", np.sin(T), inputs="m9")),
        ["recordings[0].force.inputs[0]", "no input 'm9'", "m1"],
    ),
    "unknown use": (
        lambda: on_chain(ij.Measurement(recorded("a1"), use="held")),
        ["recordings[0].use: got 'held'", "'fit' or 'hold_out'"],
    ),
    "no such mode": (
        lambda: on_chain(ij.Measurement(CURVES, mode=3)),
        ["recordings[0].mode: got 3", "0 to 2"],
    ),
    "which mode": (lambda: on_chain(CURVES), ["recordings[0]: 'mode' is missing", "0, 1, 2"]),
    "a loop's mode": (
        lambda: on_chain(ij.Measurement(ij.ForceLoop(T, DECAY), mode=0)),
        ["recordings[0].mode", "kind loop"],
    ),
    "no such joint": (
        lambda: on_chain(ij.Measurement(ij.ForceLoop(T, DECAY), joint="J7")),
        ["recordings[0].joint", "no joint 'J7'", "J1"],
    ),
    "end before start": (
        lambda: on_chain(ij.Measurement(recorded("a1"), start=2.0, end=1.0)),
        ["recordings[0].end: got 1", "more than start = 2"],
    ),
    "noise of another sensor": (
        lambda: ij.Study(CHAIN, sensors=SENSORS, noise={"a9": 1.0}),
        ["noise.a9", "no sensor or input 'a9'"],
    ),
    "no recordings": (lambda: ij.Study(CHAIN).curves(), ["study 'study': there are no recordings"]),
    "nothing to fit": (
        lambda: ij.Study(
            recordings=[ij.Measurement(recorded(quantity="velocity"), use="hold_out")], modal=[MODE]
        ).fit(),
        ["no recording with use: fit is of mode 'm'"],
    ),
    "no quantity": (
        lambda: ij.Study(recordings=[recorded(quantity="")], modal=[MODE]).curves(),
        ["study 'study': recordings[0]: recording: the channels measure nothing known"],
    ),
    "no decay in the band": (
        lambda: ij.Study(recordings=[recorded()], modal=[{**MODE, "band": (300, 400)}]).curves(),
        ["study 'study': recordings[0]: recording:"],
    ),
    "no qsma section": (lambda: ij.Study(CHAIN).qsma(), ["there is no qsma section", "alpha"]),
    "no cases": (lambda: ij.Study(CHAIN).simulate(), ["there is no simulate section"]),
    "qsma of single modes": (lambda: ij.Study(modal=[MODE]).qsma(), ["qsma needs a structure"]),
    "no sensors": (
        lambda: ij.Study(CHAIN).diagnose(),
        ["diagnose needs a model with named rows, sensors and inputs"],
    ),
    "nothing to diagnose by": (lambda: on_chain().diagnose(), ["no recordings of kind"]),
    "no such case": (
        lambda: ij.Study(
            CHAIN, simulate={"name": "a", "dt": 0.1, "samples": 5, "drive": {"amplitude": 1}}
        ).simulate("b"),
        ["no result 'b'", "expected one of a"],
    ),
    "no such file": (lambda: ij.load_study("nowhere.yaml"), ["nowhere.yaml: ", "study file"]),
}


@pytest.mark.parametrize(("use", "words"), BAD.values(), ids=BAD)
def test_it_is_refused_in_one_line(use, words):
    with pytest.raises(InputError) as caught:
        use()
    said = str(caught.value)
    assert "\n" not in said
    for word in words:
        assert word in said
