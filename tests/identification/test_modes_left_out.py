"""What sensors see of modes above the compared band, against modes that are moved and filtered."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal

import iwanjax as ij
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.kinds import UnnamedKind
from iwanjax.identification.conditioning import conditioned
from iwanjax.identification.hypotheses import LawStart, force, with_law
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.linearise import innovations
from iwanjax.identification.modes_left_out import ModesLeftOut
from iwanjax.identification.places import followed, places_of
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.recordings import StudyRecording
from iwanjax.identification.unnamed_law import blank_at, with_unnamed_law
from iwanjax.joints.unnamed_terms import PARTS, TERMS
from iwanjax.signals.comparison_band import END, HALF, in_band

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


def row_of_masses(added=0.0, damper=0.0, spring=0.0):
    """Four masses in a row, hit at one end and jointed to the ground at the other.

    Their highest mode lies at 0.7 of the sampling rate. The third may have more mass, and a damper
    and a spring to the ground.
    """
    M, k = np.diag([1.0, 0.9, 1.1 + added, 0.8]), (2.0 * np.pi * RATE * 0.36) ** 2
    K = k * (2.0 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))
    K[0, 0], K[2, 2], K[3, 3] = k, 2.0 * k + spring, k + 1e5
    C = 2e-5 * K + np.diag([0.0, 0.0, damper, 0.0])
    joint = ij.Iwan4(F_S=400.0, K_T=4e5, chi=-0.5, beta=1.5)
    joints = {"J1": (np.array([0.0, 0.0, 0.0, 1.0]), joint)}
    return ij.JointedStructure(ij.LinearStructure(M, C, K), joints)


INPUTS, SENSORS = jnp.eye(4)[:1], jnp.eye(4)[np.array([0, 3])]


def recorded(model):
    """All modes move, 256 steps a sample."""
    t = np.arange(N * FINE) / (RATE * FINE)
    run = ij.simulate(model, pulse(t), t[1], inputs=INPUTS, sensors=SENSORS, keep=["acceleration"])
    force = sampled(pulse(t)[:, None])
    return StudyRecording("rec", sampled(np.asarray(run.acceleration)), force)


def problem(recording, substeps, change=lambda made: made, kinds=()):
    made, modal = predictor(row_of_masses(), INPUTS, SENSORS, RATE, "acceleration", kinds, substeps)
    made = change(made)
    noise = 1e-4 * np.sqrt(np.mean(recording.response**2, axis=0))
    data = conditioned([recording], made, modal, noise, N, 1, 6).data
    joints = tuple(Joint(joint, jnp.ones(4)) for joint in row_of_masses().elements)
    return HistoryProblem(made, joints, data, noise, (0,)), np.asarray(modal.Phi)


def left_of(recording, problem, hypothesis, theta):
    """Share of the recording that the free run leaves in the band, by sensor."""
    e = in_band(innovations(problem, hypothesis, problem.still(theta), np.inf)[0])
    size = np.sqrt(np.mean(recording.response**2, axis=0))
    return np.sqrt(np.mean(np.square(e[HALF:-HALF]), axis=0)) / size


def test_a_predictor_that_leaves_modes_out_predicts_what_they_add_to_the_sensors():
    # What is left is of joints that yield to the highest mode's flexibility at once.
    recording = recorded(row_of_masses())

    def blind(made):
        nothing = jax.device_put(0.0 * np.asarray(made.left.sensors))
        return replace(made, left=made.left._replace(sensors=nothing))

    seen, _ = problem(recording, 16)
    unseen, _ = problem(recording, 16, blind)
    assert seen.predictor.left.number > 0
    left, before = (left_of(recording, p, p.nothing(), p.map.given()) for p in (seen, unseen))
    assert np.all(left < 0.25 * before)


@pytest.mark.parametrize("substeps", [2, 8])
def test_a_mass_of_the_law_without_a_name_is_as_one_in_the_model(substeps):
    # As large as what moves there: following from deflections, which yield at once to the modes
    # left out, it bounced, the sooner the shorter the steps.
    added = 0.3
    recording = recorded(row_of_masses(added))
    made, shapes = problem(recording, substeps)
    row = np.array([0.0, 0.0, 1.0, 0.0])
    (place,) = places_of(made, followed(made), {"m3": row @ shapes})
    law = blank_at(place)
    strengths = np.zeros(len(TERMS))
    strengths[PARTS["inertia"].start] = added * float(law.rate) * 2.0 * np.pi / float(law.period)
    begun = [LawStart(law.with_strengths(strengths), np.zeros(made.parameters))]
    other, (start,) = with_unnamed_law(made, UnnamedKind(), place, begun)
    left = left_of(recording, other, start.hypothesis, start.theta)
    assert np.all(left < 0.01)


DAMPER = 3000.0


@pytest.fixture(scope="module")
def damped():
    """A recording of the masses with the damper."""
    return recorded(row_of_masses(damper=DAMPER))


@pytest.mark.parametrize(("substeps", "how"), [(2, "force"), (8, "force"), (2, "element")])
def test_a_damper_follows_how_fast_modes_left_out_yield(damped, substeps, how):
    c, recording = DAMPER, damped
    made, shapes = problem(recording, substeps, kinds=CATALOGUE["viscous_damping"])
    row, z = np.array([0.0, 0.0, 1.0, 0.0]) @ shapes, np.zeros(made.parameters)
    (place,) = places_of(made, followed(made), {"m3": row})
    if how == "force":
        start = force(made, made.predictor.kinds[0], "m3", row, z, c, 1.0)
    else:
        made, (start,) = with_law(made, UnnamedKind(), place, [LawStart(ij.Dashpot(c), z)])
    kept, left, end = made.predictor.kept, made.predictor.left, 2.0 * np.pi * END * RATE
    # Such a spring before it makes it so much softer at the band's end. It is followed but for the
    # inertia of those modes.
    softer = c * end * float(row[kept:] ** 2 @ left.flexibility)
    assert np.all(
        left_of(recording, made, start.hypothesis, start.theta)
        < softer * end**2 / float(left.omega2[0])
    )


def test_a_spring_that_is_suspected_leaves_what_one_in_the_model_does():
    # By what is expected of its force alone it left no number.
    k = 4e6
    recording = recorded(row_of_masses(spring=k))
    made, shapes = problem(recording, 2, kinds=CATALOGUE["stiffness_error"])
    row, z = np.array([0.0, 0.0, 1.0, 0.0]) @ shapes, np.zeros(made.parameters)
    (place,) = places_of(made, followed(made), {"m3": row})
    suspect = force(made, made.predictor.kinds[0], "m3", row, z, k, 1.0)
    other, (known,) = with_law(made, UnnamedKind(), place, [LawStart(ij.LinearSpring(k), z)])
    found = left_of(recording, made, suspect.hypothesis, suspect.theta)
    expected = left_of(recording, other, known.hypothesis, known.theta)
    np.testing.assert_allclose(found, expected, rtol=1e-2)
