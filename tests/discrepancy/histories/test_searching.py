"""The parts of a search: the band compared, finer forces, derivatives that are kept, probing."""

import math
from dataclasses import replace
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from struck_mass import JOINT, resolution, searching, struck

import iwanjax as ij
from iwanjax.discrepancy.histories import restarts, screening, selection
from iwanjax.discrepancy.histories.further_suspects import pointed_at, probed, sought_at
from iwanjax.discrepancy.histories.joint_faults import without_the_other
from iwanjax.discrepancy.histories.nested import with_nested_laws
from iwanjax.discrepancy.histories.ranking import STEPS, TIME_CONSTANT, RankedFit, scored, settled
from iwanjax.discrepancy.histories.selection import ModelSelection, concluded
from iwanjax.discrepancy.histories.time_steps import Refined
from iwanjax.effects.catalogue import CATALOGUE, kinds_in_time
from iwanjax.effects.kinds import ForceKind, JointKind
from iwanjax.estimation.levenberg_marquardt import Descent, Layout, SearchStart
from iwanjax.estimation.linearisation import Linearisation
from iwanjax.estimation.multistart import alike
from iwanjax.identification.conditioning import upsampled
from iwanjax.identification.hypotheses import JointStart, force, with_joint, with_stiction
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.linearise import linearise, residuals_at
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, moved, multistart
from iwanjax.identification.problem import Hypothesis, Start
from iwanjax.identification.recordings import StudyRecording, noise_of
from iwanjax.identification.suspects import Suspects
from iwanjax.settings.histories import HISTORIES
from iwanjax.signals.comparison_band import HALF, OF_NOISE, in_band

NOTHING = Hypothesis(
    (),
    (),
    Suspects(*(jnp.zeros((1, 1)) for _ in range(2)), jnp.zeros((1, 3, 1)), jnp.zeros(1)),
)


@pytest.mark.parametrize(
    ("share", "left"), [(0.0, 1.0), (0.1, 1.0), (0.25, 1.0), (0.35, 0.5), (0.45, 0.0)]
)
def test_the_band_keeps_what_a_recorder_keeps(share, left):
    t = np.arange(400)
    wave = np.cos(2 * np.pi * share * t + 0.3)[:, None]
    inside = slice(HALF, -HALF)
    found = np.asarray(in_band(jnp.asarray(wave)))[inside]
    np.testing.assert_allclose(found, left * wave[inside], atol=5e-3)


def test_the_bands_share_of_noise_is_what_it_leaves_of_it():
    white = np.random.default_rng(0).standard_normal((100_000, 1))
    left = np.std(np.asarray(in_band(jnp.asarray(white))))
    # Four standard errors of a deviation from so many values, of which some are correlated.
    assert left == pytest.approx(OF_NOISE, rel=4.0 / math.sqrt(100_000))


@given(st.integers(20, 60), st.integers(2, 9), st.floats(0.0, 0.49))
def test_between_samples_a_force_is_what_a_filter_let_through(length, times, share):
    # Whole periods: where a recording ends, nothing acts.
    frequency = math.floor(share * length) / length
    wave = lambda t: np.cos(2 * np.pi * frequency * t + 0.7)  # noqa: E731
    found = upsampled(wave(np.arange(length))[:, None], times)[:, 0]
    np.testing.assert_allclose(found, wave(np.arange(length * times) / times), atol=1e-9)


def linear(seed: int, size: int, curved: float = 0.0):
    """Residuals of some values, and their derivatives."""
    random = np.random.default_rng(seed)
    J, e_0 = random.standard_normal((size, 40)), random.standard_normal(40)
    H = curved * random.standard_normal((size, size, 40))

    def residual(x):
        return e_0 + x @ J + np.einsum("i,j,ijn->n", x, x, H)

    def seen(x):
        e = residual(x)
        D = J + np.einsum("j,ijn->in", x, H + np.swapaxes(H, 0, 1))
        shaped = e[None, :, None], D[None, :, :, None]
        return Linearisation(np.array([e @ e]), (D @ e)[None], (D @ D.T)[None], *shaped)

    return residual, seen


