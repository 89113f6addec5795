"""Variables on the real line and the values behind them."""

import math

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iwanjax.estimation.transforms import INSIDE, share_of, to_value, to_variable

Z = st.floats(-12.0, 12.0)
LOWER = st.floats(-1e3, 1e3)


@given(Z, st.floats(0.0, 1e3), st.floats(1e-3, 1e3))
def test_a_value_has_the_variable_that_it_came_from(z, lower, width):
    for transform, inside in (("log", 0.0), ("logit", 1e-9), ("identity", 0.0)):
        value = to_value(transform, z, lower, lower + width)
        back = to_variable(transform, value, lower, lower + width, inside)
        # What is near to a bound is known to the bound's own digits.
        share = math.exp(-abs(z)) if transform == "logit" else math.exp(min(z, 0.0))
        size = width if transform == "logit" else 1.0
        lost = 4e-16 * (1.0 + (abs(lower) + width) / size) / share
        assert float(back) == pytest.approx(z, abs=1e-12 + 4.0 * lost)


@given(st.floats(-700.0, 700.0), LOWER, st.floats(1e-3, 1e3))
def test_no_variable_leads_out_of_the_bounds(z, lower, width):
    assert float(to_value("log", z, lower, math.inf)) >= lower
    between = float(to_value("logit", z, lower, lower + width))
    rounded = np.finfo(float).eps * (abs(lower) + width)
    assert lower <= between <= lower + width + rounded


@pytest.mark.parametrize(("transform", "slope"), [("log", 2.0), ("logit", 3.0 * 0.24)])
def test_slopes_are_those_of_the_equations(transform, slope):
    """Of exp z at z = ln 2, and of three times the logistic function where that is 0.4."""
    z = math.log(2.0) if transform == "log" else math.log(0.4 / 0.6)
    found = jax.grad(lambda z: to_value(transform, z, 1.0, 4.0))(z)
    assert float(found) == pytest.approx(slope, rel=1e-14)


def test_a_value_on_a_bound_is_pulled_inside():
    for end, share in ((-1.0, INSIDE), (2.0, 1.0 - INSIDE)):
        z = float(to_variable("logit", end, -1.0, 2.0))
        assert z == pytest.approx(math.log(share / (1.0 - share)), rel=1e-9)
        assert float(share_of(end, -1.0, 2.0)) == pytest.approx(share, abs=1e-15)
    assert np.isfinite(float(to_variable("log", 3.0, 3.0, math.inf)))
