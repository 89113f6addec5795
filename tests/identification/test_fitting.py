"""Steps of a search, joints by their deviations, and evidence."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import iwanjax as ij
from iwanjax.correlation import correlation_time
from iwanjax.estimation.levenberg_marquardt import Descent, Layout, SearchStart, step_within
from iwanjax.estimation.linearisation import Linearisation
from iwanjax.identification.joint_priors import Joint, joints_at, located
from iwanjax.types import compiled_for_one_call

jax.config.update("jax_enable_x64", True)


@given(st.integers(0, 10**6), st.integers(1, 6))
def test_a_step_stays_inside_and_is_the_best_of_those_that_stop_where_it_stops(seed, size):
    random = np.random.default_rng(seed)
    root = random.standard_normal((size, size))
    normal = root @ root.T + 0.1 * np.eye(size)
    moment = 5.0 * random.standard_normal(size)
    x, low, high = random.uniform(-1.0, 1.0, size), np.full(size, -1.2), np.full(size, 1.5)
    move = step_within(normal, moment, x, low, high)
    assert np.all((x + move <= 1.5 * (1.0 + 1e-12)) & (x + move >= -1.2 * (1.0 + 1e-12)))
    free = (x + move < 1.5 * (1.0 - 1e-12)) & (x + move > -1.2 * (1.0 - 1e-12))
    np.testing.assert_allclose((moment + normal @ move)[free], 0.0, atol=1e-8)


def test_a_step_without_a_border_is_newtons():
    normal = np.array([[2.0, 0.5], [0.5, 1.0]])
    moment = np.array([1.0, -3.0])
    move = step_within(normal, moment, np.zeros(2), np.full(2, -np.inf), np.full(2, np.inf))
    np.testing.assert_allclose(move, -np.linalg.solve(normal, moment))


def test_a_border_does_not_stop_the_others():
    """Coupled values: the second one goes on to its best with the first one held."""
    normal = np.array([[1.0, 0.9], [0.9, 1.0]])
    high = np.array([1.0, np.inf])
    move = step_within(normal, np.array([-10.0, 0.0]), np.zeros(2), -high, high)
    np.testing.assert_allclose(move, [1.0, -0.9])


@given(st.floats(0.1, 10.0), st.floats(0.3, 3.0), st.floats(-0.9, -0.1), st.floats(0.05, 20.0))
def test_a_joint_is_located_where_it_is(F_S, K_T, chi, beta):
    given_joint = ij.Iwan4(F_S=1.0, K_T=1.0, chi=-0.5, beta=1.0)
    joint = Joint(given_joint, jnp.array([1.0, 2.0, 0.5, 3.0]))
    wanted = {"F_S": F_S, "K_T": K_T, "chi": chi, "beta": beta}
    (found,) = joints_at((joint,), jnp.asarray(located(joint, wanted)))
    for name, value in wanted.items():
        assert float(getattr(found, name)) == pytest.approx(value, rel=1e-9)


def test_what_is_not_named_stays_as_given():
    joint = Joint(ij.Iwan4(F_S=2.0, K_T=3.0, chi=-0.4, beta=0.5), jnp.ones(4))
    z = located(joint, {"F_S": 4.0})
    assert z[0] > 0
    np.testing.assert_array_equal(z[1:], 0.0)


def test_the_correlation_time_of_white_noise_is_one_and_of_a_first_order_process_its_own():
    random = np.random.default_rng(0)
    white = random.standard_normal((2, 20_000, 3))
    assert correlation_time(white) == pytest.approx(1.0, abs=0.1)
    rho, slow = 0.8, np.zeros_like(white)
    for n in range(1, white.shape[1]):
        slow[:, n] = rho * slow[:, n - 1] + white[:, n]
    assert correlation_time(slow) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.1)


def test_a_run_that_broke_down_has_a_correlation_time():
    broken = np.random.default_rng(0).standard_normal((1, 5_000, 1)) * 1e200
    assert correlation_time(broken) == pytest.approx(1.0, abs=0.2)
    assert correlation_time(np.full((1, 50, 1), np.inf)) == 1.0
    assert correlation_time(np.zeros((1, 50, 1))) == 1.0


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_curve_of_few_levels_has_a_correlation_time(count):
    assert correlation_time(np.linspace(0.0, 1.0, 2 * count).reshape(1, count, 2)) == 1.0


def test_a_kernel_of_one_call_computes_the_same():
    def f(x):
        return jnp.sin(x) ** 2 + jnp.exp(-x), "label"

    x = jnp.linspace(0.0, 3.0, 50)
    quick, slow = compiled_for_one_call(f)(x), eqx.filter_jit(f)(x)
    np.testing.assert_allclose(quick[0], slow[0], rtol=1e-14)
    assert quick[1] == slow[1] == "label"


@given(st.integers(0, 10**6), st.integers(1, 5))
def test_what_a_step_promises_is_the_least_squares_of_a_linear_model(seed, size):
    random = np.random.default_rng(seed)
    slopes, residual = random.standard_normal((12, size)), random.standard_normal(12)
    precision, x = random.uniform(0.0, 2.0, size), random.standard_normal(size)
    seen = Linearisation(
        np.array([residual @ residual]),
        (slopes.T @ residual)[None],
        (slopes.T @ slopes)[None],
        residual[None, :, None],
        jnp.asarray(slopes[None]),
    )
    layout = Layout(np.zeros((1, size)), np.eye(size)[None], precision)
    lane = Descent.at(SearchStart(layout, x), 12, seen)
    # By an independent route: the same as rows of one least-squares problem.
    rows = np.concatenate([slopes, np.diag(np.sqrt(precision))])
    wanted = np.concatenate([residual - slopes @ x, np.zeros(size)])
    left = np.linalg.lstsq(rows, -wanted, rcond=None)[0]
    assert lane.foreseen == pytest.approx(float(np.sum((rows @ left + wanted) ** 2)), rel=1e-9)
    assert lane.foreseen <= lane.cost * (1.0 + 1e-12)


@given(st.floats(-5.0, 5.0).filter(lambda k3: abs(k3) > 0.1), st.floats(-20.0, 20.0))
def test_a_stiffness_of_either_sign_is_located_where_it_is(k3, wanted):
    joint, name = Joint(ij.CubicSpring(k3=k3), jnp.array([2.0])), "k3"
    (found,) = joints_at((joint,), jnp.asarray(located(joint, {name: wanted})))
    assert float(getattr(found, name)) == pytest.approx(wanted, rel=1e-9, abs=1e-9)
