"""What sensors see of modes above the compared band, against modes that are moved and filtered."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal

import iwanjax as ij
from iwanjax.identification.conditioning import conditioned
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.linearise import innovations
from iwanjax.identification.modes_left_out import ModesLeftOut
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.recordings import StudyRecording
from iwanjax.signals.comparison_band import HALF, in_band

RATE, N, FINE = 1024.0, 1024, 256
QUANTITIES = ("displacement", "velocity", "acceleration")


def pulse(times):
    """A hit over the whole compared band that leaves nothing beyond half the sampling rate."""
    return 60.0 * np.exp(-0.5 * ((times - 0.046) * RATE / 1.5) ** 2)


def sampled(fine):
    """Through a recorder's filter, which is flat in the compared band."""
    taps = scipy.signal.firwin(64 * FINE + 1, 0.94 / FINE, window=("kaiser", 8.0))
    return scipy.signal.upfirdn(taps, fine, down=FINE, axis=0)[32:][:N]


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("substeps", [1, 3])
def test_modes_that_are_not_moved_show_what_an_integrator_finds_in_the_band(quantity, substeps):
    # A recursion of SciPy's with 256 steps a sample; modes at 0.65 and 1.7 of the sampling rate.
    omega, c = 2.0 * np.pi * RATE * np.array([0.65, 1.7]), np.array([60.0, 20.0])
    sensors, rows = np.array([[1.0, -0.4], [0.2, 0.7]]), np.array([[0.8, 0.3]])
    t = np.arange(N * FINE) / (RATE * FINE)
    over = [1.0] + [0.0] * QUANTITIES.index(quantity)
    modes = []
    for each, damping in zip(omega, c, strict=True):
        mode = over, [1.0, damping, each**2]
        (b,), a, _ = scipy.signal.cont2discrete(mode, t[1], "foh")
        modes.append(scipy.signal.lfilter(b, a, pulse(t)))
    expected = sampled((np.stack(modes, axis=1) * rows) @ sensors.T)
    ends = (np.arange(N)[:, None] * substeps + np.arange(1, substeps + 1)) / substeps - 1.0
    force = pulse(ends / RATE)[:, :, None]
    found = ModesLeftOut(omega**2, c, rows, sensors).shown(rows, force, RATE, quantity, np)
    compared = slice(HALF, -HALF)
    seen, wanted = (np.asarray(in_band(x))[compared] for x in (found, expected))
    np.testing.assert_allclose(seen, wanted, atol=1e-4 * np.max(np.abs(wanted)))


def test_slow_forces_move_them_by_their_flexibility():
    omega2 = (2.0 * np.pi * RATE * np.array([0.8, 2.0])) ** 2
    left = ModesLeftOut(omega2, np.zeros(2), np.array([[0.5, 0.7]]), np.array([[1.0, 2.0]]))
    t = np.arange(N) / RATE
    force = np.exp(-(((t - 0.5) / 0.05) ** 2))[:, None]
    found = left.driven(force, RATE, "displacement")
    static = np.sum(np.array([1.0, 2.0]) * left.flexibility * np.array([0.5, 0.7]))
    np.testing.assert_allclose(found[:, 0], static * force[:, 0], atol=1e-4 * static)


def test_a_predictor_that_leaves_modes_out_predicts_what_they_add_to_the_sensors():
    # Four masses in a row, hit at one end and jointed to the ground at the other; their highest
    # mode lies at 0.7 of the sampling rate. The reference moves all modes, 256 steps a sample. What
    # is left is of joints that yield to that mode's flexibility at once.
    M, k = np.diag([1.0, 0.9, 1.1, 0.8]), (2.0 * np.pi * RATE * 0.36) ** 2
    K = k * (2.0 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))
    K[0, 0], K[3, 3] = k, k + 1e5
    linear = ij.LinearStructure(M, 2e-5 * K, K)
    row = np.array([0.0, 0.0, 0.0, 1.0])
    joint = ij.Iwan4(F_S=400.0, K_T=4e5, chi=-0.5, beta=1.5)
    model = ij.JointedStructure(linear, {"J1": (row, joint)})
    inputs, sensors = jnp.eye(4)[:1], jnp.eye(4)[np.array([0, 3])]
    t = np.arange(N * FINE) / (RATE * FINE)
    run = ij.simulate(model, pulse(t), t[1], inputs=inputs, sensors=sensors, keep=["acceleration"])
    response, force = sampled(np.asarray(run.acceleration)), sampled(pulse(t)[:, None])
    made, modal = predictor(model, inputs, sensors, RATE, "acceleration", (), 16)
    assert made.left.number > 0
    size = np.sqrt(np.mean(response**2, axis=0))
    recording = StudyRecording("rec", response, force)
    blind = made.left._replace(sensors=jax.device_put(0.0 * np.asarray(made.left.sensors)))
    left = {}
    for name, by in (("seen", made), ("unseen", replace(made, left=blind))):
        data = conditioned([recording], by, modal, 1e-4 * size, N, 1, 6).data
        own = (Joint(joint, jnp.ones(4)),)
        problem = HistoryProblem(by, own, data, 1e-4 * size, (0,))
        theta = problem.still(problem.map.given())
        e = in_band(innovations(problem, problem.nothing(), theta, np.inf)[0])
        left[name] = np.sqrt(np.mean(np.square(e[HALF:-HALF]), axis=0)) / size
    assert np.all(left["seen"] < 0.25 * left["unseen"])
