"""How far a linear model is trusted, mode by mode."""

import numpy as np

from iwanjax.structures import LinearTrust

OMEGA2 = np.array([0.0, 1.0, 4.0, 9.0])


def test_one_number_is_for_all_elastic_modes():
    found = LinearTrust(0.01, 0.2).deviations(OMEGA2)
    np.testing.assert_allclose(found, [[0.0, 0.01, 0.01, 0.01], [0.0, 0.2, 0.2, 0.2]])


def test_the_last_of_a_list_is_for_all_modes_beyond_it():
    found = LinearTrust((0.01, 0.02), (0.1,)).deviations(OMEGA2)
    np.testing.assert_allclose(found, [[0.0, 0.01, 0.02, 0.02], [0.0, 0.1, 0.1, 0.1]])
