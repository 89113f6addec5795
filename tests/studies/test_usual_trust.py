"""Where a study does not say how exact its linear model is: damping open, frequencies on demand."""

import math
from dataclasses import dataclass, field

import pytest

from iwanjax.discrepancy.findings import Errors
from iwanjax.identification.predictor import HeavyDampingError
from iwanjax.studies.usual_trust import DAMPING_OPEN, USUAL, by_usual_trust, unexplained

FLOOR = Errors(0.01, 0.01)


@dataclass(frozen=True)
class Verdict:
    """What of a diagnosis is looked at."""

    after: Errors
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    noise_floor: Errors = FLOOR
    noise_floor_95: Errors = FLOOR


@dataclass
class Asked:
    """Diagnoses by trust, and what was asked for."""

    by_trust: dict
    budgets: list = field(default_factory=list)
    said: list = field(default_factory=list)

    def __call__(self, budget=math.inf):
        def diagnose(trust, seconds):
            self.budgets.append(seconds)
            if trust not in self.by_trust:
                raise HeavyDampingError("trust: a mode is damped too heavily")
            return self.by_trust[trust]

        return by_usual_trust(diagnose, budget, self.said.append)


GOOD, BAD, WORSE = Verdict(Errors(0.0105, 0.011)), Verdict(Errors(0.1, 0.2)), Verdict(Errors(1, 2))


def test_what_noise_explains_needs_no_errors_of_frequencies():
    asked = Asked({DAMPING_OPEN: GOOD})
    assert asked() is GOOD
    assert asked.budgets == [math.inf]


def test_frequencies_are_fitted_where_they_leave_more_than_noise():
    asked = Asked({DAMPING_OPEN: BAD, USUAL: GOOD})
    found = asked()
    assert found.after == GOOD.after
    assert "0.5%" in found.warnings[0]
    assert "trust" in found.warnings[0]
    assert len(asked.said) == 1


def test_freedom_that_does_not_help_is_not_taken():
    assert Asked({DAMPING_OPEN: BAD, USUAL: WORSE})().after == BAD.after
    assert not Asked({DAMPING_OPEN: BAD, USUAL: BAD})().warnings


def test_a_spent_budget_ends_with_the_first():
    asked = Asked({DAMPING_OPEN: BAD})
    assert asked(0.0) is BAD


def test_a_mode_whose_damping_cannot_be_fitted_makes_the_model_exact():
    assert Asked({None: BAD})() is BAD


@pytest.mark.parametrize(
    ("after", "large"),
    [
        (Errors(0.0125, math.nan), 1.0),
        (Errors(0.0125, 0.03), 2.0),
        (Errors(math.inf, 0.01), math.inf),
        (Errors(math.nan, math.nan), math.inf),
    ],
)
def test_errors_over_what_is_worth_a_word(after, large):
    """1.25 floors of what is fitted, 1.5 of what is held out."""
    assert unexplained(Verdict(after)) == pytest.approx(large)
