"""The key ``trust:`` of a study's model."""

import re

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.structures import LinearTrust

MODEL = """name: chain
model:
  builder: three_mass
  trust: {trust}
"""


def loaded(tmp_path, trust: str) -> ij.Study:
    path = tmp_path / "study.yaml"
    path.write_text(MODEL.replace("{trust}", trust))
    return ij.load_study(path)


def test_numbers_are_for_all_modes_or_one_by_one(tmp_path):
    trust = loaded(tmp_path, "{frequencies: [0.001, 0.01], damping: 0.5}").setup.trust
    assert trust is not None
    found = trust.deviations(np.array([1.0, 4.0, 9.0]))
    np.testing.assert_allclose(found, [[0.001, 0.01, 0.01], [0.5, 0.5, 0.5]])
    assert trust.shapes == 0.0


def test_a_study_that_says_nothing_leaves_it_to_the_diagnosis(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(MODEL.replace("  trust: {trust}\n", ""))
    assert ij.load_study(path).setup.trust is None


@pytest.mark.parametrize(
    ("trust", "message"),
    [
        ("{frequencies: 5}", r"study.yaml:4: model.trust.frequencies.*less than 1"),
        ("{damping: -0.1}", r"study.yaml:4: model.trust.damping.*greater than or equal to 0"),
        ("{frequency: 0.1}", r"study.yaml:4: model.trust.frequency: unknown key.*frequencies"),
        ("0.1", r"study.yaml:4: model.trust"),
    ],
)
def test_what_is_no_share_is_refused_where_it_stands(tmp_path, trust, message):
    with pytest.raises(ij.InputError) as refused:
        loaded(tmp_path, trust)
    assert re.search(message, str(refused.value)), refused.value


def test_in_python_it_is_an_argument_with_the_same_checks():
    structure = ij.JointedStructure(ij.LinearStructure(np.eye(2), 0.1 * np.eye(2), np.eye(2)), {})
    setup = ij.Study(structure, trust={"frequencies": 0.01}).setup
    assert setup.trust is not None
    assert np.max(setup.trust.frequencies) == 0.01
    with pytest.raises(ij.InputError, match=r"trust\.damping"):
        ij.Study(structure, trust={"damping": 2.0})
    with pytest.raises(ij.InputError, match=r"trust\.frequencies"):
        ij.Study(structure, trust=LinearTrust(frequencies=-0.1))
    mode = {"name": "mode1", "band": (90, 150), "joint": {"type": "iwan4"}}
    with pytest.raises(ij.InputError, match="only a structure has a linear model"):
        ij.Study(modal=[mode], trust={"damping": 0.2})
