"""Whether a recording begins at rest, told by its data; and whether a cycle is steady."""

from pathlib import Path

import numpy as np
import pytest
import scipy.signal
from discrepancy.histories import forced_oscillator as forced

import iwanjax as ij
from iwanjax.discrepancy import StudyRecording
from iwanjax.identification.initial_state import initial_state, unsteady

RATE, N = 1024.0, 4096
NOISE = 1e-3
# Two modes at two sensors, driven at one place: 40 Hz and 130 Hz, 1 % damping.
SHAPES = np.array([[1.0, 0.8], [0.7, -1.0]])
OMEGA = 2.0 * np.pi * np.array([40.0, 130.0])
SEEN = {"displacement": 0, "velocity": 1}


def response(force, quantity="displacement", seed=0, noise=NOISE, offset=0.0):
    """At both sensors, in units of its root mean square, with that much noise."""
    modes = []
    for omega in OMEGA:
        A = np.array([[0.0, 1.0], [-(omega**2), -0.02 * omega]])
        C = {"displacement": [[1.0, 0.0]], "velocity": [[0.0, 1.0]], "acceleration": A[1:]}
        D = [[float(quantity == "acceleration")]]
        system = scipy.signal.StateSpace(A, [[0.0], [1.0]], C[quantity], D)
        modes.append(scipy.signal.lsim(system, force, np.arange(len(force)) / RATE)[1])
    x = np.column_stack(modes) @ (SHAPES * SHAPES[0]).T
    x = x / np.std(x)
    return x + noise * np.random.default_rng(seed).standard_normal(x.shape) + offset


def hit(begin=200):
    force = np.zeros(N)
    force[begin : begin + 9] = np.hanning(11)[1:-1]
    return force


def random_force(seed=5):
    return np.random.default_rng(seed).standard_normal(N)


def recorded(x, force, **options):
    """With the noise of a load cell."""
    if force is not None:
        noise = np.random.default_rng(len(force)).standard_normal(len(force))
        force = (force + 1e-4 * np.max(np.abs(force)) * noise)[:, None]
    return StudyRecording("rec", x, force, **options)


@pytest.mark.parametrize("offset", [0.0, 3.0])
@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.05])
@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_a_hit_after_its_trigger_begins_at_rest(quantity, noise, offset):
    x = response(hit(), quantity, noise=noise, offset=offset)
    assert initial_state(recorded(x, hit())) == "rest"


def test_a_hit_on_what_moves_already_does_not():
    # Two hits, the record begins between them.
    force = hit(200) + hit(2300)
    x = response(force, "acceleration")
    assert initial_state(recorded(x, force)) == "rest"
    assert initial_state(recorded(x[2000:], force[2000:])) == "unknown"


@pytest.mark.parametrize("quantity", SEEN)
def test_a_random_force_from_the_first_sample_on(quantity):
    """The response begins at nought: at rest. Cut from the middle it is not known."""
    force = random_force()
    force[0] = 0.0
    x = response(force, quantity)
    assert initial_state(recorded(x, force)) == "rest"
    cuts = [initial_state(recorded(x[i:], force[i:])) for i in range(600, 2600, 100)]
    assert cuts.count("unknown") == len(cuts)


def test_a_shaker_that_starts_later():
    force = random_force() * (np.arange(N) > 300)
    x = response(force, "acceleration")
    assert initial_state(recorded(x, force)) == "rest"


def test_other_excitations_from_rest():
    x, f = forced.recording(900, 400.0, 1)
    assert initial_state(StudyRecording("a", x, f)) == "rest"
    # A single sensor passes zero now and then, which nothing tells from rest.
    cuts = [initial_state(StudyRecording("a", x[i:], f[i:])) for i in range(100, 700, 5)]
    assert cuts.count("unknown") > 0.97 * len(cuts)


def test_recorded_hits_of_the_repository_begin_at_rest():
    folder = Path(__file__).resolve().parents[2] / "configs" / "concealed_spring"
    files = sorted(folder.glob("hit*.npz"))
    assert files
    for file in files:
        measured = ij.read_recording(file, quantity="acceleration")
        given = StudyRecording(file.name, measured.response, measured.force)
        assert initial_state(given) == "rest", file.name


def test_what_a_recording_says_counts():
    x = response(hit())
    for said in ("rest", "unknown", "periodic"):
        assert initial_state(recorded(x, hit(), initial=said)) == said
    assert initial_state(recorded(x, None)) == "unknown"


def test_a_sensor_that_is_not_there_says_nothing():
    x = response(hit())
    x[:, 1] = np.nan
    assert initial_state(recorded(x, hit())) == "rest"


PERIOD = 512


def periodic(count, skip, force_noise=0.0, noise=NOISE):
    """So many periods of a multisine, after some that are not recorded."""
    one = np.random.default_rng(8).standard_normal(PERIOD)
    whole = np.tile(one, skip + count)
    x = response(whole, noise=noise)[skip * PERIOD :]
    shown = whole[skip * PERIOD :]
    return x, shown + force_noise * np.random.default_rng(9).standard_normal(len(shown))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_steady_cycle_is_one(count):
    x, force = periodic(count, skip=20, force_noise=0.01)
    assert unsteady(recorded(x, force, initial="periodic")) is None


@pytest.mark.parametrize(
    ("case", "words"),
    [
        (lambda: periodic(5, skip=0), "first period differs from the second by"),
        (lambda: periodic(2, skip=0), "first period differs from the second by"),
        (lambda: [part[: PERIOD // 2] for part in periodic(1, skip=20)], "does not join"),
    ],
)
def test_a_transient_is_no_steady_cycle(case, words):
    x, force = case()
    assert words in unsteady(recorded(x, force, initial="periodic"))
    assert unsteady(recorded(x, force)) is None


def test_a_response_that_does_not_repeat_with_its_force():
    x, force = periodic(6, skip=20)
    t = np.arange(len(x)) / RATE
    x = x + np.sin(2.0 * np.pi * 41.3 * t)[:, None]
    told = unsteady(recorded(x, force, initial="periodic"))
    assert told is not None
    assert "from one of the force's 6 periods to the next" in told
