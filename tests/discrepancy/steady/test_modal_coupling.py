"""Two modes on one joint, each taken for an oscillator with a joint of its own."""

import json
from types import SimpleNamespace

import bolted_chain as chain
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.discrepancy.steady.diagnose_joint import diagnose_curves
from iwanjax.errors import InputError
from iwanjax.identification.steady.cycle import ActingMode, InteractingMode, moved_by_both
from iwanjax.signals import ringdown

# Hits on both modes, the last held out, then such on one: strokes of the joint by each mode.
BOTH = np.array([[0.30, 0.30, 0.30, 0.25], [0.06, 0.45, 0.20, 0.30], [0.0] * 4])
ONE = np.array([[0.30, 0.28, 0.26, 0.24], [0.0] * 4, [0.0] * 4])
PRECISION, SENSOR = 0.05, "m3-ground"


def band(mode):
    f = chain.stuck()[0][mode] / (2.0 * np.pi)
    return 0.8 * f, 1.2 * f


def ratio(mode, other):
    """The joint's deflection by another mode over that by one, per displacement of the sensor."""
    seen, moved = (np.abs(chain.ROWS[row] @ chain.stuck()[1]) for row in (SENSOR, "J1"))
    return moved[other] / seen[other] / (moved[mode] / seen[mode])


@pytest.fixture(scope="module")
def signals():
    """Velocities (N, hits) of the sensor, noise of a thousandth of each one's peak."""
    v = chain.released(np.hstack([BOTH, ONE]), "J1", lambda d, v: 0.0 * d)
    seen = np.einsum("m,nmh->nh", chain.ROWS[SENSOR] @ chain.stuck()[1], v)
    noise = np.random.default_rng(3).standard_normal(seen.shape)
    return seen + 1e-3 * np.abs(seen).max(axis=0) * noise


def rung(signals):
    """Ring-downs of the first two modes, as far as a hit has moved them."""
    return {
        mode: [
            ringdown(signal, chain.RATE, band(mode), "velocity", unit="m/s", precision=PRECISION)
            for signal in signals.T[: BOTH.shape[1] if mode else None]
        ]
        for mode in (0, 1)
    }


def verdict(several, amplitude, **options):
    merged = ij.merge_curves(several[:-1])
    return diagnose_curves(
        "iwan4",
        merged.weighted_hits,
        merged.weighted(several[-1]),
        interacting_modes=[InteractingMode("mode1", 105.5, tuple(amplitude))],
        estimator_curves=several,
        **options,
    )


@pytest.fixture(scope="module")
def rings(signals):
    """Curves of the first mode's hits, and how far the second one moves while it rings with it."""
    found = rung(signals)
    omega = 2.0 * np.pi * 105.5
    amplitude = [
        np.interp(one.time, other.signal_time, other.envelope) / omega
        for one, other in zip(found[0], found[1], strict=False)
    ]
    return [each.curves for each in found[0]], amplitude


@pytest.mark.long
def test_a_joint_that_another_mode_moves(rings):
    curves, amplitude = rings
    both = curves[:4]
    # Hits that differ hide a joint that two modes move: they are taken to repeat badly.
    found = verdict(both, amplitude, hypotheses=("modal_coupling",))
    assert found.what[0].label == "modal_coupling@mode"
    assert found.what[0].probability > 0.9
    (size,) = found.what[0].parameters
    assert size.value == pytest.approx(ratio(0, 1), rel=0.05)
    assert found.after.hold_out < 2.0 * found.noise_floor.hold_out < found.before.hold_out


@pytest.mark.long
def test_a_joint_that_another_mode_does_not_move(rings):
    """The other mode is the same; with hits on one mode it is not in this joint."""
    curves, amplitude = rings
    found = verdict(curves[4:], amplitude, hypotheses=("modal_coupling",))
    assert not found.detected
    assert found.probability_nothing_missing > 0.9