@given(st.integers(0, 10**6), st.integers(1, 5))
def test_derivatives_after_a_step_say_what_the_step_has_shown(seed, size):
    random = np.random.default_rng(seed)
    residual, seen = linear(seed, size, curved=0.1)
    x, move = random.standard_normal((2, size))
    after = residual(x + move)
    found = seen(x).beside(move[None], after[None, :, None])
    change = np.einsum("rv,rvns->rns", move[None], found.slopes)[0, :, 0]
    np.testing.assert_allclose(change, after - residual(x), atol=1e-9)
    flat = found.slopes[0, :, :, 0]
    np.testing.assert_allclose(found.normal[0], flat @ flat.T, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.moment[0], flat @ after, rtol=1e-9, atol=1e-9)


@given(st.integers(0, 10**6), st.integers(1, 5))
def test_derivatives_of_what_is_linear_stay_as_they_are(seed, size):
    residual, seen = linear(seed, size)
    x, move = np.random.default_rng(seed).standard_normal((2, size))
    found = seen(x).beside(move[None], residual(x + move)[None, :, None])
    np.testing.assert_allclose(found.slopes, seen(x).slopes, atol=1e-9)


def searched(seed: int, size: int, curved: float, steps: int = 60) -> tuple[Descent, int]:
    """A search by itself, and how often it asked for derivatives."""
    residual, seen = linear(seed, size, curved)
    x = np.random.default_rng(seed).standard_normal(size)
    layout = Layout(np.zeros((1, size)), np.eye(size)[None], np.full(size, 1e-3))
    lane, asked = Descent.at(SearchStart(layout, x), 40, seen(x)), 1
    for _ in range(steps):
        if lane.stale:
            lane.renewed(seen(lane.x))
            asked += 1
        x = lane.proposed()
        if x is None or not lane.active:
            break
        lane.tried(x, residual(x)[None, :, None], 1e-8)
    return lane, asked


@given(st.integers(0, 10**6), st.integers(1, 4), st.sampled_from([0.0, 0.02, 0.1]))
def test_a_search_ends_where_the_gradient_does(seed, size, curved):
    lane, _ = searched(seed, size, curved)
    assert lane.converged or lane.proposed() is None
    _, seen = linear(seed, size, curved)
    at = seen(lane.x)
    gradient = at.moment[0] + 1e-3 * lane.x
    scale = np.sqrt(np.diag(at.normal[0]) * at.misfit[0])
    assert np.all(np.abs(gradient) < 2e-2 * scale)


def test_derivatives_of_what_is_nearly_linear_are_hardly_asked_for():
    assert searched(1, 4, 0.0)[1] <= 2
    assert searched(1, 4, 1e-3)[1] <= 3


def test_a_hard_stop_is_found_by_probing():
    response = struck(lambda d: 3e6 * max(d - 3e-4, 0.0))
    problem, scope = searching(response)
    base = multistart(problem, [Start(problem.nothing(), np.zeros(6))], SHORT_TIME_CONSTANT, 0)[0]
    candidates = scored(problem, base, scope)
    found = probed(problem, [], [], candidates, scope)
    (before,) = residuals_at(problem, [(problem.nothing(), problem.still(np.zeros(6)))], 8.0)
    assert found[0].fitted.hypothesis.kinds[0].name == "gap_contact"
    assert found[0].fitted.cost < 0.02 * np.sum(before**2)


def test_what_has_come_to_the_same_end_before_is_probed_no_further():
    problem, scope = searching(struck(lambda d: 8e3 * d))
    base = multistart(problem, [Start(problem.nothing(), np.zeros(6))], SHORT_TIME_CONSTANT, 0)[0]
    candidates = scored(problem, base, scope)
    found = probed(problem, [], [], candidates, scope)
    shorts = [
        RankedFit(problem, multistart(problem, [each.fitted.start], SHORT_TIME_CONSTANT, STEPS)[0])
        for each in found[:1]
    ]
    others = probed(problem, shorts, [], candidates, scope)
    variants = [[e.fitted.hypothesis.variant for e in some] for some in (found, others)]
    assert variants[0][0] not in variants[1]
    assert set(variants[1]) <= set(variants[0])


