"""Bristles of the general law: Dahl's friction, and such that weakens with the rate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import nnls

import iwanjax as ij
from iwanjax.joints import UnnamedLaw
from iwanjax.joints.unnamed_terms import BRISTLES, FADING, PARTS, TERMS

D, V, T = 2e-3, 0.4, 0.05
OMEGA = 2 * np.pi / T
OWN = PARTS["bristles"]


def bristles(*which: int) -> UnnamedLaw:
    """Of strength 1 each."""
    strengths = np.zeros(len(TERMS))
    strengths[OWN.start + np.array(which)] = 1.0
    return UnnamedLaw(strengths, D, V, T)


def shares(which, rate, t):
    """By the law's differential equation along a history of rates."""
    phi, a = D * BRISTLES[which], FADING[which] / V

    def grown(t, w):
        v = rate(t)
        return (v - 3.0 * abs(v) * w / (1.0 + 2.0 * np.exp(-((a * v) ** 2)))) / phi

    return solve_ivp(grown, (t[0], t[-1]), [0.0], t_eval=t, rtol=1e-10, atol=1e-12).y[0]


@pytest.mark.parametrize("which", [0, 6, 13, 20, 30, 45])
def test_they_follow_their_equation(which):
    t = np.linspace(0.0, 2.0 * T, 4001)
    path = 0.5 * D * (1.0 - np.cos(OMEGA * t))
    found = ij.hysteresis(bristles(which), path, dt=float(t[1]))
    expected = shares(which, lambda t: 0.5 * D * OMEGA * np.sin(OMEGA * t), t)
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_a_slow_cycle_is_dahls():
    law, d, phi = bristles(4), 0.6 * D, D * BRISTLES[4]
    virgin = 1.0 - np.exp(-d / phi)
    assert float(law.backbone(d)) == pytest.approx(virgin, rel=1e-12)
    assert float(law.loading(d, d)) == pytest.approx(np.tanh(d / phi), rel=1e-12)
    assert float(law.loading(-d, d)) == pytest.approx(-np.tanh(d / phi), rel=1e-12)
    area = 2.0 * quad(lambda x: float(law.loading(x, d)), -d, d)[0]
    assert float(law.dissipation(d)) == pytest.approx(area, rel=1e-6)
    assert area == pytest.approx(4.0 * (d - phi * np.tanh(d / phi)), rel=1e-6)


def test_fading_ones_lose_less_the_faster():
    law, d, which = bristles(30), 0.4 * D, 30
    w = 2.0 * OMEGA
    t = np.linspace(0.0, 3.0 * np.pi, 20001) / w
    share = shares(which, lambda t: d * w * np.cos(w * t), t)
    cycle = t >= np.pi / w
    lost = np.trapezoid((share * d * w * np.cos(w * t))[cycle], t[cycle])
    assert float(law.dissipation(d, omega=w)) == pytest.approx(lost, rel=2e-3)
    slow = 4.0 * (d - D * BRISTLES[which] * np.tanh(d / (D * BRISTLES[which])))
    assert float(law.dissipation(d, omega=1e-3 * w)) == pytest.approx(slow, rel=1e-3)
    assert lost < 0.65 * slow


@pytest.mark.parametrize("reach", [0.3, 1.0, 2.5])
def test_the_tip_stiffness_is_that_of_a_slow_decay(reach):
    """Work of a branch of the length 2d, of turns that come closer by delta each time."""
    phi = D * BRISTLES[2]
    d, shrunk = reach * phi, 1e-4 * phi
    lengths = 2.0 * d + 2.0 * shrunk * np.arange(400, -1, -1)
    share = np.tanh(0.5 * lengths[0] / phi)
    for length in lengths[:-1]:
        share = 1.0 - (1.0 + share) * np.exp(-length / phi)
    work = 2.0 * d - (1.0 + share) * phi * (1.0 - np.exp(-2.0 * d / phi))
    steady = 2.0 * (d - phi * np.tanh(d / phi))
    expected = (steady - work) / (d * shrunk)
    assert float(bristles(2).tip_stiffness(d)) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(
    "at", [0.1, *(pytest.param(v, marks=pytest.mark.long) for v in (0.03, 0.3))]
)
def test_with_them_friction_that_weakens_with_the_rate_is_no_stranger(at):
    """Canudas de Wit's law along three decays of two modes, by least squares over all terms."""
    t = np.linspace(0.0, 1.0, 3001)
    dt, kinetic, static = float(t[1]), 0.08, 0.12
    blank = UnnamedLaw.blank(D, V, T)
    units = jax.jit(
        jax.vmap(lambda s, d: ij.hysteresis(blank.with_strengths(s), d, dt=dt), (0, None))
    )
    columns, forces = [], []
    for size in (1.0, 0.5, 0.2):
        decay = np.exp(-1.5 * t)
        d = size * D * decay * (0.7 * np.sin(OMEGA * t) + 0.3 * np.sin(2.7 * OMEGA * t))
        v, w, force = np.gradient(d, dt), 0.0, np.zeros(t.size)
        for i, moved in enumerate(np.diff(d)):
            mean = 0.5 * (v[i] + v[i + 1])
            end = np.sign(moved) * (kinetic + (static - kinetic) * np.exp(-((mean / at / V) ** 2)))
            w = end + (w - end) * np.exp(-abs(moved) / (D * abs(end)))
            force[i + 1] = w
        forces.append(force)
        columns.append(np.asarray(units(jnp.eye(len(TERMS)), jnp.asarray(d))).T)
    force, columns = np.concatenate(forces), np.concatenate(columns)
    spring = columns[:, PARTS["spring"]]
    every = np.hstack([spring, -spring, columns[:, PARTS["damper"].start :]])
    assert every.shape[1] == len(TERMS) + spring.shape[1]

    def left(columns):
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        return nnls(columns / scale, force, maxiter=100_000)[1] / np.linalg.norm(force)

    without = left(every[:, : -(OWN.stop - OWN.start)])
    assert left(every) < min(0.012, 0.2 * without)
