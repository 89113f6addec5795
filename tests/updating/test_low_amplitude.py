import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from iwanjax.errors import InputError
from iwanjax.structures.affine import AffineStructure, spring
from iwanjax.updating.linear import MeasuredModes, positive_parameter, update_linear
from iwanjax.updating.linear_solution import LinearSolution

TRUE = {"modulus": 200.0, "joint": 60.0, "idle": 30.0}
N = 6


def family() -> AffineStructure:
    """A chain of one modulus with a joint's spring across its middle; two masses hang idle.

    The idle spring lies between masses that move alike in all of the chain's modes but its
    own, so that no mode of the chain tells its stiffness.
    """
    difference = np.zeros((N - 1, N + 2))
    for i in range(N - 1):
        difference[i, i : i + 2] = -1.0, 1.0
    ground = np.zeros((1, N + 2))
    ground[0, 0] = 1.0
    body = np.vstack([np.delete(difference, 2, axis=0), ground])
    idle = np.zeros(N + 2)
    idle[N:] = -1.0, 1.0
    rest = 1e-3 * np.diag([0.0] * N + [1.0, 1.0]) * 1e6
    terms = {"modulus": spring(*body), "joint": spring(difference[2]), "idle": spring(idle)}
    return AffineStructure(np.eye(N + 2), rest, terms)


PARAMETERS = {
    "modulus": positive_parameter("modulus", 180.0, 1.2),
    "joint": positive_parameter("joint", 20.0, 4.0),
    "idle": positive_parameter("idle", 10.0, 4.0),
}
SENSORS = np.eye(N + 2)[[0, 2, 3, 5]]
STD = 1e-3


@pytest.fixture(scope="module")
def truth():
    """Frequencies in Hz and shapes at the sensors of the lowest four modes."""
    modes = family().at(TRUE).modes()
    return np.asarray(modes.frequency)[:4], SENSORS @ np.asarray(modes.Phi)[:, :4]


@pytest.fixture(scope="module")
def found(truth) -> LinearSolution:
    f, shapes = truth
    # Any scale and sign, and another order than the model's.
    order = [2, 0, 3, 1]
    measured = MeasuredModes(f[order], STD, (shapes * [3.0, -1.0, 0.2, -7.0])[:, order], 0.02)
    return update_linear(family(), measured, PARAMETERS, sensors=SENSORS)


def test_what_the_modes_determine_is_found(found, truth):
    for name in ("modulus", "joint"):
        assert found.determined[name]
        assert abs(found.values[name] - TRUE[name]) < 2.0 * found.std[name]
        assert found.std[name] < 0.02 * TRUE[name]
    np.testing.assert_allclose(found.frequency, truth[0][[2, 0, 3, 1]], atol=3.0 * STD)
    np.testing.assert_allclose(found.assurance, 1.0, atol=1e-4)
    assert found.mode.tolist() == [2, 0, 3, 1]
    assert found.converged
    assert not found.rivals


def test_what_they_do_not_determine_keeps_its_prior_and_is_said(found):
    assert not found.determined["idle"]
    # The prior's middle is that of 4000 draws, so within 7 % of its median (3 deviations).
    assert found.values["idle"] == pytest.approx(10.0, rel=0.07)
    (direction,) = found.undetermined
    assert abs(direction.components["idle"]) > 0.99
    assert "do not determine" in found.summary()
    assert "(undetermined)" in found.summary()


def test_deviations_cover_the_truth(truth):
    f, _ = truth
    random = np.random.default_rng(3)
    pulls = []
    for _ in range(12):
        noisy = f + STD * random.standard_normal(4)
        solution = update_linear(
            family(), MeasuredModes(noisy, STD), PARAMETERS, modes=[0, 1, 2, 3], starts=1
        )
        pulls += [(solution.values[n] - TRUE[n]) / solution.std[n] for n in ("modulus", "joint")]
    # 24 pulls of deviation 1: their root mean square lies within 0.55 and 1.45 for 99.8 %.
    assert 0.55 < np.sqrt(np.mean(np.square(pulls))) < 1.45


def test_a_shape_that_the_model_cannot_follow_may_count_less(truth):
    """One deviation for each mode: the joint is less far off the less a wrong shape is believed."""
    f, shapes = truth
    wrong = shapes * np.array([1.0, 1.0, 1.0, 1.05])[:, None] ** [[0, 0, 0, 1]]
    off = []
    for last in (0.001, 0.1):
        share = [0.001, 0.001, 0.001, last]
        told = update_linear(
            family(), MeasuredModes(f, 0.01, wrong, share), PARAMETERS, sensors=SENSORS
        )
        off.append(abs(told.values["joint"] / TRUE["joint"] - 1.0))
    assert off[1] < 0.1 * off[0]


