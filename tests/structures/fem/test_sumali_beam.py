import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.errors import InputError

pytest.importorskip("skfem", reason="scikit-fem (extra fem) is not installed")

from iwanjax.structures.fem.sumali import (
    SumaliGeometry,
    sumali_beam,
    sumali_full,
    sumali_joints,
    sumali_springs,
)
from iwanjax.structures.full_model import check_reduction

STUCK = {f"J{i}.x": 5.3e7 + 4.73e8 for i in range(1, 5)} | {f"J{i}.y": 5.25e8 for i in range(1, 5)}


@pytest.fixture(scope="module")
def full():
    return sumali_full()


@pytest.fixture(scope="module")
def reduced(full):
    return full.reduce(10, attach=True)


@pytest.mark.reference
def test_table_2_4(reduced):
    """Bending modes 7, 8, 9 with the joints stuck and slipping, rad/s, within 0.5 %."""
    beam = reduced.model(sumali_springs())
    joints = {name: (beam.rows[name], joint) for name, joint in sumali_joints().items()}
    system = ij.JointedStructure(beam.structure, joints)
    assert_allclose(system.modes("low").omega[:3], [759.3, 1345, 3185], rtol=5e-3)
    assert_allclose(system.modes("high").omega[:3], [652.2, 1297, 2713], rtol=5e-3)
    # Symmetric, antisymmetric, symmetric bending.
    ends = np.array([beam.sensors["left"], beam.sensors["right"]]) @ system.modes().Phi[:, :3]
    assert_allclose(ends[1] / ends[0], [1, -1, 1], rtol=1e-4)


def test_rigid_couplings_share_a_coordinate(full, reduced):
    assert reduced.M.shape == (36 + 10 + 3,) * 2
    assert "J1B.x" in reduced.coordinates
    assert "J1B.z" not in reduced.coordinates
    assert list(reduced.rows)[:4] == ["J1.x", "J1.y", "J1.rz", "J2.x"]
    check = check_reduction(full, reduced, STUCK, 700.0)
    assert check.enough(1.5e-3)
    assert np.all(check.error > -1e-6)
    frequency, shapes = full.modes(STUCK, 9, shift=5.0)
    q = full.interface @ shapes
    opened = np.array([full.joints[f"J{j}.{m}"] for j in range(1, 5) for m in ("z", "rx", "ry")])
    assert np.abs(opened @ q).max() < 1e-9 * np.abs(q).max()
    assert frequency[6] * 2 * np.pi == pytest.approx(757.1, abs=0.1)


def test_the_strips_weigh_what_they_should(full):
    assert np.sum(full.M) / 3 == pytest.approx(2 * 8000.0 * 0.508 * 0.0508 * 0.00635)


def test_bad_options_are_named():
    for call, words in [
        (lambda: dataclasses.replace(SumaliGeometry(), lap=0.2), "longer than four patches"),
        (lambda: dataclasses.replace(SumaliGeometry(), patch=0.06), "patch = 0.06"),
        (lambda: sumali_full(geometry=None), "expected a SumaliGeometry"),
        (lambda: sumali_beam(size=float("nan")), "options of sumali"),
    ]:
        with pytest.raises(InputError, match=words):
            call()
