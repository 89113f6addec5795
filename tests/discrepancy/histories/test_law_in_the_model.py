"""A law without a name in a model: it stays as it is, and nothing is missing beside it."""

import math

import numpy as np
import pytest
from two_masses import DAMPING, PLACES, RATE, K, M, recorded

import iwanjax as ij
from iwanjax.discrepancy import diagnose_histories
from iwanjax.joints import UnnamedLaw
from iwanjax.joints.unnamed_terms import TERMS

STRENGTH, FASTEST = 20.0, 0.3


def quadratic_damper(d: float, v: float, moved: float) -> float:
    """As the law has it, which goes on straight beyond the fastest it was fitted to."""
    u = abs(v) / FASTEST
    return STRENGTH * math.copysign(u * u if u < 1.0 else 2.0 * u - 1.0, v)


@pytest.mark.long
def test_a_saved_law_in_the_model_explains_recordings_that_it_was_not_fitted_to(tmp_path):
    blank = UnnamedLaw.blank(1e-3, FASTEST, 0.02)
    strengths = np.zeros(len(TERMS))
    strengths[TERMS.index("quadratic damper")] = STRENGTH
    law = UnnamedLaw.load(blank.with_strengths(strengths).save(tmp_path / "law.npz"))
    linear = ij.LinearStructure(M, DAMPING, K)
    hits = [(0, 40.0, "fit"), (1, 120.0, "fit"), (0, 90.0, "hold_out")]
    found = diagnose_histories(
        ij.JointedStructure(linear, {"damper": (PLACES["m1-ground"], law)}),
        [recorded(quadratic_damper, *hit, place="m1-ground") for hit in hits],
        RATE,
        rows=PLACES,
        sensors={"a1": [1.0, 0.0], "a2": [0.0, 1.0]},
        inputs={"m1": [1.0, 0.0], "m2": [0.0, 1.0]},
        hypotheses=("viscous_damping",),
    )
    assert found.verdict.name == "nothing_missing"
    assert found.before.hold_out < 1.2 * found.noise_floor.hold_out
