"""The three masses of chapter 2: ACCEPTANCE section 4, and the coupled prediction."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.dynamics import half_sine, modal_input, point_input

pytestmark = pytest.mark.reference

ZETA_0 = 1e-4
# 36 samples in a period of the third mode; the exact integrator has no dispersion of its own.
DT, SAMPLES = 0.1, 40_001
MICROSLIP, TRANSITION, MACROSLIP = (0.2, 12.0), (45.0, 150.0), (300.0, 1e4)


@cache
def system():
    return ij.three_mass(zeta=ZETA_0)


def hits(levels, omega, finer=1):
    """One case for each level: half sines on one input."""
    t = DT / finer * np.arange(finer * (SAMPLES - 1) + 1)
    return half_sine(t, np.asarray(levels)[:, None], omega)[..., None]


@cache
def selective(mode, levels, limit):
    """Procedure I: the decay of one mode that was excited alone (2.27)."""
    omega = float(system().modes().omega[mode])
    return ij.modal_decays(
        system(),
        hits(levels, omega),
        DT,
        inputs=modal_input(system(), mode, limit=limit),
        modes=[mode],
    )


def curves_of(mode, levels, limit, index=0):
    """Amplitude, frequency and damping of all decays in one row each."""
    decays = selective(mode, levels, limit)
    assert all(reason == "" for row in decays.reasons for reason in row)
    each = [row[index].curves.as_quantity("displacement") for row in decays.ringdowns]
    return tuple(
        np.concatenate([np.asarray(getattr(c, name)) for c in each])
        for name in ("amplitude", "frequency", "damping")
    )


@cache
def quasi_static(mode):
    omega2 = float(system().modes().omega[mode]) ** 2
    alpha = omega2 * np.geomspace(0.05, 4e4, 400)
    found = ij.qsma(system(), mode, alpha, ZETA_0, frequency="first_harmonic")
    return tuple(np.asarray(x) for x in (found.q, found.curves.frequency, found.curves.damping))


def differences(mode, levels, limit, span):
    """Relative differences of quasi-static frequency and damping from the decays within a span."""
    q, f, zeta = curves_of(mode, levels, limit)
    inside = (q > span[0]) & (q < span[1])
    assert inside.sum() >= 5
    q, f, zeta = q[inside], f[inside], zeta[inside]
    q_s, f_s, zeta_s = quasi_static(mode)
    alone = np.exp(np.interp(np.log(q), np.log(q_s), np.log(zeta_s)))
    return np.interp(q, q_s, f_s) / f - 1.0, alone / zeta - 1.0


def test_frequencies_and_shapes():
    omega, Phi = system().modes()
    assert omega == pytest.approx([0.424470, 1.215684, 1.744115], rel=1e-6, abs=5e-7)
    printed = np.array(
        [[0.1051, 0.2433, -0.1725], [0.1891, 0.0871, 0.2380], [0.2307, -0.1822, -0.1166]]
    )
    assert np.abs(Phi) == pytest.approx(np.abs(printed), abs=1e-4)


def test_mode_2_in_microslip():
    f, zeta = differences(1, (0.4, 3.0, 9.0), "low", MICROSLIP)
    assert np.abs(f).max() < 2e-4
    assert np.abs(zeta).max() < 0.015


def test_mode_2_at_the_transition():
    f, zeta = differences(1, (200.0, 300.0), "high", TRANSITION)
    assert np.abs(f).max() < 3e-3
    assert np.abs(zeta).max() < 0.15


def test_mode_2_in_macroslip():
    f, zeta = differences(1, (3400.0, 10000.0), "high", MACROSLIP)
    assert np.abs(f).max() < 2e-3
    assert np.abs(zeta).max() < 0.05


def test_the_fitted_modal_model_of_table_2_3():
    """Mode 2 in microslip, with the printed parameters."""
    q, f, zeta = curves_of(1, (0.4, 3.0, 9.0), "low")
    joint = ij.Iwan4(F_S=2.877, K_T=7.843e-2, chi=-0.5150, beta=5.614)
    omega_0 = np.sqrt(1.399 + 7.843e-2)
    model = ij.ModalOscillator(omega_0 / (2 * np.pi), ZETA_0, joint)
    f_m, zeta_m = (np.asarray(x) for x in model.frequency_and_damping(q))
    assert np.abs(f_m / f - 1).max() < 5e-4
    assert np.abs(zeta_m / zeta - 1).max() < 0.05


# Mode 3 of Table 2.2, and of Table 2.3 with the shares that a fit by eye may be off by.
HIGH, LOW = (200000.0, 75000.0, 15000.0, 5600.0, 150.0), (12.0, 2.0, 0.38, 0.096, 0.192)
TABLE_2_3 = {
    "K_inf": (2.922, 0.002),
    "zeta_0": (1.0e-4, 0.02),
    "F_S": (3.278, 0.05),
    "K_T": (0.1196, 0.02),
    "chi": (-0.5070, 0.05),
    "beta": (4.800, 0.05),
}


@pytest.mark.long
def test_table_2_3_comes_out_of_a_fit():
    """Procedure I to its end, the fit: the table's was by eye, hence the per cents.

    Decays without noise are fitted with the model's own error. To the deviations that they
    state, a millionth of the frequency beside kinks, residuals were 870 deviations, F_S 76 %
    high and beta 84 % low.
    """
    rows = [
        row[0].curves.as_quantity("displacement")
        for levels, limit in ((HIGH, "high"), (LOW, "low"))
        for row in selective(2, levels, limit).ringdowns
    ]
    found = ij.fit("iwan4", rows, starts=32)
    assert found.model_error == (2e-4, 0.015)
    # The modal model follows the mode of the chain in both regimes of slip, as the text says.
    assert found.misfit < 1.0
    assert not found.active_bounds
    told = found.values | {name: value for name, (value, _) in found.derived.items()}
    for name, (printed, share) in TABLE_2_3.items():
        assert told[name] == pytest.approx(printed, rel=share), name
    # Nearer to the decays than the table's own parameters.
    joint = ij.Iwan4(F_S=3.278, K_T=0.1196, chi=-0.5070, beta=4.800)
    printed = ij.ModalOscillator(np.sqrt(2.922 + 0.1196) / (2 * np.pi), ZETA_0, joint)
    q, zeta = (
        np.concatenate([np.asarray(getattr(c, k)) for c in rows]) for k in ("amplitude", "damping")
    )
    off = np.asarray(printed.ringdown_frequency_and_damping(q)[1]) / zeta - 1
    assert found.damping_rms < 0.5 * np.sqrt(np.mean(off**2))


@cache
def point_hits(mass, levels, finer=1):
    """Procedure III: hits on one mass (2.29)."""
    omega_3 = float(system().modes().omega[2])
    return ij.modal_decays(
        system(),
        hits(levels, omega_3, finer),
        DT / finer,
        inputs=point_input(system(), mass),
        every=finer,
    )


def test_damping_of_mode_1_joins_the_single_mode_curve():
    """Figure 2.8: a hit on mass 2 with p = 15 000."""
    decays = point_hits(1, (15000.0,))
    first = decays.ringdowns[0][0]
    zeta = np.asarray(first.curves.damping)
    q = np.asarray(first.curves.as_quantity("displacement").amplitude)
    q_s, _, zeta_s = quasi_static(0)
    alone = np.interp(q, q_s, zeta_s)
    late = first.time > 1850.0
    assert late.sum() >= 2
    assert np.abs(zeta[late] / alone[late] - 1).max() < 0.05
    early = first.time < 900.0
    assert early.any()
    assert np.all(zeta[early] < 0.6 * alone[early])
    at = np.interp([1582.0, 1882.0], first.time, zeta)
    assert at == pytest.approx([2.66e-4, 3.35e-4], rel=0.1)


@cache
def comparisons():
    """Every impact of the text: masses 1, 2, 3 at eight levels."""
    levels = (150000.0, 50000.0, 15000.0, 5000.0, 300.0, 10.0, 3.0, 1.0)
    # An error of 1.5e-4 of the response is 4 % of the damping of a mode that hardly moves.
    return {mass: ij.compare_modes(point_hits(mass, levels, 2)) for mass in range(3)}


@pytest.mark.long  # notebook 04 compares them too
def test_coupled_modes_beside_the_single_mode_model():
    """Median damping error <= 10 % where the single-mode model is off by up to 67 % and more."""
    coupled, single = [], []
    for mass, found in comparisons().items():
        assert len(found) >= 20, mass
        for each in found:
            coupled.append(np.abs(each.coupled_error[:, 1]))
            single.append(np.abs(each.single_error[:, 1]))
            assert np.median(coupled[-1]) < 0.1, each.statement()
    assert np.median(np.concatenate(coupled)) < 0.02
    assert np.median(np.concatenate(single)) > 0.15


@pytest.mark.long
def test_a_weak_mode_in_microslip_is_underestimated_when_taken_alone():
    """Mode 2 is weak at mass 2, whose hit of p = 300 makes the others drive the joint."""
    (each,) = (c for c in comparisons()[1] if c.mode == 1 and c.case == 4)
    assert np.min(each.single_error[:, 1]) < -0.6
    assert np.abs(each.coupled_error[:, 1]).max() < 0.12
    assert np.all(each.share < 0.35)


def test_with_one_mode_alone_it_is_the_quasi_static_analysis():
    q = np.geomspace(1.0, 40.0, 9)
    for mode in (0, 1):
        found = ij.coupled_modes(system(), q[:, None], ZETA_0, modes=[mode])
        q_s, f_s, zeta_s = quasi_static(mode)
        assert bool(jnp.all(found.converged))
        assert found.frequency[:, 0] == pytest.approx(np.interp(q, q_s, f_s), rel=2e-5)
        alone = np.exp(np.interp(np.log(q), np.log(q_s), np.log(zeta_s)))
        assert found.damping[:, 0] == pytest.approx(alone, rel=0.01)
