"""The oscillator of Sec. 4.5 in motion: ACCEPTANCE section 3, with S = 9e4 (an erratum)."""

from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.dynamics import half_sine, ramp, sine
from iwanjax.joints import SliderBank

pytestmark = pytest.mark.reference

K_INF, Y_0 = 5e5, 1e-4
THETAS = (1.0, 0.5, 0.2)
# At the steps of the text and no shorter ones.
MOTION: dict[str, Any] = {"keep": ("displacement",), "accuracy": None}


@cache
def joint(theta):
    return ij.Iwan5.from_distribution(R=7e5, S=9e4, chi=-0.6, phi_max=6e-4, theta=theta)


@cache
def oscillator(theta):
    return ij.oscillator(stiffness=K_INF, joint=joint(theta))


def steady(theta):
    """Resonance frequency, rad/s, and force for the amplitude y_0 (4.38), (4.41)."""
    omega = float(np.sqrt(K_INF + joint(theta).secant(Y_0)))
    return omega, float(joint(theta).dissipation(Y_0)) / (np.pi * Y_0)


@pytest.mark.parametrize(
    ("theta", "omega", "force"), [(1.0, 805.365, 0.66630), (0.5, 801.457, 0.62465)]
)
def test_resonance_at_the_amplitude_of_the_text(theta, omega, force):
    assert steady(theta) == pytest.approx((omega, force), rel=1e-5)


@pytest.mark.parametrize("method", ["exact", "newmark"])
def test_peak_after_the_impact(method):
    """(4.43) at the reference step of 5e-6 s."""
    dt = 5e-6
    t = dt * np.arange(2000)
    force = half_sine(t, 100.0, 200.0 * np.pi)
    for theta, peak in zip(THETAS, (2.6756e-4, 2.7040e-4, 2.7214e-4), strict=True):
        found = ij.simulate(oscillator(theta), force, dt, method=method, **MOTION, sliders=500)
        assert np.max(np.abs(found.displacement)) == pytest.approx(peak, rel=1e-4)


class OnThesisGrid(ij.Iwan5):
    """The same element on the grid of the text: 500 midpoints, intervals growing by 1.05 (4.13)."""

    def discrete(self, sliders=None):
        sliders = 500 if sliders is None else sliders
        lengths = 1.05 ** np.arange(sliders - 1)
        b = 6e-4 * np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])
        n = -0.6 + 1.0
        phi = np.append(0.5 * (b[1:] + b[:-1]), 6e-4)
        k = np.append(7e5 / n * np.diff(b**n), 9e4)
        return SliderBank(jnp.asarray(phi), jnp.asarray(k), self.theta[..., None])


@cache
def on_thesis_grid(theta):
    values = {info.name: getattr(joint(theta), info.name) for info in ij.Iwan5.parameters}
    return ij.oscillator(stiffness=K_INF, joint=OnThesisGrid(**values))


def settled(structure, theta, force, dt, sliders=500):
    """Amplitude at the driving frequency over the last twenty periods."""
    omega, _ = steady(theta)
    found = ij.simulate(structure, force, dt, **MOTION, sliders=sliders)
    count = round(20 * 2 * np.pi / omega / dt)
    y = np.asarray(found.displacement)[-count:, 0]
    t = np.asarray(found.time)[-count:]
    basis = np.stack([np.cos(omega * t), np.sin(omega * t), np.ones(count)], axis=1)
    a, b, _ = np.linalg.lstsq(basis, y, rcond=None)[0]
    return float(np.hypot(a, b))


DT = 5e-5
T = DT * np.arange(80_000)


def forcing(theta):
    """Ring-up (4.40) and ring-down (4.42) to the same level."""
    omega, force = steady(theta)
    return sine(T, force, omega), sine(T, ramp(T, 6.0, force, 2.0), omega)


@pytest.mark.parametrize(
    ("theta", "up", "down"), [(1.0, 9.970e-5, 9.970e-5), (0.5, 9.878e-5, 7.967e-5)]
)
def test_forced_amplitude_after_ring_up_and_ring_down(theta, up, down):
    """Theta < 1 remembers how the level was reached."""
    from_rest, from_above = forcing(theta)
    assert settled(on_thesis_grid(theta), theta, from_rest, DT) == pytest.approx(up, rel=0.005)
    assert settled(on_thesis_grid(theta), theta, from_above, DT) == pytest.approx(down, rel=0.005)


class AsBank(ij.Iwan5):
    """The same element as a bank on the package's own grid."""

    def discrete(self, sliders=200):
        return self.slider_bank(sliders)


@pytest.mark.long
def test_the_steady_amplitude_does_not_depend_on_a_grid():
    """In a bank whether the slider beside the amplitude lets go decides; here there is none.

    The printed 9.878e-5 is that of the grid of the text; finer ones scatter about 9.74e-5.
    """
    found = [settled(oscillator(0.5), 0.5, forcing(0.5)[0], DT, sliders) for sliders in (100, 200)]
    assert np.ptp(found) < 1e-3 * Y_0
    values = {info.name: getattr(joint(0.5), info.name) for info in ij.Iwan5.parameters}
    bank = ij.oscillator(stiffness=K_INF, joint=AsBank(**values))
    scattered = [settled(bank, 0.5, forcing(0.5)[0], DT, sliders) for sliders in (200, 500)]
    assert np.ptp(scattered) > 0.01 * Y_0
    # The finer bank is much nearer.
    assert abs(scattered[1] - found[0]) < 0.2 * abs(scattered[0] - found[0])


@cache
def ring_down(theta):
    """Frequency and damping of the free decay at y_0, from the velocity."""
    dt = 1e-4
    t = dt * np.arange(100_001)
    force = half_sine(t, 100.0, 200.0 * np.pi)
    found = ij.simulate(oscillator(theta), force, dt, keep=("displacement", "velocity"))
    curves = ij.ringdown_curves(
        np.asarray(found.velocity)[:, 0], 1 / dt, (60.0, 200.0), start=0.005
    ).as_quantity("displacement")
    order = np.argsort(curves.amplitude)
    q, f, zeta = (
        np.asarray(x)[order] for x in (curves.amplitude, curves.frequency, curves.damping)
    )
    return np.interp(Y_0, q, f), np.interp(Y_0, q, zeta), float(np.max(np.abs(found.displacement)))


@pytest.mark.long
def test_closed_forms_beside_the_decay():
    """Mean over theta: frequency within 0.1 %, damping within 3 %."""
    off = []
    for theta in THETAS:
        f, zeta, y_max = ring_down(theta)
        omega = np.sqrt(K_INF + float(joint(theta).secant(Y_0, y_max)))
        loss = float(joint(theta).dissipation(Y_0, y_max))
        off.append(
            (omega / (2 * np.pi) / f - 1.0, loss / (2 * np.pi * (omega * Y_0) ** 2) / zeta - 1.0)
        )
    frequency, damping = np.mean(off, axis=0)
    assert abs(frequency) < 1e-3
    assert abs(damping) < 0.03
    # The secant of the thesis lies above what is measured, at every theta.
    assert all(0.0 < each[0] < 1.5e-3 for each in off)
