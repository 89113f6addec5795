"""Where a general law is tried: at likely places, then at others until it explains something."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from iwanjax.discrepancy.histories import general_law as module
from iwanjax.discrepancy.histories import restarts
from iwanjax.effects.catalogue import kinds_in_time
from iwanjax.joints import PlaceMotion
from iwanjax.joints.duhem import FIRST_BRANCH
from iwanjax.joints.unnamed_terms import TERMS
from iwanjax.settings.histories import HISTORIES

NOISE = 100.0
# Of terms with which hysteresis does much to the recordings.
HYSTERETIC = (*module.FEW, -1)


class Fit:
    """A law's fit that leaves as much as it will ever do."""

    def __init__(self, problem, place, cost):
        self.problem, self.place = problem, place
        self.fitted = SimpleNamespace(
            cost=cost, converged=True, time_constant=2.0, theta=np.zeros((1, 1))
        )
        self.law = SimpleNamespace(alone=lambda *names: None, deflection=1.0)
        self.joint = SimpleNamespace(free=module.FEW)

    def onward(self, *known, **options):
        return self

    def gains_on(self, other):
        return self.fitted.cost < other.fitted.cost


def named(kind, where):
    """A suspect as it ended, by another search than the law's."""
    kinds = {each.name: each for each in kinds_in_time()}
    hypothesis = SimpleNamespace(kinds=(kinds[kind],), where=(where,))
    return SimpleNamespace(problem=None, fitted=SimpleNamespace(hypothesis=hypothesis))


IWAN_D, SPRING_B = named("iwan_joint", "d"), named("stiffness_error", "b")
DELAY, UNKNOWN = named("sensor_delay", "a1"), named("coulomb_friction", "z")


A, B, C, D = EVERY = tuple(SimpleNamespace(label=label) for label in "abcd")


@pytest.fixture
def law(monkeypatch):
    """General laws that leave as much at each place as is told, and where they were tried."""
    still = PlaceMotion(*(jnp.zeros((1, 4)) for _ in range(4)), jnp.asarray(1e-3))
    seen = []

    def evidences(problem, fits):
        values = np.array([-each.cost / 2.0 for each in fits])
        return SimpleNamespace(values=values, temperature=1.0, tau=1.0)

    for name, instead in {
        "left_by_noise": lambda problem, memory=None: NOISE,
        "blank_at": lambda place: None,
        "resonating": lambda *args: None,
        "squares_at": lambda *args: [0.0],
        "motion_of": lambda fit: still,
        "force_in": lambda law, motion: jnp.zeros((1, 4)),
        "scale": lambda *args: 1.0,
        "evidence": evidences,
    }.items():
        monkeypatch.setattr(module, name, instead)
    monkeypatch.setattr(restarts, "blank_at", lambda place: None)
    problem = SimpleNamespace(
        settings=HISTORIES, parameters=1, begun_beside=lambda z: [z], predictor=None
    )
    nominal = SimpleNamespace(theta=np.zeros((1, 1)), hypothesis=None)

    def found(left, entries, likely, further=(), fit=Fit, in_time=lambda: True):
        scope = SimpleNamespace(in_time=in_time, progress=lambda line: None, kinds=(), places=EVERY)

        def fitted(problem, kind, place, starts, *known, **options):
            # First with few terms, then with more.
            seen.extend(set(place.label) - set(seen))
            return fit(problem, place, NOISE * left[place.label])

        for each in (module, restarts):
            monkeypatch.setattr(each, "fit_unnamed_law", fitted)
        return module.general_law(problem, nominal, entries, likely, scope, further)

    return found, seen


@pytest.mark.parametrize(
    ("left", "entries", "tried", "best"),
    [
        # At once where it should be.
        ({"a": 1.0, "b": 50.0, "c": 50.0, "d": 1.0}, [], "ab", "a"),
        # Columns had excluded the right place.
        ({"a": 18.0, "b": 19.0, "c": 1.0, "d": 1.0}, [], "abc", "c"),
        # No more than three, however little they explain.
        ({"a": 18.0, "b": 19.0, "c": 20.0, "d": 1.0}, [], "abc", "a"),
        # Where the best name is, whether likely by columns or not: only there can it refute it.
        ({"a": 18.0, "b": 19.0, "c": 20.0, "d": 1.0}, [IWAN_D, SPRING_B], "dab", "d"),
        ({"a": 18.0, "b": 19.0, "c": 20.0, "d": 1.0}, [SPRING_B], "bac", "a"),
        # A sensor's fault is no law of a motion, and has no place.
        ({"a": 1.0, "b": 50.0, "c": 50.0, "d": 1.0}, [DELAY], "ab", "a"),
        ({"a": 1.0, "b": 50.0, "c": 50.0, "d": 1.0}, [UNKNOWN], "ab", "a"),
    ],
)
def test_a_law_is_tried_where_the_best_name_is_and_where_something_acts(
    law, left, entries, tried, best
):
    general, seen = law
    found = general(left, entries, [A, B], [C, D])
    assert "".join(seen) == tried
    assert found.fit.place.label == best
    assert found.probability > 0.99
    assert found.tried == set(tried)


