"""Fits to curves of modes that moved together, against motions that other averages have made."""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.updating import fit

TRUTH = {"F_S": 10.0, "K_T": 1.0, "chi": -0.5, "beta": 5.0}
ZETA_0, MODE, OTHER = 1e-4, 1, 2
Q = np.geomspace(60.0, 0.6, 16)
# How far the other mode moves at each level: less and less, as in a decay.
MOVED = 0.3 * Q
RELATIVE = (1e-4, 0.01)
# What the mode had reached before its first level: a joint with memory goes by it.
LARGEST = 80.0


def chain(**values):
    return ij.three_mass(zeta=ZETA_0).with_joints({"J1": ij.Iwan4(**(TRUTH | values))})


GUESS = chain(F_S=9.0, chi=-0.3, beta=3.0)
OPTIONS = {"modes": [MODE], "fixed": {"J1.K_T": TRUTH["K_T"]}, "starts": 16}


@pytest.fixture(scope="module")
def curves():
    """The mode while the other moves, by averages twice as long and sliders twice as fine."""
    moving = ij.coupled_modes(chain(), np.stack([Q, MOVED], 1), ZETA_0, modes=[MODE, OTHER])
    f, zeta = np.asarray(moving.frequency)[:, 0], np.asarray(moving.damping)[:, 0]
    f_std, zeta_std = RELATIVE[0] * f, RELATIVE[1] * zeta
    return ij.ModalCurves(Q, f, zeta, frequency_std=f_std, damping_std=zeta_std, largest=LARGEST)


def test_the_joint_comes_back_from_a_mode_that_another_disturbs(curves, tmp_path):
    alone = fit(GUESS, curves, **OPTIONS)
    # The mode taken alone follows neither curve, and its joint is another one.
    assert alone.misfit > 4.0
    assert alone.coupling is None
    assert abs(alone.values["J1.chi"] - TRUTH["chi"]) > 0.1
    found = fit(GUESS, curves, beside=[{OTHER: MOVED}], **OPTIONS)
    assert found.converged
    assert found.misfit < 1.0
    for name in ("F_S", "chi", "beta"):
        assert abs(found.values[f"J1.{name}"] / TRUTH[name] - 1.0) < 0.05
        off = found.values[f"J1.{name}"] - TRUTH[name]
        assert abs(off) < 3.0 * found.std[f"J1.{name}"]
    assert "is without what mode 2 did to it" in found.summary()
    (coupling,) = found.coupling
    assert (coupling.mode, coupling.modes) == (MODE, (OTHER,))
    assert ij.FitSolution.load(found.save(tmp_path / "fit.npz")).summary() == found.summary()
    # What was taken off and what is left make the curve that was measured.
    (used,) = found.measured
    assert float(used.largest) == LARGEST
    np.testing.assert_allclose(used.frequency + coupling.frequency, curves.frequency, rtol=1e-12)
    np.testing.assert_allclose(used.damping + coupling.damping, curves.damping, rtol=1e-9)


def test_with_all_others_at_rest_nothing_is_taken_off(curves):
    plain = fit(GUESS, curves, most_probable=True, **OPTIONS)
    for beside in ([None], [{OTHER: 0.0 * Q}]):
        found = fit(GUESS, curves, beside=beside, **OPTIONS)
        assert found.values == pytest.approx(plain.values, rel=1e-6)
        assert not np.any(found.coupling[0].damping)
        assert "is without what" not in found.summary()


@pytest.mark.parametrize(
    ("beside", "told"),
    [
        ([], "beside is for 0 curve.s.; expected 1"),
        ([{MODE: Q}], "names mode 1, which the curve is of"),
        ([{OTHER: Q[:-1]}], "expected 16 amplitudes"),
        ([{OTHER: -Q}], "none negative"),
        ([{OTHER: np.full(16, np.nan)}], r"beside\[0\]\[2\]"),
        ([{7: Q}], "mode 7 does not exist"),
    ],
)
def test_what_does_not_match_is_refused(curves, beside, told):
    with pytest.raises(InputError, match=told):
        fit(GUESS, curves, beside=beside, **OPTIONS)


def test_one_oscillator_has_no_modes_beside(curves):
    with pytest.raises(InputError, match="beside belong to a JointedStructure"):
        fit("iwan4", curves.scaled(1.0, "displacement"), beside=[{OTHER: MOVED}])


def test_curves_that_others_rule_are_refused_with_what_to_do(curves):
    """Damping that no joint of this chain makes leaves a parameter to drift."""
    wrong = ij.ModalCurves(
        Q,
        curves.frequency,
        1e3 * np.asarray(curves.damping),
        frequency_std=curves.frequency_std,
        damping_std=1e3 * np.asarray(curves.damping_std),
    )
    with pytest.raises(InputError, match=r"do not hold .*fit the recordings"):
        fit(GUESS, wrong, beside=[{OTHER: MOVED}], **OPTIONS)
