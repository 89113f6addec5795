"""Frequency and damping from response control: simulated measurements with known answers."""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.signals import resonance_from_control

MASS, ZETA = 0.7, 0.004
BAND = np.linspace(0.985, 1.012, 15)


def measured(level, derivatives, *, exponent=0.0, omega_1=600.0, friction=False):
    """Columns of a mode whose stiffness is m omega_1^2 |U|^exponent, (levels, 15) each."""
    level = np.asarray(level)[:, None]
    # From omega^2 = omega_1^2 (level/omega^p)^s.
    power = exponent / (2.0 + derivatives * exponent)
    resonance = omega_1 ** (2.0 / (2.0 + derivatives * exponent)) * level**power
    omega = BAND * resonance
    u = level / omega**derivatives
    k = MASS * omega_1**2 * u**exponent
    loss = 2.0 * ZETA * k * (1.0 if friction else omega / resonance)
    Z = k - MASS * omega**2 + 1j * loss
    phase = 0.5 * np.pi * derivatives - np.angle(Z)
    columns = {"level": level, "frequency": omega / (2 * np.pi), "force": u * np.abs(Z)}
    return columns | {"response": level, "phase": phase}, resonance[:, 0] / (2 * np.pi)


@pytest.mark.parametrize(
    ("quantity", "derivatives"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)]
)
def test_linear_modes_are_recovered_to_rounding(quantity, derivatives):
    columns, frequency = measured([3.0, 1.0, 2.0], derivatives)
    curves = resonance_from_control(**columns, quantity=quantity, unit="m", name="mode 1")
    assert (curves.quantity, curves.unit, curves.name) == (quantity, "m", "mode 1")
    np.testing.assert_allclose(curves.amplitude, [1.0, 2.0, 3.0], rtol=1e-14)
    np.testing.assert_allclose(curves.frequency, frequency[[1, 2, 0]], rtol=1e-12)
    np.testing.assert_allclose(curves.damping, ZETA, rtol=1e-9)


def test_stiffness_that_varies_over_a_sweep_does_not_pass_for_mass():
    exponent = -0.08
    columns, frequency = measured([1.0, 2.0, 4.0], 2, exponent=exponent, friction=True)
    curves = resonance_from_control(**columns)
    np.testing.assert_allclose(curves.frequency, frequency, rtol=1e-8)
    np.testing.assert_allclose(curves.damping, ZETA, rtol=1e-3)
    one = {key: np.broadcast_to(value, (3, 15))[1] for key, value in columns.items()}
    alone = resonance_from_control(**one)
    np.testing.assert_allclose(alone.frequency, frequency[1], rtol=1e-5)
    np.testing.assert_allclose(alone.damping, ZETA / (1.0 + exponent), rtol=2e-3)


def test_standard_deviations_are_those_of_repeated_measurements():
    columns, frequency = measured([1.0], 0)
    rng = np.random.default_rng(4)
    Z = columns["force"] * np.exp(-1j * columns["phase"])
    found = []
    for _ in range(400):
        noisy = Z + 20.0 * (rng.standard_normal(Z.shape) + 1j * rng.standard_normal(Z.shape))
        changed = {"force": np.abs(noisy), "phase": -np.angle(noisy)}
        found.append(resonance_from_control(**columns | changed, quantity="displacement"))
    for name, truth in (("frequency", frequency[0]), ("damping", ZETA)):
        values = np.array([getattr(each, name)[0] for each in found])
        claimed = np.array([getattr(each, f"{name}_std")[0] for each in found])
        scatter = np.std(values)
        assert abs(np.mean(values) - truth) < 4.0 * scatter / np.sqrt(400)
        # 400 repetitions tell a deviation to 3.5 %, one in sixteen thousand misses it by four.
        assert np.sqrt(np.mean(claimed**2)) == pytest.approx(scatter, rel=0.14)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quantity": "jerk"}, "quantity = 'jerk'"),
        ({"force": 0.0}, "force holds 0; expected positive"),
        ({"phase": np.zeros(4)}, r"do not broadcast: level \(2, 1\)"),
        ({"frequency": np.array([90.0, 91.0, 92.0] * 5)}, "level 1 has 3 different frequencies"),
        ({"level": np.arange(2)[:, None], "response": 1.0}, "level 0 and level 1 differ by less"),
        ({"response": np.nan}, "response holds 1 NaN"),
    ],
)
def test_bad_arguments(change, message):
    columns, _ = measured([1.0, 2.0], 2)
    with pytest.raises(ij.InputError, match=message):
        resonance_from_control(**columns | change)


def test_a_phase_of_the_wrong_sign_and_a_resonance_outside_are_named():
    columns, _ = measured([1.0], 2)
    with pytest.raises(ij.InputError, match="phase must be that of the response"):
        resonance_from_control(**columns | {"phase": columns["phase"] + np.pi})
    below = {key: np.broadcast_to(value, (1, 15))[:, :5] for key, value in columns.items()}
    with pytest.raises(ij.InputError, match=r"level 1: the resonance, at 95\.\S+ Hz, lies"):
        resonance_from_control(**below)
