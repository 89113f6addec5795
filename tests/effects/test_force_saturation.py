"""Peaks that a force's channel cut, given back."""

import numpy as np
import pytest

from iwanjax.effects.force_saturation import SATURATION
from iwanjax.signals.clipping import cut_off

RATE = 1024.0
LIMIT = 2.2
t = np.arange(4096) / RATE
FORCE = 4.0 * np.sin(2.0 * np.pi * (5.0 + 5.0 * t) * t)


@pytest.mark.parametrize("offset", [-0.05, 0.0, 0.05])
def test_both_sides_are_given_back_whatever_offset_was_taken_off(offset):
    measured = np.clip(FORCE, -LIMIT, LIMIT) - offset
    acted = SATURATION.acted(measured, 1.0, cut_off(measured))
    for side in (acted, -acted):
        assert np.max(side) > 0.85 * np.max(FORCE)
    assert np.linalg.norm(acted + offset - FORCE) < 0.1 * np.linalg.norm(measured + offset - FORCE)


def test_a_side_that_was_not_cut_stays():
    measured = np.minimum(FORCE, LIMIT)
    acted = SATURATION.acted(measured, 1.0, cut_off(measured))
    assert np.array_equal(acted[measured < 0.0], measured[measured < 0.0])
    assert np.max(acted) > 0.85 * np.max(FORCE)
    assert np.array_equal(SATURATION.acted(FORCE, 1.0, cut_off(FORCE)), FORCE)
