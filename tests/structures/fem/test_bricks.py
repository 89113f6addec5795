import sys

import numpy as np
import pytest
import scipy.sparse.csgraph
import scipy.sparse.linalg
from numpy.testing import assert_allclose

from iwanjax.errors import InputError

pytest.importorskip("skfem", reason="scikit-fem (extra fem) is not installed")

from iwanjax.structures.fem.bricks import EMPTY, Material, bricks, grid_lines
from iwanjax.structures.fem.library import skfem
from iwanjax.structures.fem.patches import rigid_motion
from iwanjax.structures.reduction import full_modes

STEEL = Material(E=195.40e3, nu=0.29, rho=7.735e-9)
LINES = (np.array([0.0, 3.0, 4.0, 9.0]), np.array([-1.0, 0.0, 2.0]), np.array([0.0, 1.5, 2.0]))


def block(lines=LINES, material=STEEL, welds=(), body=None):
    shape = [len(line) - 1 for line in lines]
    return bricks(lines, np.zeros(shape, int) if body is None else body, material, welds)


def test_rigid_motion_strains_nothing_and_has_the_block_s_inertia():
    model = block()
    R = rigid_motion(model.nodes).reshape(-1, 6)
    assert np.abs(model.K @ R).max() < 1e-12 * np.abs(model.K).max() * np.abs(R).max()
    low, high = np.array([0.0, -1.0, 0.0]), np.array([9.0, 2.0, 2.0])
    mass = STEEL.rho * np.prod(high - low)
    second = mass * (low**2 + low * high + high**2) / 3  # of x², y², z²
    product = mass * np.outer(low + high, low + high) / 4
    inertia = R.T @ (model.M @ R)
    assert_allclose(inertia[:3, :3], mass * np.eye(3), atol=1e-12 * mass)
    expected = np.sum(second) * np.eye(3) - product
    expected[np.diag_indices(3)] = np.sum(second) - second
    assert_allclose(inertia[3:, 3:], expected, rtol=1e-10)


def test_uniform_strain_has_the_energy_of_hooke_s_law():
    """Patch test on unequal cells: sigma = lambda tr(eps) I + 2 mu eps."""
    model = block()
    A = np.random.default_rng(1).normal(size=(3, 3))
    eps = (A + A.T) / 2
    lam, mu = STEEL.lame
    density = 0.5 * lam * np.trace(eps) ** 2 + mu * np.sum(eps**2)
    u = (model.nodes @ A.T).ravel()
    assert 0.5 * u @ (model.K @ u) == pytest.approx(54.0 * density, rel=1e-12)
    # Young's modulus and Poisson's ratio from the Lamé constants.
    assert mu * (3 * lam + 2 * mu) / (lam + mu) == pytest.approx(STEEL.E)
    assert lam / (2 * (lam + mu)) == pytest.approx(STEEL.nu)


@pytest.mark.parametrize(("size", "layers", "tolerance"), [(36.0, 2, 5e-3), (20.0, 2, 2.5e-3)])
def test_plain_bar_against_timoshenko(size, layers, tolerance):
    """252.005, 688.914, 1334.33, 2171.00 Hz; plain 8-node bricks are 3 to 4 % above."""
    side = np.linspace(0, 25.4, layers + 1)
    bar = block((grid_lines([0.0, 720.0], size), side, side))
    frequency, _ = full_modes(bar.M, bar.K, {}, 15, shift=25.0)
    # Bending comes in pairs; the seventh elastic mode is torsion.
    timoshenko = np.array([252.005, 688.914, 1334.33, 2171.00])
    assert_allclose(frequency[[6, 8, 10, 13]], timoshenko, rtol=tolerance)


def test_unwelded_bodies_share_no_node_and_welded_ones_are_one():
    body = np.zeros((3, 2, 2), int)
    body[1:] = 1
    parts = {}
    for welds in ((), ((0, 1),)):
        model = block(body=body, welds=welds)
        parts[welds] = scipy.sparse.csgraph.connected_components(model.K != 0)[0]
        if welds:
            whole = block()
            assert model.size == whole.size
            assert_allclose(model.K.toarray(), whole.K.toarray(), atol=1e-8 * STEEL.E)
    assert list(parts.values()) == [2, 1]


def test_empty_cells_weigh_nothing():
    body = np.zeros((3, 2, 2), int)
    body[1, 1] = EMPTY
    model = block(body=body)
    volume = 54.0 - 1.0 * 2.0 * 2.0
    assert model.M.sum() / 3 == pytest.approx(STEEL.rho * volume)


def test_rows_of_a_point_interpolate_a_quadratic_field():
    model = block()
    x, y, z = model.nodes.T
    field = np.stack([x * y - z, z**2 + y, 1.0 + x * z], axis=1).ravel()
    px, py, pz = 3.7, 0.4, 1.9
    rows = model.rows((px, py, pz), 0)
    assert_allclose(rows @ field, [px * py - pz, pz**2 + py, 1.0 + px * pz], rtol=1e-12)
    assert model.rows((px, py, 2.1), 0) is None
    assert model.rows((px, py, pz), 1) is None


def test_grid_lines():
    assert_allclose(grid_lines([0.0, 1.0, 0.3], 0.5), [0.0, 0.3, 0.65, 1.0])
    assert_allclose(grid_lines([0.0, 1.0], 0.25), [0.0, 0.25, 0.5, 0.75, 1.0])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((0.0, 0.3, 1.0), "E = 0.0 must be a positive number"),
        ((1.0, 0.5, 1.0), "nu = 0.5 must lie"),
        ((1.0, 0.3, -1.0), "rho = -1.0"),
        ((1.0, 0.3, np.nan), "rho holds 1 NaN"),
    ],
)
def test_a_bad_material_is_named(values, words):
    with pytest.raises(InputError, match=words):
        Material(*values)


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "skfem", None)
    with pytest.raises(InputError, match=r"pip install 'iwanjax\[fem\]'"):
        skfem()