def test_where_a_short_memory_points_is_probed_beside_where_a_longer_one_does():
    def at(*labels):
        hypotheses = [SimpleNamespace(where=(label,)) for label in labels]
        return [SimpleNamespace(fitted=SimpleNamespace(hypothesis=h)) for h in hypotheses]

    screened_at = [SimpleNamespace(start=SimpleNamespace(hypothesis=SimpleNamespace(where=("c",))))]
    assert pointed_at(at("a", "d"), at("b", "a"), screened_at) == ["b", "a", "c"]
    assert pointed_at(at("a"), at("a"), screened_at) == ["a", "c"]
    assert pointed_at([], [], screened_at) == ["c"]


def test_a_joint_goes_on_alone_from_where_it_is_beside_another():
    problem, scope = searching(struck(lambda d: 8e3 * d))
    (place,), kind = scope.places, CATALOGUE["iwan_joint"][0]
    row, z = np.asarray(place.row), np.zeros(4)
    spring = force(problem, CATALOGUE["stiffness_error"][0], "J1", row, z, 1.0, 1.0)
    guess = JointStart(8e3, 1.0, z)
    own, starts = with_joint(problem, kind, place, [guess], spring)
    pair = RankedFit(own, multistart(own, starts, SHORT_TIME_CONSTANT, 2)[0])
    assert pair.fitted.hypothesis.label == "iwan_joint@J1 + stiffness_error@J1"
    (alone,) = without_the_other([pair], scope)
    assert alone.fitted.hypothesis.label == "iwan_joint@J1"
    assert alone.problem is own
    assert alone.fitted.cost < 1.02 * pair.fitted.cost


def test_a_size_that_no_run_survives_is_begun_with_smaller():
    problem, scope = searching(struck(lambda d: 8e3 * d))
    nominal = multistart(problem, [Start(problem.nothing(), np.zeros(6))], SHORT_TIME_CONSTANT, 0)[
        0
    ]
    row, z = np.asarray(scope.places[0].row), np.zeros(4)

    def spring(size: float) -> Start:
        return force(problem, CATALOGUE["stiffness_error"][0], "J1", row, z, size, 1.0)

    def cost(start: Start) -> float:
        (seen,) = residuals_at(
            problem, [(start.hypothesis, problem.still(start.theta))], SHORT_TIME_CONSTANT
        )
        return float(np.sum(seen**2))

    edge = next(k for k in 8e3 * 2.0 ** np.arange(40) if cost(spring(k)) > 100.0 * nominal.cost)
    for size, share in ((8e3, 1.0), (2.0 * edge, 0.1), (20.0 * edge, 0.01)):
        (begun,) = screening.withstood_starts(problem, nominal, [[spring(size)]])
        assert begun.theta[4] == pytest.approx(share)
    # The best of a hypothesis's own starts; none where none is survived.
    good, far, lost = spring(8e3), spring(2.0 * edge), spring(1e3 * edge)
    (begun,) = screening.withstood_starts(problem, nominal, [[far, good], [lost]])
    assert begun.theta[4] == good.theta[4]
    assert begun.hypothesis is good.hypothesis


