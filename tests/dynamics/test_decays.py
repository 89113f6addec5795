"""Bands of modes that joints lower past one another, modes given by shape, modes at a sensor."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.dynamics import component_rows, half_sine, measured_decays, modal_input
from iwanjax.errors import InputError
from iwanjax.plotting import plot_decays
from iwanjax.signals import measured_components

# Four masses on springs of their own: natural frequencies at rest, Hz, and those of them that
# hang on a joint for nine tenths of their stiffness.
REST = np.array([10.0, 12.0, 14.0, 30.0])
JOINTED = {"first": 1, "second": 2}
DT, SAMPLES = 2e-3, 8_000


@cache
def masses(rest=tuple(REST)):
    """Without its joint a mass goes down to a third of its frequency."""
    k = (2.0 * np.pi * np.array(rest)) ** 2
    slack = k.copy()
    joints = {}
    for name, i in JOINTED.items():
        slack[i] = 0.1 * k[i]
        joint = ij.Iwan4(F_S=k[i], K_T=0.9 * k[i], chi=-0.5, beta=1.0)
        joints[name] = (np.eye(len(rest))[i], joint)
    C = np.diag(2.0 * 5e-3 * np.sqrt(k))
    return ij.JointedStructure(ij.LinearStructure(np.eye(len(rest)), C, np.diag(slack)), joints)


def decays(modes, excited, **options):
    force = half_sine(DT * np.arange(SAMPLES), 1e-2, 2.0 * np.pi * REST[excited])[:, None]
    return ij.modal_decays(
        masses(), force, DT, inputs=modal_input(masses(), excited), modes=modes, **options
    )


def test_every_band_that_is_chosen_has_its_mode_in_it():
    """Slack frequencies in order, 3.8 4.4 10 30, had 12 Hz looked for between 8 and 11."""
    bands = decays([0, 1, 2, 3], 0).bands
    assert len(bands) == 4
    for (low, high), f in zip(bands, REST, strict=True):
        assert low < f < high
    # A quarter of the way to a neighbour at least, and no band reaches over one.
    for (_, high), (low, _), f, above in zip(
        bands[:-1], bands[1:], REST[:-1], REST[1:], strict=True
    ):
        assert high == low
        assert f + 0.25 * (above - f) <= high < above


def test_the_decay_is_that_of_the_mode():
    ringdown = decays([1], 1).ringdowns[0][0]
    assert ringdown is not None
    np.testing.assert_allclose(ringdown.curves.frequency, REST[1], rtol=2e-3)


def test_a_force_may_be_one_row_of_samples():
    row = half_sine(DT * np.arange(SAMPLES), 1e-2, 2.0 * np.pi * REST[1])
    options = {"inputs": modal_input(masses(), 1), "modes": [1]}
    found = [ij.modal_decays(masses(), f, DT, **options) for f in (row, row[:, None])]
    curves = [each.ringdowns[0][0].curves.frequency for each in found]
    np.testing.assert_array_equal(curves[0], curves[1])


def test_modes_that_no_corner_can_part_share_a_band():
    near = masses((10.0, 12.0, 12.0 * (1.0 + 1e-4), 30.0))
    force = np.zeros((100, 1))
    force[0] = 1.0
    bands = ij.modal_decays(near, force, DT, inputs=np.ones((1, 4))).bands
    assert bands[1] == pytest.approx(bands[2], rel=0.1)
    for i in (1, 2):
        assert bands[i][0] < 11.9
        assert bands[i][1] > 12.1


def test_shapes_have_a_band_each():
    """In the order they are given in; where there is none it is chosen."""
    shapes = [[0.0, 0.1, 1.0, 0.0], [1.0, 0.0, 0.2, 0.0]]
    found = decays(shapes, 2, bands=[(13.0, 15.0), None])
    assert found.modes == (2, 0)
    assert found.bands[0] == (13.0, 15.0)
    assert found.bands[1] == decays([0], 0).bands[0]
    ringdown = found.ringdowns[0][0]
    assert ringdown is not None
    assert ringdown.curves.name == "mode 2"
    np.testing.assert_allclose(ringdown.curves.frequency, REST[2], rtol=2e-3)


@pytest.mark.parametrize(
    ("modes", "bands", "told"),
    [
        ([4], None, "mode 4 does not exist; expected 0 to 3"),
        ([-1], None, "mode -1 does not exist"),
        ([0, 0], None, "these are modes 0, 0; expected each once"),
        ([0, [1.0, 0.1, 0.0, 0.0]], None, "these are modes 0, 0; expected each once"),
        ([[1.0, 0.0]], None, r"shapes of 4 numbers.*shape \(2,\)"),
        ([[0.0] * 4], None, "not all zero"),
        ([0, 1], [(8.0, 11.0)], "got 1 bands for 2 modes; expected one each"),
        ([0, 1], [(8.0, 11.0), (13.0, 11.0)], r"bands\[1\] = \(13.0, 11.0\); expected two rising"),
        ([0], [(8.0,)], r"bands\[0\] = \(8.0,\)"),
    ],
)
def test_what_is_no_mode_or_band_is_refused(modes, bands, told):
    with pytest.raises(InputError, match=told):
        decays(modes, 0, bands=bands)


def test_components_by_simulation_and_by_measurement_are_the_same_where_sensors_know_all_modes():
    chain = ij.three_mass(zeta=2e-3)
    sensor = np.array([0.0, -1.0, 1.0])
    rows = component_rows(chain, sensor, [2, 0, 1])
    motion = np.random.default_rng(0).standard_normal((50, 3))
    # Thesis Eq. (3.36), mode by mode.
    Phi, M = np.asarray(chain.modes().Phi), np.asarray(chain.structure.M)
    for row, r in zip(rows, [2, 0, 1], strict=True):
        expected = (sensor @ Phi[:, r]) * (motion @ M @ Phi[:, r])
        assert_allclose(motion @ row, expected, rtol=1e-12, atol=1e-14)
    assert_allclose((motion @ rows.T).sum(axis=1), motion @ sensor, rtol=1e-9, atol=1e-12)
    # Eq. (3.37) of sensors of another gain each, among them this one.
    seen = np.vstack([[2.0, 0.0, 0.0], sensor, [0.0, 1.0, 3.0]])
    measured = measured_components(motion @ seen.T, seen @ Phi, 1)
    assert_allclose(measured, motion @ component_rows(chain, sensor, [0, 1, 2]).T, rtol=1e-9)


def test_of_more_sensors_than_modes_the_projector_is_that_of_least_squares():
    random = np.random.default_rng(1)
    Phi, u = random.standard_normal((5, 2)), random.standard_normal((20, 5))
    # Phi_s (Phi^T Phi)^-1 Phi^T u, as it is printed.
    projector = np.linalg.solve(Phi.T @ Phi, Phi.T)
    found = measured_components(u, Phi, 3)
    assert_allclose(found, (projector @ u.T).T * Phi[3], rtol=1e-9)
    with pytest.raises(InputError, match="sensor = 5; expected 0 to 4"):
        measured_components(u, Phi, 5)


@pytest.fixture(scope="module")
def chain_hit():
    """Three masses on a chain hit at the last: all modes, and what sensors see of them."""
    chain, dt = ij.three_mass(zeta=2e-3), 0.2
    push = half_sine(dt * np.arange(8000), 1.0, 0.5)[:, None]
    known = ij.modal_decays(chain, push, dt, inputs=[[0, 0, 1]])
    seen = ij.simulate(chain, push, dt, inputs=[[0, 0, 1]], sensors=np.eye(3))
    return chain, dt, known, seen


@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
def test_measured_decays_are_those_of_the_simulation(chain_hit, quantity):
    chain, dt, known, seen = chain_hit
    hit = ij.as_recording(
        np.asarray(getattr(seen, quantity)),
        sampling_rate=1.0 / dt,
        quantity=quantity,
        sensors=["a", "b", "c"],
    )
    found = measured_decays(
        chain, [hit], dict(zip("abc", np.eye(3), strict=True)), start=float(hit.time[40])
    )
    assert found.modes == known.modes
    part = slice(400, 6000)
    assert_allclose(found.envelope[0, part], known.envelope[0, part], rtol=0.03)
    for one, other in zip(found.ringdowns[0], known.ringdowns[0], strict=True):
        assert one is not None
        assert other is not None
        low, high = (float(np.mean(np.asarray(each.curves.frequency))) for each in (one, other))
        assert low == pytest.approx(high, rel=2e-3)
    plot_decays(found)


def test_measured_decays_need_recordings_that_are_alike_and_sensors_that_are_known(chain_hit):
    chain, dt, _, seen = chain_hit
    motion = np.asarray(seen.velocity)

    def recording(response, rate=1.0 / dt, names=("a", "b", "c"), name="one"):
        return ij.as_recording(
            response, sampling_rate=rate, quantity="velocity", sensors=list(names), name=name
        )

    sensors = dict(zip("abc", np.eye(3), strict=True))
    hit = recording(motion)
    for other in (recording(motion[:4000], name="two"), recording(motion, 2.0 / dt, name="two")):
        with pytest.raises(InputError, match="two has another rate, length or other channels"):
            measured_decays(chain, [hit, other], sensors)
    with pytest.raises(InputError, match="no channel of a, b, c is among the sensors x"):
        measured_decays(chain, [hit], {"x": [1.0, 0.0, 0.0]})
    with pytest.raises(InputError, match="no recordings"):
        measured_decays(chain, [], sensors)
    two = {name: sensors[name] for name in "ab"}
    assert measured_decays(chain, [hit], two).modes == (0, 1)