@pytest.mark.parametrize(
    ("ends", "gone_on_with", "best"),
    [
        # What it lacked were a few steps more.
        ({"a": (1.3, 1.1), "b": (1.0, 1.0), "c": (1.0, 1.0)}, "a", "a"),
        # It explains no more, and the next one all.
        ({"a": (1.39, 1.39), "b": (1.1, 1.1), "c": (1.0, 1.0)}, "ab", "b"),
        # None does.
        ({"a": (1.38, 1.38), "b": (1.4, 1.4), "c": (1.3, 1.3)}, "abc", "c"),
        # What an observer corrects away with a short memory it does not with a longer one.
        ({"a": (1.38, 1.5), "b": (1.25, 1.9), "c": (1.4, 1.6)}, "abc", "a"),
    ],
)
def test_the_next_place_is_gone_on_with_where_the_first_one_explains_too_little(
    law, ends, gone_on_with, best
):
    """After a few steps the law at a leaves 1.4 times the noise, and more at the others."""
    general, _ = law
    gone = []

    class Begun(Fit):
        def onward(self, memories, *known, **options):
            gone.append(self.place.label)
            longer = memories[0] != module.SHORT_TIME_CONSTANT
            return Begun(self.problem, self.place, NOISE * ends[self.place.label][longer])

    found = general({"a": 1.40, "b": 1.41, "c": 1.42}, [], [A, B, C], fit=Begun)
    assert "".join(dict.fromkeys(gone)) == gone_on_with
    assert found.fit.place.label == best


def test_what_is_linear_where_it_explains_most_is_looked_for_everywhere(law):
    """Where it is tried by all terms names are refuted; elsewhere they are not."""
    general, seen = law

    class Linear(Fit):
        def __init__(self, *known):
            super().__init__(*known)
            self.joint = SimpleNamespace(free=module.LINEAR)

    left = {"a": 1.02, "b": 1.9, "c": 1.3, "d": 1.0}
    found = general(left, [], [A, B], [C, D], fit=Linear)
    assert "".join(seen) == "abcd"
    assert found.fit.place.label == "d"
    assert found.tried == {"a", "b"}
    # Twice their likelihood is e for two squares.
    assert found.probability == pytest.approx(1.0 / (1.0 + np.exp(-1.0)))


def test_a_place_that_there_was_no_time_for_is_as_likely_as_one_that_was_tried(law):
    general, seen = law
    left = {"a": 1.0, "b": 1.0, "c": 1.0, "d": 1.0}
    found = general(left, [], [A, B, C], in_time=lambda: not seen)
    assert found.tried == {"a"}
    assert found.probability == pytest.approx(1.0 / 3.0)


def test_of_two_laws_the_better_one_is_of_all_the_places_that_were_tried(law):
    general, _ = law
    left = {"a": 1.0, "b": 1.0, "c": 9.0, "d": 0.0}
    first, second = (general(left, [], each) for each in ([A, B], [C, D]))
    assert (first.probability, second.probability) == (pytest.approx(0.5), pytest.approx(1.0))
    for found in (first.or_rather(second), second.or_rather(first)):
        assert found.fit.place is D
        assert found.probability == pytest.approx(1.0)
        assert found.tried == set("abcd")
    last = first.or_rather(general(left, [], [C]))
    assert last.fit.place.label in "ab"
    assert last.probability == pytest.approx(0.5)
    assert last.tried == set("abc")


@pytest.mark.parametrize(
    ("free", "still_left", "yielding", "way"),
    [
        # Joints that are bent leave less with a short memory, those given with a long one.
        (module.LINEAR, 9.0, 1.1, "given"),
        # What is linear explains all, for as long as the observer remembers.
        (module.LINEAR, 1.0, 0.9, "as it is"),
        # Hysteresis took part, and did nothing.
        (module.FEW, 9.0, 1.1, "as it is"),
        # It did much: the curve, of fewer parameters, explains all; or does not.
        (HYSTERETIC, 0.9, 1.0, "given"),
        (HYSTERETIC, 1.0, 1.1, "as it is"),
    ],
)
@pytest.mark.usefixtures("law")
def test_a_curve_is_tried_from_bent_joints_and_from_those_given(
    monkeypatch, free, still_left, yielding, way
):
    class Way(Fit):
        def __init__(self, problem, name, short, long):
            super().__init__(problem, SimpleNamespace(label=name), NOISE * short)
            self.long = long
            self.joint = SimpleNamespace(free=free)
            self.law = SimpleNamespace(
                alone=lambda *names: None,
                deflection=1.0,
                strengths=tuple(np.zeros(len(TERMS))),
                with_strengths=lambda strengths: SimpleNamespace(with_branch=lambda shape: None),
            )

        def onward(self, *known, **options):
            if known[0][0] == module.SHORT_TIME_CONSTANT:
                return self
            return Way(self.problem, self.place.label, self.long, self.long)

        def gains_on(self, other):
            return free != module.LINEAR

    def fitted(problem, kind, place, starts, *known):
        if known[-1] != module.DUHEM:
            return Way(problem, "as it is", 1.4, still_left)
        bent = float(starts[0].z[0]) == 0.0
        return Way(problem, *(("bent", 1.1, 5.0) if bent else ("given", 1.2, yielding)))

    if free == HYSTERETIC:
        monkeypatch.setattr(module, "squares_at", lambda *args: [100.0 * NOISE])
        monkeypatch.setattr(module, "force_in", lambda law, motion: jnp.ones((1, 4)))
    for each in (module, restarts):
        monkeypatch.setattr(each, "fit_unnamed_law", fitted)
    monkeypatch.setattr(module, "nearest_branch", lambda *motion: (1.0, FIRST_BRANCH))
    problem = SimpleNamespace(
        settings=HISTORIES, parameters=1, begun_beside=lambda z: [z, z + 1.0], predictor=None
    )
    nominal = SimpleNamespace(theta=np.zeros((1, 1)), hypothesis=None)
    scope = SimpleNamespace(in_time=lambda: True, progress=lambda line: None, kinds=(), places=())
    found = module.general_law(problem, nominal, [], [A], scope)
    assert found.fit.place.label == way