def test_a_joint_that_does_not_stick_beside_a_force_changes_nothing():
    joint = ij.Iwan4(F_S=12.0, K_T=3e4, chi=-0.5, beta=1.5)
    tight, scope = searching(struck(lambda d: 8e3 * d), joint)
    problem = replace(tight, joints=(Joint(joint, jnp.ones(4)),))
    row, z = np.asarray(scope.places[0].row), np.array([0.3, -0.2, 0.1, 0.0])
    spring = force(problem, CATALOGUE["stiffness_error"][0], "J1", row, z, 8e3, 1.0)
    sticking = CATALOGUE["stiction"][0]
    own, (free, stuck) = with_stiction(problem, sticking, 0, "J1", (0.9999, 0.6), z, spring)
    assert free.hypothesis.label == "stiction@J1 + stiffness_error@J1"
    (alone,) = residuals_at(
        problem, [(spring.hypothesis, problem.still(spring.theta))], SHORT_TIME_CONSTANT
    )
    none, some = residuals_at(
        own, [(s.hypothesis, own.still(s.theta)) for s in (free, stuck)], SHORT_TIME_CONSTANT
    )
    whole = np.linalg.norm(np.asarray(problem.data.weight * problem.data.response))
    off, much = (np.linalg.norm(x - alone) / whole for x in (none, some))
    # Sliders stand for the closed form of a joint that does not stick.
    assert off < 0.02
    assert much > 5.0 * off


def test_a_spring_is_found_behind_what_has_it_for_a_limit():
    problem, scope = searching(struck(lambda d: 8e3 * d))
    base = multistart(problem, [Start(problem.nothing(), np.zeros(6))], SHORT_TIME_CONSTANT, 0)[0]
    candidates = scored(problem, base, scope)
    whole = next(c for c in candidates if c.start.hypothesis.kinds[0].name == "viscoelastic")
    entries = [
        RankedFit(problem, each)
        for each in multistart(problem, [whole.start], TIME_CONSTANT, STEPS)
    ]
    found = with_nested_laws(problem, entries, scope)
    spring = next(e for e in found if e.fitted.hypothesis.kinds[0].name == "stiffness_error")
    assert spring.fitted.cost < 1.05 * found[0].fitted.cost
    assert {e.fitted.hypothesis.label for e in found} <= {
        f"{name}@J1" for name in ("stiffness_error", "viscous_damping", "viscoelastic")
    }


def test_a_limit_is_looked_for_beside_another_suspect():
    response = struck(lambda d: 8e3 * d)
    limit = 0.7 * np.max(np.abs(response))
    problem, scope = searching(np.clip(response, -limit, limit))
    scope = replace(scope, kinds=(*scope.kinds, *CATALOGUE["sensor_saturation"]))
    base = multistart(problem, [Start(problem.nothing(), np.zeros(6))], SHORT_TIME_CONSTANT, 0)[0]
    spring = next(
        c.start
        for c in scored(problem, base, scope)
        if c.start.hypothesis.kinds[0].name == "stiffness_error"
    )
    first = multistart(problem, [spring], SHORT_TIME_CONSTANT, STEPS)[0]
    found = scored(problem, first, scope)[0].start.hypothesis
    assert found.label == "stiffness_error@J1 + sensor_saturation@a1"


def test_derivatives_come_in_parts_and_are_those_of_the_residuals():
    """An odd number of values, by differences; the observer's gain changes with them too."""
    problem, scope = searching(struck(lambda d: 8e3 * d), ij.LinearSpring(k=3e4))
    base = multistart(problem, [Start(problem.nothing(), np.zeros(3))], SHORT_TIME_CONSTANT, 0)[0]
    start = next(
        c.start
        for c in scored(problem, base, scope)
        if c.start.hypothesis.kinds[0].name == "stiffness_error"
    )
    hypothesis, theta = start.hypothesis, problem.still(start.theta)
    count = theta.shape[1]
    assert count % 2 == 1
    (seen,) = linearise(problem, [(hypothesis, theta)], TIME_CONSTANT)
    step = 1e-3
    beside = [
        (hypothesis, theta + sign * step * way) for way in np.eye(count) for sign in (1.0, -1.0)
    ]
    found = residuals_at(problem, beside, TIME_CONSTANT)
    slopes = np.stack(
        [(up - down) / (2.0 * step) for up, down in zip(found[::2], found[1::2], strict=True)]
    )
    for way in range(count):
        size = np.linalg.norm(slopes[way])
        assert np.linalg.norm(seen.slopes[:, way] - slopes[way]) <= 2e-3 * size
    assert np.linalg.norm(slopes[1]) > 0.0
    flat = slopes[:, 0].reshape(count, -1)
    np.testing.assert_allclose(seen.normal[0], flat @ flat.T, rtol=1e-2, atol=1e-6)


