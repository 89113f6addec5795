"""Frequency and damping from response control: simulated measurements with known answers."""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.signals import (
    controlled_resonance,
    read_response_control,
    resonance_from_control,
)
from iwanjax.studies import load_study

MASS, ZETA = 0.7, 0.004
BAND = np.linspace(0.985, 1.012, 15)
DRAWS = 200


def measured(level, derivatives, *, exponent=0.0, omega_1=600.0, friction=False):
    """Columns of a mode whose stiffness is m omega_1^2 |U|^exponent, (levels, 15) each."""
    level = np.asarray(level)[:, None]
    # From omega^2 = omega_1^2 (level/omega^p)^s.
    power = exponent / (2.0 + derivatives * exponent)
    resonance = omega_1 ** (2.0 / (2.0 + derivatives * exponent)) * level**power
    omega = BAND * resonance
    u = level / omega**derivatives
    k = MASS * omega_1**2 * u**exponent
    loss = 2.0 * ZETA * k * (1.0 if friction else omega / resonance)
    Z = k - MASS * omega**2 + 1j * loss
    phase = 0.5 * np.pi * derivatives - np.angle(Z)
    columns = {"level": level, "frequency": omega / (2 * np.pi), "force": u * np.abs(Z)}
    return columns | {"response": level, "phase": phase}, resonance[:, 0] / (2 * np.pi)


@pytest.mark.parametrize(
    ("quantity", "derivatives"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)]
)
def test_linear_modes_are_recovered_to_rounding(quantity, derivatives):
    columns, frequency = measured([3.0, 1.0, 2.0], derivatives)
    curves = resonance_from_control(**columns, quantity=quantity, unit="m", name="mode 1")
    assert (curves.quantity, curves.unit, curves.name) == (quantity, "m", "mode 1")
    np.testing.assert_allclose(curves.amplitude, [1.0, 2.0, 3.0], rtol=1e-14)
    np.testing.assert_allclose(curves.frequency, frequency[[1, 2, 0]], rtol=1e-12)
    np.testing.assert_allclose(curves.damping, ZETA, rtol=1e-9)


def test_stiffness_that_varies_over_a_sweep_does_not_pass_for_mass():
    exponent = -0.08
    columns, frequency = measured([1.0, 2.0, 4.0], 2, exponent=exponent, friction=True)
    curves = resonance_from_control(**columns)
    np.testing.assert_allclose(curves.frequency, frequency, rtol=1e-8)
    np.testing.assert_allclose(curves.damping, ZETA, rtol=1e-3)
    one = {key: np.broadcast_to(value, (3, 15))[1] for key, value in columns.items()}
    alone = resonance_from_control(**one)
    np.testing.assert_allclose(alone.frequency, frequency[1], rtol=1e-5)
    np.testing.assert_allclose(alone.damping, ZETA / (1.0 + exponent), rtol=2e-3)


@pytest.mark.long
def test_standard_deviations_are_those_of_repeated_measurements():
    columns, frequency = measured([1.0], 0)
    rng = np.random.default_rng(4)
    Z = columns["force"] * np.exp(-1j * columns["phase"])
    found = []
    for _ in range(DRAWS):
        noisy = Z + 20.0 * (rng.standard_normal(Z.shape) + 1j * rng.standard_normal(Z.shape))
        changed = {"force": np.abs(noisy), "phase": -np.angle(noisy)}
        found.append(resonance_from_control(**columns | changed, quantity="displacement"))
    for name, truth in (("frequency", frequency[0]), ("damping", ZETA)):
        values = np.array([getattr(each, name)[0] for each in found])
        claimed = np.array([getattr(each, f"{name}_std")[0] for each in found])
        scatter = np.std(values)
        assert abs(np.mean(values) - truth) < 4.0 * scatter / np.sqrt(DRAWS)
        # 200 repetitions tell a deviation to 5 %, one in sixteen thousand misses it by four.
        assert np.sqrt(np.mean(claimed**2)) == pytest.approx(scatter, rel=0.2)


def among_others(columns, flexibility):
    """The same as a sensor shows it where rigid bodies and other modes move it too."""
    u = columns["response"] * np.exp(1j * columns["phase"]) / (1j * columns["frequency"]) ** 2
    u = u / (2.0 * np.pi) ** 2 + flexibility * columns["force"]
    a = u * (2j * np.pi * columns["frequency"]) ** 2
    # The level is held at the sensor, not at the mode.
    scale = columns["level"] / np.abs(a)
    return columns | {
        "force": columns["force"] * scale,
        "response": columns["level"],
        "phase": np.angle(a),
    }


