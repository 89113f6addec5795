import numpy as np
import pytest
from numpy.testing import assert_allclose

from iwanjax.errors import InputError

pytest.importorskip("skfem", reason="scikit-fem (extra fem) is not installed")

from iwanjax.structures.fem.bricks import Material, bricks
from iwanjax.structures.fem.patches import Rectangle, averaging_rows, patch_facets, rigid_motion

STEEL = Material(E=195.40e3, nu=0.29, rho=7.735e-9)
UNEVEN = (np.array([0.0, 1.0, 1.5, 4.0, 5.0]), np.array([0.0, 1.0]), np.array([0.0, 0.4, 3.0]))
PATCHES = {
    "y": Rectangle((1.0, 1.0, 0.0), (4.0, 1.0, 3.0)),
    "z": Rectangle((1.0, 0.0, 3.0), (4.0, 1.0, 3.0)),
    "x": Rectangle((0.0, 0.0, 0.0), (0.0, 1.0, 3.0)),
}


def block(lines=UNEVEN):
    return bricks(lines, np.zeros([len(line) - 1 for line in lines], int), STEEL)


@pytest.mark.parametrize("patch", PATCHES.values(), ids=PATCHES)
@pytest.mark.parametrize("centre", [None, (7.0, -2.0, 0.3)])
def test_rigid_motion_is_reproduced_about_any_centre(patch, centre):
    model = block()
    where = patch.centre if centre is None else np.array(centre)
    rows = averaging_rows(model, patch_facets(model, 0, patch), where)
    motion = rigid_motion(model.nodes - where).reshape(-1, 6)
    # Moments of moments about a far centre: the condition grows with the fourth power of its
    # distance over the patch's shorter side.
    corners = np.array([patch.low, patch.high])
    sides = np.ptp(corners, axis=0)
    lever = np.max(np.linalg.norm(corners - where, axis=1)) / np.min(sides[sides > 0])
    assert_allclose(rows @ motion, np.eye(6), atol=1e-13 + 10 * np.finfo(float).eps * lever**4)


def test_average_is_the_surface_integral_whatever_the_mesh():
    """u = (x z, x^2, z^2 x^0) over x 1..4, z 0..3: means by hand, on an uneven mesh too."""
    patch = PATCHES["y"]
    for lines in (UNEVEN, (np.array([0.0, 1.0, 4.0, 5.0]), UNEVEN[1], np.array([0.0, 1.0, 3.0]))):
        model = block(lines)
        x, _, z = model.nodes.T
        u = np.stack([x * z, x**2, z**2], axis=1).ravel()
        rows = averaging_rows(model, patch_facets(model, 0, patch), patch.centre)
        found = rows @ u
        assert_allclose(found[:3], [2.5 * 1.5, 7.0, 3.0], rtol=1e-12)
        # Moments about the middle: int (z' u_x - x' u_z), over int (x'^2 + z'^2), and so on.
        variance = 9.0 / 12
        ry = (variance * 2.5 - 0.0) / (2 * variance)
        rx = -(0.0) / variance
        rz = (2 * 2.5 * variance) / variance
        assert_allclose(found[3:], [rx, ry, rz], atol=1e-12)


def test_only_the_free_faces_of_the_body_count():
    body = np.zeros((4, 1, 2), int)
    body[2:] = 1
    model = bricks(UNEVEN, body, STEEL)
    side = Rectangle((1.5, 0.0, 0.0), (1.5, 1.0, 3.0))
    assert len(patch_facets(model, 0, side)) == len(patch_facets(model, 1, side)) == 2
    with pytest.raises(InputError, match="no face of body 0"):
        patch_facets(model, 0, Rectangle((4.0, 0.0, 0.0), (4.0, 1.0, 3.0)))
