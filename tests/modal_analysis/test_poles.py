"""Poles of rational functions, which are known."""

import numpy as np
import scipy.optimize

from iwanjax.modal_analysis.poles import clustered, poles_by_order

POLES = 2.0 * np.pi * np.array([-0.05 + 10.0j, -0.1 + 14.0j, -0.08 + 14.4j])
F = np.arange(80, 181) / 10.0


def functions(random, inputs, window):
    """Terms of real modes at s = sigma + i omega, with nothing beside them."""
    s = window + 2j * np.pi * F
    shapes, drives = random.standard_normal((5, 3)), random.standard_normal((inputs, 3))
    poles = np.abs(POLES) ** 2
    terms = 1.0 / (s[:, None] ** 2 - 2.0 * POLES.real * s[:, None] + poles)
    return s, np.einsum("sr,fr,ir->fsi", shapes, terms, drives)


def test_exact_functions_give_exact_poles():
    for inputs, window in ((1, 0.0), (3, 0.0), (2, 1.5)):
        s, H = functions(np.random.default_rng(inputs), inputs, window)
        weight = 1.0 / np.sqrt(np.mean(np.abs(H) ** 2, axis=2))
        found = poles_by_order(s, H, weight, range(4, 25, 2))
        modes, chart = clustered(found, range(4, 25, 2), (8.0, 18.0), 4, window)
        near = [np.min(np.abs(modes - pole)) for pole in POLES]
        assert max(near) < 1e-3 * np.abs(POLES.real).min()
        assert chart.mode.max() == len(modes) - 1


def test_two_close_modes_stay_two_and_noise_is_none():
    random = np.random.default_rng(5)
    s, H = functions(random, 2, 0.0)
    noise = 1e-3 * np.max(np.abs(H)) * (random.standard_normal((2, *H.shape)).view())
    H = H + noise[0] + 1j * noise[1]
    found = poles_by_order(s, H, np.ones(H.shape[:2]), range(4, 31, 2))
    modes, _ = clustered(found, range(4, 31, 2), (8.0, 18.0), 5)
    cost = np.abs(modes[:, None] - POLES)
    rows, columns = scipy.optimize.linear_sum_assignment(cost)
    assert len(modes) == len(POLES)
    assert np.all(cost[rows, columns] < 0.1 * np.abs(POLES.real[columns]))