def test_other_modes_do_not_pass_for_drift_or_damping():
    columns, frequency = measured([1.0, 2.0, 4.0], 2)
    stiffness = MASS * 600.0**2
    mixed = among_others(columns, -3.0 / stiffness)
    found = controlled_resonance(**mixed)
    assert found.flexibility * stiffness == pytest.approx(-3.0, rel=1e-6)
    np.testing.assert_allclose(found.curves.frequency, frequency, rtol=1e-7)
    np.testing.assert_allclose(found.curves.damping, ZETA, rtol=1e-4)
    np.testing.assert_allclose(found.mass, MASS, rtol=1e-5)


@pytest.mark.long
def test_without_other_modes_none_are_seen_in_noise():
    rng = np.random.default_rng(2)
    columns, _ = measured([1.0, 2.0, 4.0], 2)
    Z = columns["force"] / columns["response"] * np.exp(-1j * columns["phase"])
    seen = 0
    for _ in range(100):
        noisy = Z * (1.0 + 2e-3 * rng.standard_normal(Z.shape) * np.exp(0.7j))
        changed = {"force": np.abs(noisy) * columns["response"], "phase": -np.angle(noisy)}
        seen += controlled_resonance(**columns | changed).flexibility != 0.0
    assert seen <= 5


def test_a_mode_that_drifts_while_it_is_measured_is_known_no_better_than_that():
    rng, levels = np.random.default_rng(3), np.arange(1.0, 9.0)[:, None]
    omega = BAND * 600.0
    # From the first point of a level to the last the mode moves, each level by its own.
    moved = 1e-3 * rng.standard_normal((8, 1)) * np.linspace(-0.5, 0.5, BAND.size)
    Z = MASS * (600.0 * (1.0 + moved)) ** 2 * (1.0 + 2j * ZETA) - MASS * omega**2
    found = controlled_resonance(
        levels,
        omega / (2 * np.pi),
        np.abs(Z) * levels,
        levels,
        -np.angle(Z),
        quantity="displacement",
    )
    in_hz = 600.0 / (2 * np.pi) * np.std(moved[:, -1] - moved[:, 0], ddof=1)
    assert found.drift == pytest.approx(in_hz, rel=0.1)
    np.testing.assert_allclose(found.curves.frequency_std, found.drift, rtol=0.05)


def test_residuals_that_are_alike_count_as_fewer():
    columns, _ = measured([1.0], 0, friction=False)
    Z = columns["force"] * np.exp(-1j * columns["phase"])
    slow = 200.0 * np.sin(np.linspace(0.0, 4.0 * np.pi, BAND.size))

    def deviation(added):
        changed = {"force": np.abs(Z + added), "phase": -np.angle(Z + added)}
        curves = resonance_from_control(**columns | changed, quantity="displacement")
        return float(curves.frequency_std[0])

    shuffled = np.random.default_rng(0).permutation(slow)
    assert deviation(slow) > 1.4 * deviation(shuffled)


def test_the_measured_beam_has_rigid_bodies_beside_its_mode(reference_data):
    table = np.genfromtxt(
        reference_data / "brb_rice" / "response_control.csv", delimiter=",", names=True
    )
    found = {}
    for name, levels in {"low": range(1, 6), "high": range(6, 9)}.items():
        rows = table[np.isin(table["level"], list(levels))]
        found[name] = controlled_resonance(
            rows["level"],
            rows["frequency_hz"],
            rows["force_n"],
            rows["acceleration_m_s2"],
            # Stored with the sign of a displacement.
            rows["phase_rad"] + np.pi,
        )
    stiffness = 1.9 * (2.0 * np.pi * 80.3) ** 2
    # Other levels, the same neighbours and the same modal mass.
    low, high = found["low"], found["high"]
    assert low.flexibility * stiffness == pytest.approx(high.flexibility * stiffness, abs=0.6)
    assert np.mean(low.mass) == pytest.approx(np.mean(high.mass), rel=0.01)
    assert high.drift < 0.01 < low.drift < 0.1  # Hz


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quantity": "jerk"}, "quantity = 'jerk'"),
        ({"force": 0.0}, "force holds 0; expected positive"),
        ({"phase": np.zeros(4)}, r"do not broadcast: level \(2, 1\)"),
        ({"frequency": np.array([90.0, 91.0, 92.0] * 5)}, "level 1 has 3 different frequencies"),
        ({"level": np.arange(2)[:, None], "response": 1.0}, "level 0 and level 1 differ by less"),
        ({"response": np.nan}, "response holds 1 NaN"),
    ],
)
def test_bad_arguments(change, message):
    columns, _ = measured([1.0, 2.0], 2)
    with pytest.raises(ij.InputError, match=message):
        resonance_from_control(**columns | change)


