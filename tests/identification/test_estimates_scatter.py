"""Stated deviations of parameters against the scatter of estimates over draws of the noise."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from linear_pair import JOINT, ROWS, C, measured_force, problem, simulated

from iwanjax.discrepancy.histories.refitted import joints_refitted
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification import hypotheses
from iwanjax.identification.estimates import determined, estimates
from iwanjax.identification.likelihood import covariance
from iwanjax.identification.multistart import HypothesisFit, multistart
from iwanjax.identification.problem import HistoryProblem

DRAWS, HITS, NOISE, DAMPING = 30, ((60.0, 0), (25.0, 1)), np.array([0.3, 0.2]), 0.3


class Fit(NamedTuple):
    problem: HistoryProblem
    fitted: HypothesisFit


@pytest.fixture(scope="module")
def fits() -> list[Fit]:
    """A damper between ground and the second mass, fitted to its own recordings."""
    random = np.random.default_rng(21)
    more = DAMPING * np.outer(ROWS["m2"], ROWS["m2"])
    clean = [simulated(peak, struck=struck, damping=C + more) for peak, struck in HITS]
    forces = [measured_force(peak, struck) for peak, struck in HITS]
    (kind,) = CATALOGUE["viscous_damping"]
    assert isinstance(kind, ForceKind)
    found = []
    for _ in range(DRAWS):
        seen = [y + NOISE * random.standard_normal(y.shape) for y in clean]
        made, places = problem(seen, forces, NOISE, names=("viscous_damping",))
        row = next(place.row for place in places if place.label == "m2")
        start = hypotheses.force(made, kind, "m2", row, np.zeros(1), 0.1, 1.0)
        found.append(Fit(made, multistart(made, [start], math.inf, 12, tolerance=1e-9)[0]))
    return found


def scatter(values: np.ndarray, stds: np.ndarray, true: float) -> float:
    """Root mean square of what estimates are off by, in stated deviations; known to 13 %."""
    z = (values - true) / stds
    assert abs(np.mean(z)) < 3.0 * np.std(z) / math.sqrt(DRAWS)
    return math.sqrt(np.mean(z**2))


@pytest.mark.long
def test_deviations_by_noise_alone_are_the_scatter(fits):
    """A little wider: the correlation of residuals in the band is rounded up, by a tenth."""
    stds = np.array([np.sqrt(np.diag(covariance(*each, False))[:2]) for each in fits])
    found = np.array([estimates(*each, 0)[0].value for each in fits])
    assert all(each.fitted.hypothesis.sizes == (True,) for each in fits)
    scale = fits[0].fitted.hypothesis.scales[0]
    assert 0.65 < scatter(found, scale * stds[:, 1], DAMPING) < 1.2
    # The joint's stiffness: a deviation of its logarithm's prior is 0.1.
    stiffness = np.array([JOINT * math.exp(0.1 * each.fitted.theta[0, 0]) for each in fits])
    assert 0.65 < scatter(stiffness, JOINT * 0.1 * stds[:, 0], JOINT) < 1.2
    # From draw to draw they are the same.
    assert np.all(np.std(stds, axis=0) < 0.1 * np.mean(stds, axis=0))


@pytest.mark.long
def test_stated_deviations_are_no_narrower(fits):
    """They allow for an error of the model's own, of which noise alone may look like some."""
    of_size = np.array([estimates(*each, 0)[0][1:] for each in fits])
    joints = [joints_refitted(*each, ["J1"]) for each in fits]
    of_joint = np.array([joint.parameters[0][1:] for (joint,) in joints])
    assert {joint.name for (joint,) in joints} == {"J1"}
    for found, true in ((of_size, DAMPING), (of_joint, JOINT)):
        assert scatter(found[:, 0], found[:, 1], true) < 1.0
    assert all(determined(*each) for each in fits)
