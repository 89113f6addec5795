"""The two examples beside the project: one force concealed, and none."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from iwanjax.cli import app

EXAMPLES = Path(__file__).resolve().parents[3] / "shared" / "examples"

pytestmark = [
    pytest.mark.reference,
    pytest.mark.skipif(not EXAMPLES.is_dir(), reason="no examples beside the project"),
    pytest.mark.long,
]


def diagnosed(name, out):
    study = EXAMPLES / name / "study.yaml"
    result = CliRunner().invoke(app, ["diagnose", str(study), "--out", str(out)])
    assert result.exit_code == 0, result.output
    return json.loads((out / "diagnosis.json").read_text())


def test_the_cubic_spring_is_found(tmp_path):
    found = diagnosed("cubic_spring", tmp_path)
    truth = json.loads((EXAMPLES / "cubic_spring" / "truth.json").read_text())
    first = found["what"][0]
    assert (first["kind"], first["where"]) == (truth["kind"], truth["where"])
    value = truth["parameters"][0]["values"][0]
    assert first["parameters"]["k3"]["value"] == pytest.approx(value, rel=0.02)
    assert found["fit"]["after"]["hold_out"] < 0.05 * found["fit"]["before"]["hold_out"]


def test_where_nothing_is_missing_nothing_is_found(tmp_path):
    found = diagnosed("nothing_missing", tmp_path)
    assert found["detected"] is False
    assert found["what"] == []
    # 1.05 was reached; one draw of the forces' noise may cost more.
    assert found["fit"]["after"]["hold_out"] < 1.35 * found["fit"]["noise_floor"]["hold_out"]