def test_a_phase_of_the_wrong_sign_and_a_resonance_outside_are_named():
    columns, _ = measured([1.0], 2)
    with pytest.raises(ij.InputError, match="phase must be that of the response"):
        resonance_from_control(**columns | {"phase": columns["phase"] + np.pi})
    below = {key: np.broadcast_to(value, (1, 15))[:, :5] for key, value in columns.items()}
    with pytest.raises(ij.InputError, match=r"level 1: the resonance, at 95\.\S+ Hz, lies"):
        resonance_from_control(**below)


HEADER = {0: "displacement_m", 1: "velocity_m_s", 2: "acceleration_m_s2"}


def written(tmp_path, derivatives: int, told=lambda phase: phase, **more):
    """A file of three levels as a recorder tells them."""
    columns, frequency = measured([1.0, 2.0, 4.0], derivatives, **more)
    columns["phase"] = told(columns["phase"])
    rows = np.broadcast_arrays(*columns.values())
    names = ["level", "frequency_hz", "force_n", HEADER[derivatives], "phase_rad"]
    path = tmp_path / "control.csv"
    table = np.stack([row.ravel() for row in rows], axis=1)
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="")
    return path, frequency


@pytest.mark.parametrize("derivatives", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("of_displacement", [False, True])
def test_a_file_may_tell_its_phase_in_any_way(tmp_path, derivatives, sign, of_displacement):
    turned = 0.5 * np.pi * derivatives if of_displacement else 0.0
    path, frequency = written(tmp_path, derivatives, lambda phase: sign * (phase - turned))
    curves = read_response_control(path, name="mode 1")
    np.testing.assert_allclose(curves.frequency, frequency, rtol=1e-9)
    np.testing.assert_allclose(curves.damping, ZETA, rtol=1e-6)
    assert HEADER[derivatives].startswith(curves.quantity)


def test_levels_are_taken_by_their_labels(tmp_path):
    path, frequency = written(tmp_path, 2, exponent=-0.08)
    curves = read_response_control(path, [1.0, 4.0])
    np.testing.assert_allclose(curves.frequency, frequency[[0, 2]], rtol=1e-6)
    with pytest.raises(ij.InputError, match=r"control.csv: no level 3; the file has 1, 2, 4"):
        read_response_control(path, [1.0, 3.0])


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("phase_rad", "phase", "phase_rad is missing.*did you mean"),
        ("acceleration_m_s2", "acceleration", "expected one of acceleration_m_s2.*found none"),
        ("level,", "step,", "level is missing"),
    ],
)
def test_a_column_that_is_missing_is_told(tmp_path, old, new, told):
    path, _ = written(tmp_path, 2)
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ij.InputError, match=told):
        read_response_control(path)


def test_a_phase_that_is_none_is_refused(tmp_path):
    path, _ = written(tmp_path, 2, np.degrees)
    with pytest.raises(ij.InputError, match=r"phase_rad goes to .*degrees"):
        read_response_control(path)
    path, _ = written(tmp_path, 0, np.zeros_like)
    with pytest.raises(ij.InputError, match=r"no mode has positive mass, stiffness and damping"):
        read_response_control(path)


def test_a_study_takes_response_control_of_a_mode(tmp_path):
    written(tmp_path, 2, exponent=-0.08, friction=True)
    entry = "file: control.csv, kind: response_control, mode: mode1"
    text = [
        "name: held",
        "model: {modal: [{name: mode1, band: [1, 1e4], joint: {type: iwan4}}]}",
        "recordings:",
        f"  - {{{entry}, levels: [1, 2], use: fit}}",
        f"  - {{{entry}, levels: [4], use: hold_out}}",
    ]
    (tmp_path / "study.yaml").write_text("\n".join(text))
    (mode,) = load_study(tmp_path / "study.yaml").curves().values()
    assert [hit.curves.amplitude.size for hit in (*mode.hits, *mode.held_out)] == [2, 1]
    names = [hit.name for hit in (*mode.hits, *mode.held_out)]
    assert names == ["control.csv[1, 2]", "control.csv[4]"]
    assert mode.hits[0].curves.unit == "m/s^2"
