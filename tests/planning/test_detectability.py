"""What a plan of two hits on two masses would show, against runs of the equations themselves."""

import json
from functools import partial

import numpy as np
import pytest
from discrepancy.histories.two_masses import DAMPING, PLACES, RATE, K, M, recorded
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.errors import InputError
from iwanjax.estimation.evidence import LEAST_GAIN
from iwanjax.joints.force_law import WITHIN_K
from iwanjax.planning import Detectability

KINDS = (
    "stiffness_error",
    "mass_error",
    "cubic_stiffness",
    "coulomb_friction",
    "sensor_gain",
    "sensor_polarity",
)
HITS, NOISE = ((0, 40.0), (1, 160.0)), 0.15


def nothing(d: float, v: float, moved: float) -> float:
    return 0.0


@pytest.fixture(scope="module")
def measured():
    return [recorded(nothing, struck, peak, "fit") for struck, peak in HITS]


def study_of(measured, rows=PLACES, **sections) -> ij.Study:
    recordings = [
        ij.as_recording(
            each.response,
            sampling_rate=RATE,
            quantity="acceleration",
            sensors=["a1", "a2"],
            force=each.force,
            inputs=["m1", "m2"],
            name=each.name,
        )
        for each in measured
    ]
    return ij.Study(
        ij.JointedStructure(ij.LinearStructure(M, DAMPING, K), {}),
        recordings,
        rows=rows,
        sensors={"a1": [1.0, 0.0], "a2": [0.0, 1.0]},
        inputs={"m1": [1.0, 0.0], "m2": [0.0, 1.0]},
        hypotheses=KINDS,
        noise={"a1": NOISE, "a2": NOISE},
        name="two masses",
        **sections,
    )


@pytest.fixture(scope="module")
def found(measured):
    return study_of(measured).detectability()


def slider(size: float, slip: float, in_model: float = 0.0):
    """Dry friction; the share ``in_model`` of its stiffness at rest is the model's."""
    stretch = 0.0

    def force(d: float, v: float, moved: float) -> float:
        nonlocal stretch
        stretch = min(max(stretch + moved, -slip), slip)
        return size * (stretch - in_model * d)

    return force


@pytest.mark.parametrize(
    ("kind", "variant", "law"),
    [
        ("stiffness_error", "", lambda size, _: lambda d, v, moved: size * d),
        ("cubic_stiffness", "", lambda size, _: lambda d, v, moved: size * d**3),
        ("coulomb_friction", "", slider),
        ("coulomb_friction", WITHIN_K.words, partial(slider, in_model=1.0)),
    ],
)
def test_the_size_found_changes_the_response_by_as_much_as_evidence_asks(
    measured, found, kind, variant, law
):
    """By two runs in small steps, with the effect and without, and the noise that is in them."""
    smallest = found.of(kind, "m1-m2", variant)
    square, values = 0.0, 0
    for (struck, peak), plain in zip(HITS, measured, strict=True):
        quiet = [
            recorded(law(size, smallest.shape), struck, peak, "fit", noisy=False).response
            for size in (smallest.found, 0.0)
        ]
        change = np.fft.rfft(quiet[0] - quiet[1], axis=0)
        # What is compared ends at 0.35 of the sampling rate.
        change[int(0.35 * len(plain.response)) :] = 0.0
        square += np.sum(np.fft.irfft(change, len(plain.response), axis=0) ** 2) / NOISE**2
        values += plain.response.size
    # Evidence takes what is left of white noise to be correlated over a sample.
    share, beside = 0.7, np.sin(0.7 * np.pi) / np.pi
    count = values / (1.0 + 2.0 * beside / share)
    # What eight cycles do not show has to leave a quarter more than noise in the free run.
    needed = LEAST_GAIN + 0.5 * np.log(count) + 0.25 * count / 2.0
    deviations = np.sqrt(share + 2.0 * beside) * (np.sqrt(2.0 * needed) + 1.28)
    assert np.sqrt(square) == pytest.approx(deviations, rel=0.06)