def test_companions_of_other_levels_get_one_clear_line(signals):
    several = [each.curves for each in rung(signals)[1]]
    amplitude = [np.ones(each.amplitude.size) for each in several]
    with pytest.raises(InputError, match=r"interacting mode mode1 has \[\d+, .*as the curves have"):
        verdict(several, amplitude[1:])
    with pytest.raises(InputError, match=r"estimator_curves has \[\d+"):
        diagnose_curves("iwan4", several, estimator_curves=several[1:])


def test_another_mode_makes_a_joint_softer():
    joint = ij.Iwan4(F_S=1.0, K_T=1.0, chi=-0.5, beta=2.0)
    q, omega = jnp.full(4, 0.2 * joint.phi_max), jnp.asarray([1.0, 2.37])
    found = moved_by_both(joint, q, q * jnp.asarray([0.0, 0.1, 1.0, 3.0]), omega, 2000, 32, 100)
    np.testing.assert_allclose(found.stiffness[1][0], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.loss[0], 0.0, atol=1e-12)
    assert np.all(np.diff(found.stiffness[1]) < 0.0)
    # Other modes' motion cannot take more stiffness than the whole joint has.
    assert np.all(found.stiffness[1] > -joint.harmonic_stiffness(q))


@pytest.mark.parametrize("top", [1.0, 0.3])
@pytest.mark.parametrize("size", [3.0, 0.2])
def test_a_table_for_all_joints_does_what_the_motion_of_one_does(top, size):
    joint = ij.Iwan4(F_S=3.0, K_T=2.0, chi=-0.5, beta=2.0)
    q = joint.phi_max * jnp.geomspace(top, 0.02, 30)
    other = size * q * jnp.linspace(1.0, 0.1, 30)
    acting = ActingMode.of(InteractingMode("mode2", 23.7, (np.asarray(other),)), 20 * np.pi, 1)
    found, _ = acting.further(jnp.ones(1), SimpleNamespace(joint=joint), q)
    told = moved_by_both(joint, q, other, acting.omega, *acting.sizes)
    for name, scale in (("stiffness", 1.0), ("tip", 1.0), ("loss", q**2)):
        one, another = (getattr(each, name) / scale for each in (found, told))
        assert np.abs(one - another).max() < 2e-3 * np.abs(another).max()


@pytest.mark.long
def test_a_joint_that_two_modes_move_is_found_in_both(signals, tmp_path):
    entries = []
    for i, signal in enumerate(signals.T[: BOTH.shape[1]]):
        use = "hold_out" if i == BOTH.shape[1] - 1 else "fit"
        t = np.arange(signal.size) / chain.RATE
        np.savez(tmp_path / f"hit{i}.npz", time=t, response=signal[:, None])
        entries.append(
            f"  - {{file: hit{i}.npz, kind: free_decay, use: {use}, response: {{array: response, "
            "quantity: velocity, unit: m/s}}"
        )
    modes = [
        f"    - {{name: mode{m}, band: [{band(m)[0]}, {band(m)[1]}], joint: {{type: iwan4}}}}"
        for m in (0, 1)
    ]
    text = ["name: both", "model:", "  modal:", *modes, "recordings:", *entries]
    text += ["hypotheses: [modal_coupling]", f"ringdown: {{precision: {PRECISION}}}"]
    (tmp_path / "study.yaml").write_text("\n".join(text))
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["diagnose", str(tmp_path / "study.yaml"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    found = json.loads((out / "diagnosis.json").read_text())["modes"]
    for mode, other in ((0, 1), (1, 0)):
        told = found[f"mode{mode}"]
        (first,) = told["what"]
        assert (first["kind"], first["where"]) == ("modal_coupling", f"mode{mode}")
        # Averages are of steady motion, where both modes die down.
        assert first["parameters"]["ratio"]["value"] == pytest.approx(ratio(mode, other), rel=0.05)
        errors = {which: each["hold_out"] for which, each in told["fit"].items()}
        assert errors["after"] < 2.0 * errors["noise_floor"] < errors["before"]
