"""Priors that count as measurements do, against closed forms and curves that hold nothing."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import iwanjax as ij
from iwanjax.estimation import Parameter
from iwanjax.estimation.least_squares import least_squares
from iwanjax.estimation.parameters import Chart
from iwanjax.estimation.priors import LogNormal, LogUniform, Normal, Uniform
from iwanjax.estimation.problem import AbstractLeastSquares
from iwanjax.updating import fit
from iwanjax.updating.most_probable import MostProbable


class Linear(AbstractLeastSquares):
    """Residuals A v - y, where v are values or their logarithms."""

    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    A: Array
    y: Array

    def residuals(self, theta):
        logs = [
            jnp.log(t) if kind == "log" else t
            for t, kind in zip(theta, self.chart.transforms, strict=True)
        ]
        return self.A @ jnp.stack(logs) - self.y


def test_the_minimum_is_that_of_data_and_priors_together():
    """Linear in the parameter and in the other's logarithm: normal equations."""
    random = np.random.default_rng(0)
    A, y = random.standard_normal((7, 2)), random.standard_normal(7)
    row = (
        Parameter("a", 1.0, Normal(0.7, 0.3)),
        Parameter("b", 1.0, LogNormal(2.0, 0.5), lower=0.0, transform="log"),
    )
    asked = MostProbable.of(Linear(Chart(row), ("a", "b"), jnp.asarray(A), jnp.asarray(y)), row)
    (found,) = least_squares(asked, jnp.asarray([[1.0, 1.0]]), 1)
    middle, weight = np.array([0.7, np.log(2.0)]), np.array([0.3, 0.5]) ** -2.0
    expected = np.linalg.solve(A.T @ A + np.diag(weight), A.T @ y + weight * middle)
    np.testing.assert_allclose([found.values[0], np.log(found.values[1])], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("prior", "value", "score"),
    [
        (Normal(2.0, 0.5), 3.0, 2.0),
        (LogNormal(2.0, 0.5), 2.0 * np.exp(-1.0), -2.0),
        (Uniform(0.0, 4.0), 3.0, 0.0),
        (LogUniform(1.0, 4.0), 3.0, 0.0),
    ],
)
def test_scores_are_in_deviations_from_the_middle(prior, value, score):
    assert float(prior.score(jnp.asarray(value))) == pytest.approx(score)


ZETA_0, K_T, KNOWN = 1e-4, 1.0, 0.1


@pytest.fixture(scope="module")
def curves():
    """Mode 1 of the three masses deep in microslip, which R and chi rule."""
    chain = ij.three_mass(zeta=ZETA_0)
    found = ij.qsma(chain, [1], np.geomspace(0.02, 0.4, 20)[None], np.array([ZETA_0]))
    q, f, zeta = (
        np.asarray(getattr(found.curves, n))[0] for n in ("amplitude", "frequency", "damping")
    )
    random = np.random.default_rng(0)
    f_std, zeta_std = 1e-5 * f, 0.01 * zeta
    return ij.ModalCurves(
        q,
        f + f_std * random.standard_normal(20),
        zeta + zeta_std * random.standard_normal(20),
        frequency_std=f_std,
        damping_std=zeta_std,
        quantity="modal displacement",
    )


def test_a_stiffness_that_is_known_from_elsewhere_stays_what_it_is_known_as(curves):
    """These curves do not hold K_T."""
    guess = ij.three_mass(zeta=ZETA_0).with_joints(
        {"J1": ij.Iwan4(F_S=8.0, K_T=1.3, chi=-0.3, beta=3.0)}
    )
    known = ij.structural_parameters(guess)["J1.K_T"]
    believed = {"J1.K_T": replace(known, prior=LogNormal(1.05 * K_T, KNOWN))}
    found = fit(guess, curves, believed, modes=[1], starts=2, most_probable=True)
    assert found.most_probable
    assert "what is believed of the parameters counts" in found.summary()
    assert "(mostly what was believed)" in found.summary()
    assert found.values["J1.K_T"] == pytest.approx(1.05 * K_T, rel=0.5 * KNOWN)
    assert found.std["J1.K_T"] == pytest.approx(KNOWN * found.values["J1.K_T"], rel=0.2)
    assert found.misfit < 1.5
    for name, true in {"chi": -0.5, "K_T": K_T}.items():
        assert abs(found.values[f"J1.{name}"] - true) < 2.5 * found.std[f"J1.{name}"]
