"""Where a general law is tried: at likely places, then at others until it explains something."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from iwanjax.discrepancy.histories import general_law as module
from iwanjax.joints import PlaceMotion
from iwanjax.settings.histories import HISTORIES

NOISE = 100.0


class Fit:
    """A law's fit that leaves as much as it will ever do."""

    def __init__(self, problem, place, cost):
        self.problem, self.place = problem, place
        self.fitted = SimpleNamespace(
            cost=cost, converged=True, time_constant=2.0, theta=np.zeros((1, 1))
        )
        self.law = SimpleNamespace(alone=lambda *names: None, deflection=1.0)

    def onward(self, *known):
        return self


@pytest.mark.parametrize(
    ("left", "tried", "best"),
    [
        # At once where it should be.
        ({"a": 1.0, "b": 50.0, "c": 50.0, "d": 1.0}, "ab", "a"),
        # Columns had excluded the right place.
        ({"a": 18.0, "b": 19.0, "c": 1.0, "d": 1.0}, "abc", "c"),
        # No more than three, however little they explain.
        ({"a": 18.0, "b": 19.0, "c": 20.0, "d": 1.0}, "abc", "a"),
    ],
)
def test_less_likely_places_are_tried_where_likely_ones_explain_little(
    monkeypatch, left, tried, best
):
    still = PlaceMotion(*(jnp.zeros((1, 4)) for _ in range(4)), jnp.asarray(1e-3))
    seen = []

    def fitted(problem, kind, place, starts, *known, **options):
        seen.append(place.label)
        return Fit(problem, place, NOISE * left[place.label])

    def evidences(problem, fits):
        values = np.array([-each.cost / 2.0 for each in fits])
        return SimpleNamespace(values=values, temperature=1.0, tau=1.0)

    for name, instead in {
        "left_by_noise": lambda problem: NOISE,
        "fit_unnamed_law": fitted,
        "blank_at": lambda place: None,
        "resonating": lambda *args: None,
        "squares_at": lambda *args: [0.0],
        "motion_of": lambda fit: still,
        "force_in": lambda law, motion: jnp.zeros((1, 4)),
        "scale": lambda *args: 1.0,
        "evidence": evidences,
    }.items():
        monkeypatch.setattr(module, name, instead)
    problem = SimpleNamespace(
        settings=HISTORIES, parameters=1, with_given_joints=lambda z: z, predictor=None
    )
    nominal = SimpleNamespace(theta=np.zeros((1, 1)), hypothesis=None)
    scope = SimpleNamespace(in_time=lambda: True, progress=lambda line: None, kinds=())
    a, b, c, d = (SimpleNamespace(label=label) for label in "abcd")
    found = module.general_law(problem, nominal, [], [a, b], scope, [c, d])
    assert "".join(seen) == tried
    assert found.fit.place.label == best
    assert found.probability > 0.99
