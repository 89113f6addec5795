"""Parameters with their bounds, and the unbounded variables that a search moves."""

from dataclasses import replace
from fractions import Fraction

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from updating.simulated import NAMES, TRUTH, noisy

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.estimation import LogNormal, Normal, Parameter, Uniform
from iwanjax.estimation.parameters import Chart, replaced
from iwanjax.updating import modal_parameters
from iwanjax.updating.modal import ModalIwanProblem, modal_problem

PRIOR = Normal(0.0, 1.0)


def parameter(name="p", value=0.5, **options):
    return Parameter(name, value, PRIOR, **options)


SHARE = st.floats(1e-4, 1.0 - 1e-4)
LOG = st.floats(-12.0, 12.0).map(lambda x: 10.0**x)
PLAIN = st.floats(-1e6, 1e6)


@given(LOG, SHARE, PLAIN, st.floats(-1e3, 1e3), LOG)
def test_values_and_variables_are_each_others_inverse(positive, share, plain, low, width):
    upper = low + width
    between = low + share * (upper - low)
    if not low < between < upper:
        return
    chart = Chart(
        [
            parameter("a", positive, lower=0.0, transform="log"),
            parameter("f", 7.0, fixed=True),
            parameter("b", between, lower=low, upper=upper, transform="logit"),
            parameter("c", plain),
        ]
    )
    assert chart.free == (0, 2, 3)
    theta = np.array([positive, 7.0, between, plain])
    z = np.asarray(chart.to_variables(theta))
    back = np.asarray(chart.to_values(z))
    np.testing.assert_allclose(back[[0, 3]], theta[[0, 3]], rtol=1e-13)
    assert back[1] == 7.0
    # A narrow range far from zero is known to its ends' own digits.
    assert back[2] == pytest.approx(between, rel=1e-14, abs=1e-11 * width)
    assert z[0] == pytest.approx(np.log(positive), abs=1e-14)
    # Rounded to its digits it lies elsewhere in the range than drawn.
    low, between, upper = map(Fraction, (low, between, upper))
    assert z[1] == pytest.approx(np.log(float((between - low) / (upper - between))), abs=1e-11)
    assert z[2] == plain


@given(st.floats(-700.0, 700.0))
def test_no_variable_leads_out_of_the_bounds(z):
    chart = Chart(
        [
            parameter("a", 0.5, lower=-1.0, upper=2.0, transform="logit"),
            parameter("b", 0.5, lower=0.0, transform="log"),
        ]
    )
    a, b = np.asarray(chart.to_values(np.array([z, z])))
    # On a bound itself, as chi = -1, a law may mean nothing.
    assert -1.0 < a < 2.0
    assert b > 0.0


@pytest.mark.parametrize("transform", ["log", "logit", "identity"])
@given(st.floats(-700.0, 700.0))
def test_two_bounds_hold_whatever_the_transform(transform, z):
    chart = Chart([parameter("a", 1.5, lower=1.0, upper=2.0, transform=transform)])
    (a,) = np.asarray(chart.to_values(np.array([z])))
    assert 1.0 <= a <= 2.0
    assert float(chart.to_values(chart.to_variables(np.array([1.5])))[0]) == pytest.approx(1.5)


@given(st.floats(-700.0, 700.0))
def test_one_lower_bound_holds(z):
    chart = Chart([parameter("a", 1.5, lower=1.0, transform="log")])
    assert float(chart.to_values(np.array([z]))[0]) >= 1.0
    assert float(chart.to_values(chart.to_variables(np.array([1.5])))[0]) == pytest.approx(1.5)


@pytest.mark.parametrize("end", [-1.0, 2.0])
def test_a_value_on_a_bound_has_a_finite_variable(end):
    chart = Chart([parameter("a", end, lower=-1.0, upper=2.0, transform="logit")])
    z = chart.to_variables(np.array([end]))
    assert np.all(np.isfinite(z))
    # A hair of the range inside, so that a search can still move it.
    assert float(chart.to_values(z)[0]) == pytest.approx(end, abs=4e-6)
    assert np.all(np.abs(np.asarray(jax.jacfwd(chart.to_values)(z))) > 1e-7)


def test_a_positive_value_of_zero_has_a_finite_variable():
    chart = Chart([parameter("a", 0.0, lower=0.0, transform="log")])
    assert np.all(np.isfinite(chart.to_variables(np.zeros(1))))


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"lower": 1.0, "upper": 0.0}, "cross"),
        ({"lower": 0.5, "upper": 0.5}, "cross"),
        ({"lower": float("nan")}, "cross"),
        ({"lower": -1.0, "transform": "log"}, "log transform needs lower >= 0"),
        ({"transform": "log"}, "log transform needs lower >= 0"),
        ({"lower": 0.0}, "one-sided"),
        ({"upper": 1.0}, "one-sided"),
        ({"lower": 0.0, "transform": "logit"}, "two finite bounds"),
        ({"transform": "logit"}, "two finite bounds"),
        ({"lower": 0.6, "transform": "log"}, "outside its bounds"),
        ({"lower": 0.0, "upper": 0.4}, "outside its bounds"),
        ({"value": float("nan")}, "outside its bounds"),
    ],
)
def test_contradictions_are_refused(options, told):
    with pytest.raises(InputError, match=f"parameter J1.F_S: .*{told}"):
        parameter("J1.F_S", **options)


