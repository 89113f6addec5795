"""Frequency and damping from force control: modes that soften, jump, and known answers."""

import numpy as np
import pytest
from scipy.optimize import root_scalar

import iwanjax as ij
from iwanjax.signals import (
    curves_from_force_control,
    read_force_control,
    read_response_control,
    resonance_from_control,
)
from iwanjax.studies import load_study

MASS, OMEGA, ZETA = 1.3, 440.0, 0.003
LARGEST = 1e-3


def stiffness(a, softening):
    """N/m at an amplitude of displacement; it falls with the root of the amplitude."""
    return MASS * OMEGA**2 * (1.0 - softening * np.sqrt(a / LARGEST))


def loss(a, softening):
    """N/m in quadrature, likewise."""
    return MASS * OMEGA**2 * (2.0 * ZETA + 0.1 * softening * np.sqrt(a / LARGEST))


def answers(a, softening):
    """Hz and damping ratio."""
    k = stiffness(a, softening)
    return np.sqrt(k / MASS) / (2.0 * np.pi), loss(a, softening) / (2.0 * k)


def root(off, low, high):
    """Where something passes zero."""
    return root_scalar(off, bracket=(low, high), xtol=1e-18, rtol=1e-14).root


def swept(forces, softening, *, derivatives=0, upward=True, reach=0.03, low=1.0, high=1.0):
    """Columns of sweeps at held forces, each about its own resonance, 31 steps."""
    rows = []
    amplitudes = np.geomspace(1e-9, 10.0 * LARGEST, 3000)
    for label, F in enumerate(forces, 1):
        peak = root(lambda a, F=F: loss(a, softening) * a - F, 1e-12, 10.0 * LARGEST)
        centre = np.sqrt(stiffness(peak, softening) / MASS)
        steps = centre * np.linspace(1.0 - low * reach, 1.0 + high * reach, 31)
        last = 0.1 * peak
        for omega in steps if upward else steps[::-1]:

            def off(a, F=F, omega=omega):
                k, h = stiffness(a, softening), loss(a, softening)
                return np.hypot(k - MASS * omega**2, h) * a - F

            signs = np.flatnonzero(np.diff(np.sign(off(amplitudes))))
            roots = [root(off, amplitudes[i], amplitudes[i + 1]) for i in signs]
            # Of several steady motions a sweep stays on the nearest.
            a = min(roots, key=lambda each, last=last: abs(np.log(each / last)))
            last = a
            Z = stiffness(a, softening) - MASS * omega**2 + 1j * loss(a, softening)
            phase = 0.5 * np.pi * derivatives - np.angle(Z)
            rows.append([label, omega / (2.0 * np.pi), F, a * omega**derivatives, phase])
    return np.array(rows)


def forces(softening, *shares):
    """That lead to shares of the largest amplitude."""
    a = LARGEST * np.asarray(shares)
    return loss(a, softening) * a


@pytest.mark.parametrize(
    ("quantity", "derivatives"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)]
)
def test_linear_modes_are_recovered_to_rounding(quantity, derivatives):
    rows = swept(forces(0.0, 0.1, 0.3, 1.0), 0.0, derivatives=derivatives)
    curves = curves_from_force_control(*rows.T, quantity=quantity, unit="m", name="mode 1")
    assert (curves.quantity, curves.unit, curves.name) == (quantity, "m", "mode 1")
    assert curves.amplitude.size > 4
    np.testing.assert_allclose(curves.amplitude[-1], LARGEST * OMEGA**derivatives, rtol=1e-12)
    np.testing.assert_allclose(curves.frequency, OMEGA / (2.0 * np.pi), rtol=1e-11)
    np.testing.assert_allclose(curves.damping, ZETA, rtol=1e-8)


@pytest.mark.parametrize("upward", [True, False])
@pytest.mark.parametrize(
    ("shares", "off"), [((0.1, 0.2, 0.4, 0.7, 1.0), 1e-3), ((0.03, 0.1, 0.33, 1.0), 2e-3)]
)
def test_a_mode_that_softens_until_it_jumps(upward, shares, off):
    softening = 0.12
    rows = swept(forces(softening, *shares), softening, upward=upward, reach=0.06)
    # It does jump: from one step to the next by half of itself.
    hardest = rows[rows[:, 0] == len(shares), 3]
    assert np.max(np.abs(np.diff(np.log(hardest)))) > 0.5
    curves = curves_from_force_control(*rows.T, quantity="displacement")
    frequency, damping = answers(np.asarray(curves.amplitude), softening)
    # What splines do between their knots, over gaps where levels are half a decade apart.
    fall = OMEGA / (2.0 * np.pi) - frequency
    assert np.max(np.abs(curves.frequency - frequency) / fall) < off
    np.testing.assert_allclose(curves.damping, damping, rtol=off)


def test_one_level_tells_how_the_mode_softens_along_it():
    softening = 0.02
    rows = swept(forces(softening, 1.0), softening)
    curves = curves_from_force_control(*rows.T, quantity="displacement")
    assert curves.amplitude[0] < 0.4 * curves.amplitude[-1]
    frequency, damping = answers(np.asarray(curves.amplitude), softening)
    fall = OMEGA / (2.0 * np.pi) - frequency
    assert np.max(np.abs(curves.frequency - frequency) / fall) < 0.01
    np.testing.assert_allclose(curves.damping, damping, rtol=5e-3)


