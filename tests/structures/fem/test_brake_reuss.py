"""The Brake-Reuss beam on meshes coarse enough for a test; the fine one is a benchmark."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.errors import InputError

pytest.importorskip("skfem", reason="scikit-fem (extra fem) is not installed")

from iwanjax.structures.fem.brake_reuss import (
    BRAKE_REUSS_SENSORS,
    BRAKE_REUSS_X_SPRINGS,
    BRAKE_REUSS_Y_SPRINGS,
    BrakeReussGeometry,
    Material,
    brake_reuss_beam,
    brake_reuss_full,
    brake_reuss_joints,
)
from iwanjax.structures.fem.lap_joint import Point
from iwanjax.structures.full_model import check_reduction

SPRINGS = BRAKE_REUSS_X_SPRINGS | BRAKE_REUSS_Y_SPRINGS


@pytest.fixture(scope="module")
def full():
    return brake_reuss_full(size=20.0)


@pytest.fixture(scope="module")
def reduced(full):
    return full.reduce(24)


def in_plane(model, shapes, spare=0.1):
    """Modes in the xy-plane, by shape: the accelerometers move, the lateral one does not."""
    across = np.abs(np.array([model.sensors[f"a{i}"] for i in range(1, 13)]) @ shapes).max(axis=0)
    return np.flatnonzero(np.abs(model.sensors["lateral"] @ shapes) < spare * across)


@pytest.mark.reference
def test_table_3_2():
    """Natural frequencies of the xy-plane bending modes, Hz, within 1.5 %."""
    full = brake_reuss_full(size=12.6)
    frequency, shapes = full.modes(SPRINGS, 15, shift=20.0)
    frequency, shapes = frequency[6:], shapes[:, 6:]
    across = np.vstack([full.sensors[f"a{i}"] @ shapes for i in range(1, 13)])
    bending = np.abs(full.sensors["lateral"] @ shapes)[0] < 0.1 * np.abs(across).max(axis=0)
    assert_allclose(frequency[bending][:4], [175.06, 589.99, 1196.0, 1651.6], rtol=0.015)


@pytest.mark.reference
def test_reduction_against_the_full_model(full, reduced):
    """60 interface motions and 24 modes: 0.15 % at most up to 2 kHz."""
    check = check_reduction(full, reduced, SPRINGS, 2000.0)
    assert len(check.full) == 9
    assert np.all(check.error > -1e-6)
    assert check.enough(1.5e-3)
    # The unreduced fourth bending mode is 0.09 % lower, as in the independent computation.
    assert check.error.max() == pytest.approx(9e-4, rel=0.1)
    assert not check.enough(5e-4)
    few = check_reduction(full, full.reduce(2), SPRINGS, 2000.0)
    assert not few.enough(1.5e-3)
    assert "error %" in str(few)


def test_sizes_labels_and_rigid_motion(full, reduced):
    assert reduced.M.shape == (84, 84)
    assert reduced.coordinates[:7] == (
        "J1A.x", "J1A.y", "J1A.z", "J1A.rx", "J1A.ry", "J1A.rz", "J1B.x"
    )  # fmt: skip
    assert len(reduced.rows) == 30
    rigid = np.vstack([full.rigid, np.zeros((24, 6))])
    # Everything moving as one body strains nothing and opens no joint.
    strain = reduced.K @ rigid
    assert np.abs(strain).max() < 1e-9 * np.abs(reduced.K).max() * np.abs(rigid).max()
    rows = np.array(list(reduced.rows.values()))
    assert np.abs(rows @ rigid).max() < 1e-12 * np.abs(rigid).max()
    mass = np.sum(full.M) / 3
    assert_allclose((rigid.T @ reduced.M @ rigid)[:3, :3], mass * np.eye(3), atol=1e-8 * mass)
    bolt_heads = 6 * 12.66**2 * 7.0
    assert mass == pytest.approx(7.735e-9 * (720 * 25.4**2 + bolt_heads), rel=1e-9)
    # Modes that are left out carry the rest.
    moved = reduced.effective_mass[:, :3].sum(axis=0)
    assert np.all(moved < mass)
    assert np.all(moved > 0.7 * mass)


def test_points_and_pictures_move_with_the_body(full, reduced):
    rigid = np.vstack([full.rigid, np.zeros((24, 6))])
    for name, point in BRAKE_REUSS_SENSORS.items():
        axis = "xyz".index(point.direction)
        motion = np.zeros(6)
        motion[axis] = 1.0
        motion[3:] = np.cross(point.position, np.eye(3)[axis])
        assert_allclose(reduced.sensors[name] @ rigid, motion, atol=1e-6)
    shape = reduced.shape
    expected = np.cross([0.0, 0.0, 1.0], shape.points)
    assert_allclose(shape.recovery @ rigid[:, 5], expected, atol=1e-6)
    for j in range(5):
        corners = shape.points[shape.quads[shape.patch == j]]
        assert_allclose(corners[..., 1], 12.7)
        area = np.prod(np.ptp(corners, axis=1)[:, [0, 2]], axis=1).sum() / 2
        hole = 7.04**2 if 0 < j < 4 else 0.0
        assert area == pytest.approx((16.0, 30.0, 30.0, 30.0, 16.0)[j] * 25.4 - hole)


def test_three_lines_to_a_jointed_structure(reduced):
    beam = reduced.model(BRAKE_REUSS_Y_SPRINGS)
    joints = {name: (beam.rows[name], joint) for name, joint in brake_reuss_joints().items()}
    system = ij.JointedStructure(beam.structure, joints)
    stuck = reduced.model(SPRINGS).structure.modes()
    assert len(stuck.omega) == 78
    assert_allclose(system.modes().omega, stuck.omega, rtol=1e-8)
    bending = in_plane(beam, np.asarray(stuck.Phi)[:, :9])
    assert_allclose(bending[:2], [1, 2])
    # With the joints slipping all the way the springs across the interface and the bolts remain.
    assert_allclose(system.modes("high").omega, beam.structure.modes().omega, rtol=1e-8)


def test_the_builder_keeps_what_it_built(tmp_path, monkeypatch):
    monkeypatch.setenv("IWANJAX_CACHE", str(tmp_path))
    first = brake_reuss_beam(size=40.0, modes=3)
    assert first.M.shape == (63, 63)
    monkeypatch.setattr("iwanjax.structures.fem.brake_reuss.brake_reuss_full", None)
    again = brake_reuss_beam(size=40.0, modes=3)
    assert np.array_equal(again.K, first.K)
    assert np.array_equal(again.shape.recovery, first.shape.recovery)


def geometry(**change):
    return dataclasses.replace(BrakeReussGeometry(), **change)


BAD = {
    "size": (lambda: brake_reuss_full(size=-1.0), "size = -1.0 must be a positive number"),
    "too fine": (lambda: brake_reuss_full(size=1.0), "choose a larger element size"),
    "lap": (lambda: geometry(lap=(421.0, 299.0)), "must lie inside the bar"),
    "bolts": (lambda: geometry(spacing=41.0), "do not fit into a lap of 122"),
    "heads": (lambda: geometry(head=30.0), "expected bolt < head"),
    "negative": (lambda: geometry(bolt=-1.0), "bolt = -1.0 must be"),
    "geometry": (lambda: brake_reuss_full(geometry=720.0), "expected a BrakeReussGeometry"),
    "material": (lambda: brake_reuss_full(material="steel"), "material is a str"),
    "off": (
        lambda: brake_reuss_full(size=40.0, sensors={"p": Point((800.0, 0.0, 0.0))}),
        "point 'p' at .* is not on beam A or B",
    ),
    "on both": (
        lambda: brake_reuss_full(size=40.0, inputs={"p": Point((345.0, 12.7, 0.0))}),
        "point 'p' .* on both beams; give its side",
    ),
    "direction": (
        lambda: brake_reuss_full(size=40.0, inputs={"p": Point((10.0, 0.0, 0.0), "up")}),
        "direction 'up'",
    ),
    "no point": (lambda: brake_reuss_full(size=40.0, inputs={"p": 3.0}), "expected a Point"),
    "modulus": (lambda: Material(E=-1.0, nu=0.3, rho=1.0), "E = -1.0"),
}


@pytest.mark.parametrize(("call", "words"), BAD.values(), ids=BAD)
def test_bad_options_are_named(call, words):
    with pytest.raises(InputError, match=words):
        call()


def test_bad_springs_and_limits_are_named(full, reduced):
    for call, words in [
        (lambda: reduced.model({"J6.x": 1.0}), "no joint row is called 'J6.x'"),
        (lambda: reduced.model({"J1.x": -1.0}), "stiffness of J1.x = -1.0"),
        (lambda: full.modes({"J6.x": 1.0}, 10), "no joint row is called 'J6.x'"),
        (lambda: check_reduction(full, reduced, SPRINGS, 100.0), "no elastic mode below"),
        (lambda: full.reduce(0), "modes = 0"),
        (lambda: full.reduce(2.5), "modes = 2.5"),
    ]:
        with pytest.raises(InputError, match=words):
            call()