def test_parameters_are_exchanged_by_name():
    row = (parameter("a"), parameter("b"))
    other = parameter("b", 0.7, fixed=True)
    assert replaced(row, {"b": other}) == (row[0], other)
    for wrong in ({"a": other}, {"a": 1.0}, [other]):
        with pytest.raises(InputError, match="parameters"):
            replaced(row, wrong)
    with pytest.raises(InputError, match="no parameter is called 'F_s'; there are a, b"):
        replaced(row, {"F_s": replace(other, name="F_s")})


# --- those of a mode ----------------------------------------------------------------------


def test_a_modes_parameters_are_on_the_scale_of_its_curves():
    found = modal_parameters(ij.Iwan4, noisy(0))
    assert tuple(found) == NAMES
    for name, p in found.items():
        truth = getattr(TRUTH, name)
        assert p.name == name
        assert p.lower <= truth <= p.upper
        # The truth lies well within what the prior takes for possible.
        draws = p.prior.draw(np.random.default_rng(0), 4000)
        assert np.quantile(draws, 0.01) < truth < np.quantile(draws, 0.99), name
    assert (found["chi"].lower, found["chi"].upper) == (-1.0, 0.0)
    assert found["f_0"].unit == "Hz"
    assert found["K_T"].unit == "force/length"


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_other_units_give_the_same_parameters_in_them(scale):
    """Amplitudes in mm instead of m: forces per mass a thousand times the number, K_T equal."""
    c = noisy(0)
    other = modal_parameters(ij.Iwan4, c.scaled(scale, "displacement"))
    found = modal_parameters(ij.Iwan4, c)
    for name in NAMES:
        factor = scale if name == "F_S" else 1.0
        assert other[name].value == pytest.approx(factor * found[name].value, rel=1e-12)


def test_other_joints_have_parameters_of_their_own():
    c = noisy(0)
    assert tuple(modal_parameters(ij.Jenkins, c)) == ("f_0", "zeta_0", "F_S", "K_T")
    assert isinstance(modal_parameters(ij.Iwan5, c)["theta"].prior, Uniform)
    cubic = modal_parameters(ij.CubicSpring, c)["k3"]
    assert isinstance(cubic.prior, Normal | LogNormal)


def problem():
    c = noisy(0)
    made = modal_problem(ij.Iwan4, [c], tuple(modal_parameters(ij.Iwan4, c).values()), "absolute")
    assert isinstance(made, ModalIwanProblem)
    return made


@given(
    st.floats(-3, 3).map(lambda x: 1.8 * 10**x),
    st.floats(-3, 1).map(lambda x: 2.75e4 * 10**x),
    st.floats(-0.999, -0.001),
    st.floats(-4, 3).map(lambda x: 10**x),
)
def test_variables_that_suit_microslip_are_inverted(F_S, K_T, chi, beta):
    made = problem()
    theta = np.array([118.0, 4e-4, F_S, K_T, chi, beta])
    back = np.asarray(made.to_values(made.to_variables(theta)))
    np.testing.assert_allclose(back, theta, rtol=1e-11)


def test_in_microslip_phi_max_alone_says_nothing():
    """The fourth variable is what the curves see: along the third they do not change."""
    made = problem()
    theta = np.array([118.0, 4e-4, 1.8, 2.75e4, -0.45, 0.8])
    z = np.asarray(made.to_variables(theta))
    far = made.to_values(z + np.array([0, 0, 2.0, 0, 0, 0]))
    further = made.to_values(z + np.array([0, 0, 3.0, 0, 0, 0]))
    assert float(further[2] / far[2]) > 2.0
    # K_T grows as well, but the curves only know f_0 and the drop from it.
    f, zeta = made.predict(far)
    again_f, again_zeta = made.predict(further)
    np.testing.assert_allclose(again_f, f, rtol=1e-12)
    np.testing.assert_allclose(again_zeta, zeta, rtol=1e-9)


def test_starts_are_spread_over_the_kink():
    c, made = noisy(0), problem()
    rng = np.random.default_rng(0)
    draws = np.stack([p.prior.draw(rng, 64) for p in modal_parameters(ij.Iwan4, c).values()], 1)
    draws[:, 5] = np.abs(draws[:, 5])
    spread = made.spread(draws)
    assert spread.shape == draws.shape
    phi_max = np.array([float(ij.Iwan4(*row[2:]).phi_max) for row in spread])
    inside = (phi_max > float(c.amplitude.min())) & (phi_max < float(c.amplitude.max()))
    assert 20 < np.sum(inside) < 60
    # One of them is the first draw as it was.
    assert any(np.array_equal(row, draws[0]) for row in spread)