def test_only_the_best_go_on():
    problem, scope = searching(struck(lambda d: 8e3 * d))
    base = multistart(problem, [Start(problem.nothing(), np.zeros(6))], SHORT_TIME_CONSTANT, 0)[0]
    starts = [c.start for c in scored(problem, base, scope)[:3]]
    whole = multistart(problem, starts, SHORT_TIME_CONSTANT, STEPS)
    early = multistart(problem, starts, SHORT_TIME_CONSTANT, 3)
    found = multistart(problem, starts, SHORT_TIME_CONSTANT, STEPS, at_most=1)
    leader = int(np.argmin([each.cost for each in early]))
    for i, each in enumerate(found):
        same = whole if i == leader else early
        assert each.cost == pytest.approx(same[i].cost, rel=1e-9)
    assert any(a.cost < 0.99 * b.cost for a, b in zip(whole, found, strict=True))


@pytest.mark.parametrize(("everywhere", "least", "tried"), [(False, 12.7, 2), (True, 1.0, 8)])
def test_ends_that_agree_are_taken_for_all_but_not_where_nothing_explains_the_rest(
    monkeypatch, everywhere, least, tried
):
    """In a chain of three with a soft second spring two of three starts end where the first do."""
    asked = []

    def ends(problem, starts, *_, **__):
        asked.extend(starts)
        return [SimpleNamespace(cost=1.0 if start == 5 else 12.7) for start in starts]

    monkeypatch.setattr(restarts, "multistart", ends)
    scope = SimpleNamespace(in_time=lambda: True)
    problem = SimpleNamespace(settings=HISTORIES)
    fits = restarts.scattered(problem, range(8), math.inf, scope, everywhere)  # type: ignore[arg-type]
    assert fits[0].cost == least
    assert len(asked) == tried


@pytest.mark.parametrize(
    ("left", "of_a_joint", "lost"), [(1.1, True, False), (1.5, True, True), (1.5, False, False)]
)
def test_a_fault_of_a_joint_that_leaves_something_is_tried_from_other_joints(
    monkeypatch, left, of_a_joint, lost
):
    """By its own search: it has other joints, and more values, than the one for all others."""
    tight, scope = searching(struck(lambda d: 8e3 * d))
    own, starts = with_stiction(tight, CATALOGUE["stiction"][0], 0, "J1", (0.7,), np.zeros(4))
    noise = selection.left_by_noise(tight)
    nominal = SimpleNamespace(
        hypothesis=tight.nothing(), cost=9.0 * noise, time_constant=TIME_CONSTANT
    )
    suspect = SimpleNamespace(
        hypothesis=starts[0].hypothesis,
        cost=left * noise,
        start=starts[0],
        time_constant=TIME_CONSTANT,
    )
    entry = RankedFit(own if of_a_joint else tight, suspect)
    assert selection.restart_wanted(tight, nominal, [entry]) == lost
    asked = []

    def ends(problem, starts, *_, **__):
        asked.append((problem, {start.theta.shape for start in starts}))
        return [
            SimpleNamespace(
                hypothesis=start.hypothesis, cost=noise, residual=np.ones(1), start=start
            )
            for start in starts
        ]

    monkeypatch.setattr(restarts, "multistart", ends)
    if lost:
        (found,) = restarts.restarted(tight, nominal, [entry], scope, 0, everywhere=True)
        assert found.problem is own
        assert found.fitted.cost == noise
        assert all(problem is own and shapes == {(7,)} for problem, shapes in asked)


