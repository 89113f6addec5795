import dataclasses
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from iwanjax.errors import InputError
from iwanjax.plotting import plot, plot_assurance, plot_shapes, plot_strokes
from iwanjax.plotting.style import PALETTE
from iwanjax.structures.reduced_model import ReducedModel, SurfaceShape
from iwanjax.updating.linear import positive_parameter
from iwanjax.updating.linear_solution import LinearSolution


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


@pytest.fixture
def model() -> ReducedModel:
    """Two squares side by side along x, the right one a contact patch; y and z move it."""
    points = np.array([[x, 0.0, z] for x in (0.0, 1.0, 2.0) for z in (0.0, 1.0)])
    recovery = np.zeros((6, 3, 2))
    recovery[:, 1, 0] = points[:, 0] ** 2
    recovery[:, 2, 1] = 1.0
    surface = SurfaceShape(
        points, np.array([[0, 2, 3, 1], [2, 4, 5, 3]]), np.array([-1, 0]), recovery
    )
    return ReducedModel(
        M=np.eye(2),
        K=np.eye(2),
        coordinates=("J1A.y", "J1B.y"),
        rows={"J1.x": np.array([0.1, 0.0]), "J1.y": np.array([-1.0, 1.0])},
        sensors={},
        inputs={},
        shape=surface,
        fixed_frequency=np.zeros(0),
        effective_mass=np.zeros((0, 6)),
        residual_flexibility={},
    )


def drawn(figure) -> list[list[PolyCollection]]:
    return [
        [each for each in ax.collections if isinstance(each, PolyCollection)] for ax in figure.axes
    ]


def test_shapes_are_drawn_over_the_structure_at_rest(model):
    figure = plot_shapes(model, np.eye(2), frequency=[12.0, 34.5], names=["bending"])
    assert [ax.get_title("left") for ax in figure.axes] == ["bending, 12 Hz", "34.5 Hz"]
    (ghost, moved), _ = drawn(figure)
    still, bent = (np.concatenate([p.vertices for p in c.get_paths()]) for c in (ghost, moved))
    # Bending by x squared: up on paper, the most at the end, and no more than can be read.
    rise = np.max(bent[:, 1]) - np.max(still[:, 1])
    assert 0.05 < rise < 0.15
    assert np.min(bent[:, 1]) == pytest.approx(np.min(still[:, 1]))
    assert figure.legends[0].get_texts()[0].get_text() == "J1"


def test_patches_are_drawn_last_in_their_joints_colour(model):
    (_, moved), *_ = drawn(plot_shapes(model, [1.0, 0.0]))
    hexed = [to_hex(c).upper() for c in moved.get_facecolor()]
    assert hexed[-1] == PALETTE[1]


def test_shapes_that_do_not_fit_are_refused(model):
    with pytest.raises(InputError, match=r"shapes have shape \(3, 1\); expected \(2, k\)"):
        plot_shapes(model, np.ones(3))
    with pytest.raises(InputError, match="no surface"):
        plot_shapes(dataclasses.replace(model, shape=None), np.eye(2))


def test_strokes_are_shares_of_the_largest(model):
    figure = plot_strokes(model, np.array([[0.0, 1.0], [1.0, 0.5]]), names=["a", "b"])
    (image,) = figure.axes[0].images
    # J1.y: 1 and -0.5; J1.x: 0 (drawn at the scale's end) and 0.1.
    np.testing.assert_allclose(image.get_array(), [[1e-4, 0.1], [1.0, 0.5]])
    assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == ["J1.x", "J1.y"]
    with pytest.raises(InputError, match="no row 'J9'; there are"):
        plot_strokes(model, np.eye(2), rows=["J9"])
    with pytest.raises(InputError, match="expected"):
        plot_strokes(model, np.ones(2))


def test_assurances_carry_their_numbers():
    figure = plot_assurance([[1.0, 0.25], [0.0, 0.9]], rows=["a", "b"], of=("test", "model"))
    ax = figure.axes[0]
    assert [t.get_text() for t in ax.texts] == ["1.00", "0.25", "0.00", "0.90"]
    assert (ax.get_ylabel(), ax.get_xlabel()) == ("test", "model")
    with pytest.raises(InputError, match="values from 0 to 1"):
        plot_assurance([[1.5]])


def test_linear_updating_shows_errors_and_factors():
    started = (positive_parameter("k", 10.0, 3.0), positive_parameter("idle", 5.0, 2.0))
    found = tuple(
        dataclasses.replace(p, value=v) for p, v in zip(started, (30.0, 5.0), strict=True)
    )
    solution = LinearSolution(
        parameters=found,
        started=started,
        covariance=np.diag([0.3**2, 3.0**2]),
        undetermined=(),
        determined={"k": True, "idle": False},
        rivals={},
        active_bounds={},
        measured_frequency=np.array([10.0, 20.0]),
        frequency_std=np.array([0.01, 0.01]),
        frequency_before=np.array([9.0, 19.0]),
        frequency=np.array([10.0, 20.02]),
        mode=np.array([0, 1]),
        assurance=np.ones(2),
        misfit_frequency=1.4,
        misfit_shapes=None,
        converged=True,
        agreeing=1,
        runs=1,
        structure=SimpleNamespace(),
    )
    errors, factors = plot(solution).axes
    before, after = (line.get_xdata() for line in errors.lines[1:3])
    np.testing.assert_allclose(before, [-10.0, -5.0])
    np.testing.assert_allclose(after, [0.0, 0.1], atol=1e-12)
    points = [
        line for line in factors.lines if line.get_marker() == "s" and np.size(line.get_xdata())
    ]
    assert [float(np.asarray(line.get_xdata())[0]) for line in points] == pytest.approx([3.0, 1.0])
    assert [line.get_markerfacecolor() for line in points][1] == "white"