def test_one_sensor_s_gain_is_told_from_another_s_and_a_mass_from_a_spring(found):
    assert found.of("sensor_gain", "a1").named < 2.0 * found.of("sensor_gain", "a1").found
    assert found.of("mass_error", "m2-ground").named < 0.5
    assert found.not_judged == ("sensor_polarity",)
    assert found.warnings == ()


def test_a_harder_hit_helps_most_with_a_cubic_spring_and_a_softer_one_least(found):
    by = {each.label: each for each in found.added if each.kind == "hit"}
    assert by["m1, peak 320"].found < by["m1, peak 160"].found < by["m1, peak 80"].found < 1.0
    # One like it is there already.
    assert "m2, peak 160" not in by
    # Both masses have a sensor; between them a third would see nothing new of it.
    assert [each.label for each in found.added if each.kind == "sensor"] == ["sensor m1-m2"]


def test_sizes_are_those_of_the_sensors_that_there_are(measured, found):
    """A place where one more might be added changes none of them."""
    sensorless = {name: row for name, row in PLACES.items() if name != "m1-m2"}
    fewer = study_of(measured, rows=sensorless).detectability()
    assert not [each for each in fewer.added if each.kind == "sensor"]
    for each in fewer.smallest:
        assert found.of(each.kind, each.where, each.variant).found == pytest.approx(
            each.found, rel=1e-9
        )


def test_it_is_told_saved_and_drawn(found, tmp_path):
    again = Detectability.load(found.save(tmp_path / "plan.npz"))
    assert again.summary() == found.summary()
    assert "cubic_stiffness@m1-m2" in found.summary()
    sizes, added = ij.plot(found).axes
    assert sizes.get_xscale() == "log"
    assert added.get_xlabel()


def test_the_command_writes_all_of_it(measured, tmp_path):
    model = {"M": M, "C": DAMPING, "K": K}
    for what, rows in (
        ("row", PLACES),
        ("sensor", {"a1": [1.0, 0.0], "a2": [0.0, 1.0]}),
        ("input", {"m1": [1.0, 0.0], "m2": [0.0, 1.0]}),
    ):
        model[f"{what}_labels"] = np.array(list(rows))
        model["rows" if what == "row" else f"{what}_rows"] = np.array(list(rows.values()))
    np.savez(tmp_path / "model.npz", **model)
    first = measured[0]
    np.savez(
        tmp_path / "hit.npz",
        time=np.arange(len(first.response)) / RATE,
        response=first.response,
        force=first.force[:, :1],
    )
    (tmp_path / "study.yaml").write_text(
        "name: plan\nmodel: {file: model.npz}\nhypotheses: [viscous_damping]\nrecordings:\n"
        "  - {file: hit.npz, use: fit, sampling_rate: 1024, response: {array: response, "
        "sensors: [a1, a2], quantity: acceleration}, force: {array: force, inputs: [m1]}}\n"
    )
    out = tmp_path / "out"
    ended = CliRunner().invoke(
        app, ["detectability", str(tmp_path / "study.yaml"), "--out", str(out)]
    )
    assert ended.exit_code == 0, ended.output
    told = json.loads((out / "detectability.json").read_text())
    assert told["study"] == "plan"
    assert {each["where"] for each in told["smallest"]} == set(PLACES)
    assert all(each["found"] > 0.0 for each in told["smallest"])
    assert (out / "detectability.png").stat().st_size > 10_000
    assert "viscous_damping@m1-m2" in (out / "detectability.txt").read_text()


def test_single_modes_have_no_places():
    study = ij.Study(modal=[{"name": "mode1", "band": (90, 150), "joint": {"type": "iwan4"}}])
    with pytest.raises(InputError, match="detectability needs a structure"):
        study.detectability()