def test_searches_that_have_come_to_the_same_go_on_as_one():
    problem, scope = searching(struck(lambda d: 8e3 * d))
    (place,), (spring,) = scope.places, CATALOGUE["stiffness_error"]
    assert isinstance(spring, ForceKind)

    def start(size: float) -> Start:
        return force(problem, spring, place.label, place.row, np.zeros(4), size, shape=1.0)

    nothing = Start(problem.nothing(), np.zeros(6))
    found = multistart(problem, [start(7e3), start(9e3), nothing], SHORT_TIME_CONSTANT, STEPS)
    assert sorted(each.converged for each in found[:2]) == [False, True]
    assert alike(found[0].residual, found[1].residual)
    assert found[2].converged
    assert not alike(found[2].residual, found[0].residual)


def test_a_search_that_was_cut_short_is_taken_to_its_end():
    problem, scope = searching(struck(lambda d: 8e3 * d))
    (place,), (spring,) = scope.places, CATALOGUE["stiffness_error"]
    assert isinstance(spring, ForceKind)
    start = force(problem, spring, place.label, place.row, np.zeros(4), 1e3, shape=1.0)
    begun = multistart(problem, [start], TIME_CONSTANT, 1)[0]
    assert not begun.converged
    ended = settled(problem, begun, scope)
    assert ended.converged
    assert ended.cost < 0.5 * begun.cost
    assert settled(problem, ended, scope) is ended
    assert settled(problem, begun, replace(scope, in_time=lambda: False)) is begun


@pytest.mark.long
def test_a_stiff_suspect_wants_finer_steps_and_a_soft_one_does_not():
    response = struck(lambda d: 3e6 * max(d - 3e-4, 0.0))
    taken = resolution(response)
    now = taken.of_model()
    (place,) = searching(response)[1].places
    stop = CATALOGUE["gap_contact"][1]
    assert isinstance(stop, ForceKind)
    assert stop.variant == "where d > 0"

    def ending(at: Refined, stiffness: float) -> RankedFit:
        size = (at.problem, stop, place.label, place.row, np.zeros(4), stiffness)
        return RankedFit(
            at.problem, multistart(at.problem, [force(*size, shape=3e-4)], TIME_CONSTANT, 0)[0]
        )

    stiff = ending(now, 3e6)
    finer = taken.of_fit(now, stiff)
    assert finer.problem.predictor.substeps > now.problem.predictor.substeps
    assert ending(finer, 3e6).fitted.cost < 0.5 * stiff.fitted.cost
    assert taken.of_fit(now, ending(now, 3e3)) is now
    assert taken.of_fit(finer, ending(finer, 3e6)) is finer


def test_noise_is_told_of_as_few_samples_as_may_be_diagnosed():
    waves = 0.3 * np.random.default_rng(0).standard_normal((200, 36, 1))
    found = [noise_of(StudyRecording("decay", wave, None)).deviation[0] for wave in waves]
    assert np.median(found) == pytest.approx(0.3, rel=0.1)


@pytest.mark.long
def test_a_fast_mode_wants_finer_steps_for_its_free_run_only():
    response = struck(lambda d: 0.0)
    # So seldom measured that the mode turns by more than a radian from sample to sample. What two
    # steps may leave lies between the 0.3 deviations that are allowed in the end, and 0.4 at first.
    taken = resolution(response, replace(JOINT, F_S=1.7e5), every=6)
    now = taken.of_model()
    nothing = Start(now.problem.nothing(), np.zeros(6))
    given = RankedFit(now.problem, multistart(now.problem, [nothing], TIME_CONSTANT, 0)[0])
    finer = taken.of_free_run(now, given)
    assert now.problem.predictor.substeps == 2 < finer.problem.predictor.substeps
    slow = resolution(response)
    now = slow.of_model()
    assert slow.of_free_run(now, replace(given, problem=now.problem)) is now