def test_standard_deviations_are_those_of_repeated_measurements():
    softening = 0.05
    rows = swept(forces(softening, 0.2, 0.45, 1.0), softening)
    rng = np.random.default_rng(5)
    told: dict[str, list[np.ndarray]] = {"frequency": [], "damping": []}
    for _ in range(300):
        noisy = rows.copy()
        noisy[:, 2] *= 1.0 + 0.01 * rng.standard_normal(len(rows))
        noisy[:, 4] += 0.01 * rng.standard_normal(len(rows))
        curves = curves_from_force_control(*noisy.T, quantity="displacement")
        # At the amplitudes that noise has shifted a little.
        true = answers(np.asarray(curves.amplitude), softening)
        for (name, each), truth in zip(told.items(), true, strict=True):
            off = np.asarray(getattr(curves, name)) - truth
            each.append(off / np.asarray(getattr(curves, f"{name}_std")))
    for each in told.values():
        # 300 repetitions tell a mean to 6 % of a deviation, and a deviation to 4 %.
        assert abs(np.mean(np.concatenate(each))) < 0.24
        assert np.sqrt(np.mean(np.concatenate(each) ** 2)) == pytest.approx(1.0, abs=0.16)


def test_held_response_gives_the_same_as_its_own_analysis(reference_data):
    path = reference_data / "brb_rice" / "response_control.csv"
    held, free = read_response_control(path), read_force_control(path)
    frequency, damping = (
        np.interp(held.amplitude, free.amplitude, each) for each in (free.frequency, free.damping)
    )
    # Levels nearer to each other than the knots: between them the mode is taken to be smooth.
    np.testing.assert_allclose(frequency, held.frequency, rtol=1e-3)
    np.testing.assert_allclose(damping, held.damping, rtol=0.06)


def test_sweeps_that_tell_no_mass_are_refused():
    rng = np.random.default_rng(1)
    rows = swept(forces(0.0, 1.0), 0.0, low=0.5, high=-0.1)
    rows[:, 4] += 0.005 * rng.standard_normal(len(rows))
    with pytest.raises(ij.InputError, match=r"mass to \d+ % only; expected sweeps on both sides"):
        curves_from_force_control(*rows.T, quantity="displacement")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quantity": "jerk"}, "quantity = 'jerk'"),
        ({"force": 0.0}, "force holds 0; expected positive"),
        ({"phase": np.zeros(4)}, r"do not broadcast: level \(62,\)"),
        ({"response": np.nan}, "response holds 1 NaN"),
        ({"phase": 0.1}, "level 1 stays away from its resonance"),
    ],
)
def test_bad_arguments(change, message):
    rows = swept(forces(0.02, 0.3, 1.0), 0.02)
    names = ("level", "frequency", "force", "response", "phase")
    columns = dict(zip(names, rows.T, strict=True))
    with pytest.raises(ij.InputError, match=message):
        curves_from_force_control(**{**columns, "quantity": "displacement", **change})


def test_phases_behind_and_few_points_are_told():
    rows = swept(forces(0.02, 0.3, 1.0), 0.02)
    rows[:, 4] += np.pi
    with pytest.raises(ij.InputError, match="phase must be that of the response"):
        curves_from_force_control(*rows.T, quantity="displacement")
    rows[:, 4] -= np.pi
    with pytest.raises(ij.InputError, match=r"points are near their resonance; expected more"):
        curves_from_force_control(*rows[14::4].T, quantity="displacement")
    one = rows[:31].copy()
    one[:, 3] = one[15, 3]
    with pytest.raises(ij.InputError, match="all amplitudes are within"):
        curves_from_force_control(*one.T, quantity="displacement")


def test_a_study_takes_force_control_of_a_mode(tmp_path):
    softening = 0.05
    rows = swept(forces(softening, 0.1, 0.2, 0.4, 0.8, 1.0), softening, derivatives=2)
    header = "level,frequency_hz,force_n,acceleration_m_s2,phase_rad"
    np.savetxt(tmp_path / "swept.csv", rows, delimiter=",", header=header, comments="")
    entry = "file: swept.csv, kind: force_control, mode: mode1"
    text = [
        "name: forced",
        "model: {modal: [{name: mode1, band: [1, 1e4], joint: {type: iwan4}}]}",
        "recordings:",
        f"  - {{{entry}, levels: [1, 2, 4], use: fit}}",
        f"  - {{{entry}, levels: [3, 5], use: hold_out}}",
    ]
    (tmp_path / "study.yaml").write_text("\n".join(text))
    (mode,) = load_study(tmp_path / "study.yaml").curves().values()
    (fitted,), (held,) = mode.hits, mode.held_out
    assert (fitted.name, held.name) == ("swept.csv[1, 2, 4]", "swept.csv[3, 5]")
    assert (fitted.curves.quantity, fitted.curves.unit) == ("acceleration", "m/s^2")
    for curves in (fitted.curves, held.curves):
        a = curves.amplitude / (2.0 * np.pi * curves.frequency) ** 2
        frequency, _ = answers(np.asarray(a), softening)
        fall = OMEGA / (2.0 * np.pi) - frequency
        assert np.max(np.abs(curves.frequency - frequency) / fall) < 1e-3


def test_a_linear_mode_is_the_same_at_held_response():
    rows = swept(forces(0.0, 0.1, 0.3, 1.0), 0.0)
    one = rows[rows[:, 0] == 2.0]
    # Linear: at any amplitude its force is in proportion.
    scale = LARGEST / one[:, 3]
    held = resonance_from_control(
        1.0, one[:, 1], one[:, 2] * scale, LARGEST, one[:, 4], quantity="displacement"
    )
    free = curves_from_force_control(*rows.T, quantity="displacement")
    np.testing.assert_allclose(free.frequency, held.frequency[0], rtol=1e-10)
    np.testing.assert_allclose(free.damping, held.damping[0], rtol=1e-7)