def test_modes_are_followed_where_frequencies_cross():
    """Two oscillators, one stiffer than the other at the start, the other way in truth."""
    terms = {"a": spring([1.0, 0.0]), "b": spring([0.0, 1.0])}
    structure = AffineStructure(np.eye(2), 0.01 * np.array([[1.0, -1.0], [-1.0, 1.0]]), terms)
    parameters = {n: positive_parameter(n, v, 5.0) for n, v in (("a", 100.0), ("b", 150.0))}
    f = np.sqrt(np.array([200.0, 120.0])) / (2.0 * np.pi)
    measured = MeasuredModes(f, 1e-4, np.eye(2))
    solution = update_linear(structure, measured, parameters, sensors=np.eye(2))
    assert solution.values == pytest.approx({"a": 200.0, "b": 120.0}, rel=1e-3)
    assert solution.mode.tolist() == [1, 0]


def test_two_minima_that_are_as_good_are_both_told():
    """Two masses alike, tied together: whose spring is the stiffer one no frequency says."""
    terms = {"a": spring([1.0, 0.0]), "b": spring([0.0, 1.0])}
    structure = AffineStructure(np.eye(2), 300.0 * np.array([[1.0, -1.0], [-1.0, 1.0]]), terms)
    parameters = {n: positive_parameter(n, 140.0, 1.5) for n in terms}
    f = np.asarray(structure.at({"a": 200.0, "b": 100.0}).modes().frequency)
    found = update_linear(structure, MeasuredModes(f, 1e-4), parameters, modes=[0, 1], starts=8)
    for name in terms:
        low, high = found.rivals[name]
        assert (low, high) == pytest.approx((100.0, 200.0), rel=0.02)
        assert not found.determined[name]
    assert "Other minima explain these modes as well" in found.summary()


def test_a_bound_that_is_asked_to_give_way_is_said(truth):
    capped = dataclasses.replace(PARAMETERS["joint"], lower=5.0, upper=40.0)
    solution = update_linear(
        family(),
        MeasuredModes(truth[0], STD),
        PARAMETERS | {"joint": capped},
        modes=[0, 1, 2, 3],
    )
    assert solution.active_bounds == {"joint": 40.0}
    assert "BOUND: joint rests on its bound 40" in solution.summary()


def test_the_updated_structure_has_the_frequencies(found):
    omega = jnp.sort(found.updated.modes().omega)[jnp.array(found.mode)]
    np.testing.assert_allclose(omega / (2.0 * np.pi), found.frequency, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parameters": {}}, "parameters are none; the structure has modulus, joint, idle"),
        ({"modes": None}, "no shapes were measured; give modes"),
        ({"modes": [0, 1, 2]}, r"modes are \[0, 1, 2\]; expected 4 of 0 to 7"),
        ({"modes": [0, 1, 2, 9]}, "expected 4 of 0 to 7"),
        ({"sensors": SENSORS}, "give modes, and not sensors"),
        ({"starts": 0}, "starts = 0; expected a whole number"),
        ({"structure": np.eye(2)}, "expected an AffineStructure, got ndarray"),
        (
            {"parameters": {n: dataclasses.replace(p, fixed=True) for n, p in PARAMETERS.items()}},
            "all parameters are fixed",
        ),
    ],
)
def test_wrong_arguments_are_refused(truth, change, message):
    given = {
        "structure": family(),
        "measured": MeasuredModes(truth[0], STD),
        "parameters": PARAMETERS,
        "modes": [0, 1, 2, 3],
    } | change
    with pytest.raises(InputError, match=message):
        update_linear(**given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"frequency": [1.0, np.nan]}, "NaN"),
        ({"frequency": [1.0, -2.0]}, "frequency holds -2; expected Hz above 0"),
        ({"frequency_std": [0.1]}, "one of each for each mode"),
        ({"shapes": np.ones((3, 1))}, r"expected \(sensors, 2\)"),
        ({"shapes": np.zeros((3, 2))}, "zero throughout"),
        ({"shapes": np.ones((3, 2)), "shape_std": 0.0}, "shape_std holds 0"),
        ({"shapes": np.ones((3, 2)), "shape_std": [0.1] * 3}, r"shape_std has shape \(3,\)"),
    ],
)
def test_wrong_measurements_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        MeasuredModes(**({"frequency": [1.0, 2.0], "frequency_std": 0.1} | given))


def test_a_parameter_needs_a_positive_value_and_a_factor_above_one():
    with pytest.raises(InputError, match="factor = 1; expected"):
        positive_parameter("k", 1.0, 1.0)


def test_it_comes_back_from_its_file(found, tmp_path):
    loaded = LinearSolution.load(found.save(tmp_path / "linear.npz"))
    assert loaded.summary() == found.summary()
    np.testing.assert_array_equal(loaded.updated.K, found.updated.K)
    assert "measured Hz</th>" in found._repr_html_()