@pytest.mark.long
def test_a_joint_left_out_takes_finer_steps_with_it():
    response = struck(lambda d: 8e3 * d)
    taken, (problem, scope) = resolution(response), searching(response)
    finer = taken.with_substeps(4).problem
    (place,), kind = scope.places, CATALOGUE["iwan_joint"][0]
    assert isinstance(kind, JointKind)
    guess = [JointStart(8e3, 1e-3, np.zeros(4))]
    own, (start,) = with_joint(problem, kind, place, guess)
    there, _ = with_joint(finer, kind, place, guess)
    moved = own.with_steps_of(finer)
    at = [(start.hypothesis, own.still(start.theta))]
    np.testing.assert_array_equal(
        residuals_at(moved, at, SHORT_TIME_CONSTANT)[0],
        residuals_at(there, at, SHORT_TIME_CONSTANT)[0],
    )
    assert np.any(
        residuals_at(own, at, SHORT_TIME_CONSTANT)[0]
        != residuals_at(there, at, SHORT_TIME_CONSTANT)[0]
    )
    # The nominal model gives its search up to the finer one, the joint's becomes its like.
    nominal = multistart(problem, [Start(problem.nothing(), np.zeros(6))], TIME_CONSTANT, 1)[0]
    more = multistart(own, [start], TIME_CONSTANT, 1)[0]
    table = ModelSelection(True, RankedFit(problem, nominal, -1e3), (RankedFit(own, more),), ())
    ended = concluded(table, finer, scope)
    assert ended.nominal.problem is finer
    (entry,) = ended.entries
    assert entry.problem.predictor.substeps == 4
    assert len(entry.problem.joints) == 2
    assert entry.fitted.time_constant == math.inf


def test_deviations_of_a_verdict_rest_on_derivatives_where_it_ended():
    """Not on those that a search has corrected by its own steps on the way there."""
    problem, scope = searching(struck(lambda d: 2e3 * d))
    nominal = multistart(problem, [Start(problem.nothing(), np.zeros(6))], TIME_CONSTANT, STEPS)[0]
    table = ModelSelection(False, RankedFit(problem, nominal), (), ())
    ended = concluded(table, problem, scope).nominal.fitted
    there = moved(problem, ended, np.zeros(problem.parameters))
    np.testing.assert_allclose(ended.normal, there.normal, rtol=1e-9)
    np.testing.assert_allclose(ended.scores, there.scores, rtol=1e-6)


@pytest.mark.long
def test_a_verdict_on_a_stiff_suspect_is_polished_with_finer_steps():
    # A joint that never slips, as the integration above has none.
    stuck = replace(JOINT, F_S=1e7)
    response = struck(lambda d: 1e13 * d**3)
    taken = resolution(response, stuck)
    now = taken.of_model()
    _, scope = searching(response, stuck)
    (place,), (cubic,) = scope.places, CATALOGUE["cubic_stiffness"]
    assert isinstance(cubic, ForceKind)
    stiff = force(now.problem, cubic, place.label, place.row, np.zeros(4), 1e13, shape=1.0)

    def ended(start: Start) -> RankedFit:
        for time_constant in (TIME_CONSTANT, math.inf):
            (fitted,) = multistart(now.problem, [start], time_constant, STEPS)
            start = fitted.start
        return RankedFit(now.problem, fitted)

    found, nominal = ended(stiff), ended(Start(now.problem.nothing(), np.zeros(6)))
    finer = taken.of_fit(now, found).problem
    assert finer is not now.problem
    table = concluded(ModelSelection(True, nominal, (found,), ()), finer, scope)
    assert table.detected
    assert table.best.problem is table.nominal.problem is finer
    assert table.best.fitted.time_constant == math.inf
    assert table.best.fitted.cost < 0.1 * found.fitted.cost


def test_what_moves_on_its_own_is_sought_away_from_what_looks_like_it():
    """A weak oscillator looked like a mass at the next place, which left 3.6 times the noise."""
    known = {kind.name: kind for kind in kinds_in_time() if isinstance(kind, JointKind)}
    places = [SimpleNamespace(label=f"m{i}") for i in range(9)]
    near = places[2:3]
    assert sought_at(known["attached_oscillator"], places, near, 3, 1) == (places[:6], 3)
    assert sought_at(known["bouc_wen"], places, near, 3, 1) == (near, 1)
    assert sought_at(known["bouc_wen"], places, places, 3, 2) == (places[:6], 2)
