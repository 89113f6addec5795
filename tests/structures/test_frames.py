import numpy as np
import pytest
from numpy.testing import assert_allclose

from iwanjax.errors import InputError
from iwanjax.structures.frames import Member, Section, frame

STEEL = Section(E=2.0e11, A=4e-4, I=1.2e-8, rho=7800.0)
LENGTH = 0.7


def straight(elements=10, angle=0.0):
    end = LENGTH * np.array([np.cos(angle), np.sin(angle)])
    return frame({"a": (0.0, 0.0), "b": end}, [Member("a", "b", STEEL, elements)])


def clamped(model):
    """Matrices with node a held."""
    return model.M[3:, 3:], model.K[3:, 3:]


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_free_beam_against_the_series(angle):
    """Roots of cos x cosh x = 1; the whole is turned, which changes nothing."""
    frequency = straight(20, angle).structure.modes().omega[:3]
    roots = np.array([4.730040745, 7.853204624, 10.995607838])
    exact = (roots / LENGTH) ** 2 * np.sqrt(STEEL.E * STEEL.I / (STEEL.rho * STEEL.A))
    assert_allclose(frequency, exact, rtol=1e-4)


@pytest.mark.parametrize("elements", [1, 3])
def test_tip_of_a_cantilever(elements):
    """F L^3 / 3 E I, F L^2 / 2 E I and F L / E A are exact with any number of elements."""
    model = straight(elements, angle=0.3)
    _, K = clamped(model)
    along, across = np.array([np.cos(0.3), np.sin(0.3)]), np.array([-np.sin(0.3), np.cos(0.3)])
    tip = np.array([model.row("b", motion) for motion in ("x", "y", "rz")])[:, 3:]
    u = tip @ np.linalg.solve(K, np.einsum("i,ij->j", across, tip[:2]))
    assert across @ u[:2] == pytest.approx(LENGTH**3 / (3 * STEEL.E * STEEL.I))
    assert u[2] == pytest.approx(LENGTH**2 / (2 * STEEL.E * STEEL.I))
    v = tip @ np.linalg.solve(K, np.einsum("i,ij->j", along, tip[:2]))
    assert along @ v[:2] == pytest.approx(LENGTH / (STEEL.E * STEEL.A))


def test_rigid_motion_strains_nothing_and_carries_the_whole_mass():
    model = frame(
        {"a": (0.0, 0.1), "b": (0.5, 0.3), "c": (0.2, 0.9)},
        [Member("a", "b", STEEL, 2), Member("b", "c", STEEL, 3)],
    )
    places = np.array(list(model.nodes.values()))
    turn = np.stack([-places[:, 1], places[:, 0], np.ones(len(places))], axis=1).ravel()
    shift = np.tile([1.0, 0.0, 0.0], len(places))
    assert np.abs(model.K @ np.stack([turn, shift], axis=1)).max() < 1e-9 * model.K.max()
    length = np.hypot(0.5, 0.2) + np.hypot(0.3, 0.6)
    assert shift @ model.M @ shift == pytest.approx(STEEL.rho * STEEL.A * length)
    for motion, offset, expected in [
        ("x", (0.2, 0.5), -(0.9 + 0.5)),
        ("y", (0.2, 0.5), 0.2 + 0.2),
        ("rz", (0.2, 0.5), 1.0),
    ]:
        assert model.row("c", motion, offset) @ turn == pytest.approx(expected)


def test_two_strips_joined_at_their_faces_are_one_beam_of_twice_the_height():
    """Many stiff springs along the interface: I = 8 I_strip instead of 2 I_strip."""
    b, h, cells = 0.02, 0.01, 40
    strip = Section(E=2e11, A=b * h, I=b * h**3 / 12, rho=7800.0)
    nodes = {
        "A0": (0.0, -h / 2), "A1": (LENGTH, -h / 2), "B0": (0.0, h / 2), "B1": (LENGTH, h / 2)
    }  # fmt: skip
    model = frame(nodes, [Member("A0", "A1", strip, cells), Member("B0", "B1", strip, cells)])
    K = model.K.copy()
    for i in range(cells + 1):
        name = {0: "{}0", cells: "{}1"}.get(i, "{0}0-{0}1:" + str(i))
        for motion in ("x", "y"):
            upper = model.row(name.format("B"), motion, (0.0, -h / 2))
            lower = model.row(name.format("A"), motion, (0.0, h / 2))
            K += 1e12 * np.outer(upper - lower, upper - lower)
    values = np.sort(np.linalg.eigvals(np.linalg.solve(model.M, K)).real)
    whole = (4.730040745 / LENGTH) ** 2 * np.sqrt(2e11 * b * (2 * h) ** 3 / 12 / (7800 * b * 2 * h))
    # The strips' mass sits on arms, which adds the rotary inertia that Euler's beam lacks.
    assert np.sqrt(values[3]) == pytest.approx(whole, rel=3e-3)


BAD = {
    "unknown node": ({"a": (0, 0), "b": (1, 0)}, [Member("a", "c", STEEL)], "'b' belongs to no"),
    "missing node": ({"a": (0, 0)}, [Member("a", "c", STEEL)], "no node is called 'c'"),
    "no length": ({"a": (0, 0), "b": (0, 0)}, [Member("a", "b", STEEL)], "no length"),
    "elements": ({"a": (0, 0), "b": (1, 0)}, [Member("a", "b", STEEL, 0)], "elements = 0"),
    "twice": ({"a": (0, 0), "b": (1, 0)}, [Member("a", "b", STEEL, 2)] * 2, "there twice"),
    "3-D": ({"a": (0, 0, 0), "b": (1, 0, 0)}, [Member("a", "b", STEEL)], "expected 2"),
}


@pytest.mark.parametrize(("nodes", "members", "words"), BAD.values(), ids=BAD)
def test_a_bad_frame_is_named(nodes, members, words):
    with pytest.raises(InputError, match=words):
        frame(nodes, members)


def test_bad_rows_and_sections_are_named():
    model = straight(1)
    for call, words in [
        (lambda: model.row("z", "x"), "no node is called 'z'"),
        (lambda: model.row("a", "z"), "not x, y or rz"),
        (lambda: model.row("a", "x", (1.0,)), "expected \\(r_x, r_y\\)"),
        (lambda: Section(E=1.0, A=1.0, I=0.0, rho=1.0), "I = 0.0 must be a positive number"),
    ]:
        with pytest.raises(InputError, match=words):
            call()
