"""Curves without noise: what the model's own error is taken for, and what comes of it."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from updating.test_fit import NAMES, TRUTH, clean, noisy

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.updating import fit
from iwanjax.updating.model_error import ModelError, with_model_error

ASKED = (1e-4, 0.02)


def silent(f_share=1e-8, zeta_share=1e-5):
    """Curves whose deviations are those of a computer; None for none."""
    q, f, zeta = clean()
    return ij.ModalCurves(
        q,
        f,
        zeta,
        frequency_std=None if f_share is None else f_share * f,
        damping_std=None if zeta_share is None else zeta_share * zeta,
        quantity="displacement",
    )


def test_curves_without_noise_are_fitted_with_the_models_own_error():
    found = fit("iwan4", silent(), starts=16)
    assert found.model_error == (2e-4, 0.015)
    (used,) = found.measured
    np.testing.assert_allclose(used.frequency_std, np.hypot(1e-8, 2e-4) * used.frequency)
    np.testing.assert_allclose(used.damping_std, np.hypot(1e-5, 0.015) * used.damping)
    # A bank of 400 sliders differs from the joint by a part in ten thousand.
    assert found.misfit < 0.05
    for name in NAMES:
        assert abs(found.values[name] - getattr(TRUTH, name)) < 0.1 * found.std[name]
    assert "0.02 % of the frequency and 1.5 % of the damping" in found.summary()


@pytest.mark.parametrize("shares", [(None, None), (1e-8, 1e-5), (1e-5, None)])
def test_an_error_that_is_asked_for_is_taken_with_the_curves_deviations(shares):
    found = fit("iwan4", silent(*shares), model_error=ASKED, starts=4)
    assert found.model_error == ASKED
    (used,) = found.measured
    own = [share or 0.0 for share in shares]
    f, zeta = (np.hypot(a, b) for a, b in zip(own, ASKED, strict=True))
    np.testing.assert_allclose(used.frequency_std, f * used.frequency)
    np.testing.assert_allclose(used.damping_std, zeta * used.damping)
    # The residuals that are told are over these.
    theta = jnp.asarray([p.value for p in found.parameters])
    difference = (np.asarray(found.predicted[0].damping) - used.damping) / used.damping_std
    np.testing.assert_allclose(found.problem.differences(theta)[1], difference, atol=1e-9)


def test_how_far_a_mode_had_been_stays_with_its_curve():
    """A joint with memory goes by it."""
    curves = replace(silent(), largest=7.0)
    (used,) = with_model_error([curves], ModelError(1e-4, 0.02))
    assert float(used.largest) == 7.0


def test_measured_curves_get_none_unless_asked():
    assert fit("iwan4", noisy(0), starts=4).model_error is None
    assert "model's own error" not in fit("iwan4", noisy(0), starts=4).summary()
    assert fit("iwan4", silent(), model_error=(0, 0), starts=4).model_error is None


@pytest.mark.parametrize("asked", [0.02, (1e-4,), (1e-4, -0.1), (1e-4, "2 %"), (1e-4, np.nan)])
def test_what_is_no_error_is_refused(asked):
    with pytest.raises(InputError, match=r"model_error = .*expected relative deviations"):
        fit("iwan4", silent(), model_error=asked)


def test_curves_without_deviations_say_what_to_give():
    with pytest.raises(InputError, match="or model_error= to fit curves without noise"):
        fit("iwan4", silent(None, None))
