"""A hit that moves two modes at once: the joint by their curves, each alone and both together."""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.errors import InputError

TRUTH = {"F_S": 10.0, "K_T": 1.0, "chi": -0.5, "beta": 5.0}
DT, SAMPLES, MODES = 0.1, 24_001, (1, 2)
SENSORS = {f"m{i + 1}": row for i, row in enumerate(np.eye(3))}


def study_of(share, peak, **fit):
    """A hit in the shape of one mode and a share of the next, simulated with 400 sliders."""
    chain = ij.three_mass(zeta=1e-4)
    omega, Phi = (np.asarray(x) for x in chain.modes())
    row = np.asarray(chain.structure.M) @ (Phi[:, MODES[0]] + share * Phi[:, MODES[1]])
    force = np.asarray(ij.half_sine(DT * np.arange(SAMPLES), peak, float(omega[2])))
    found = ij.simulate(
        chain,
        force[:, None],
        DT,
        inputs=row[None],
        sensors=np.eye(3),
        keep=("acceleration",),
        sliders=400,
    )
    seen = np.asarray(found.acceleration)
    seen = seen + 1e-4 * np.abs(seen).max() * np.random.default_rng(0).standard_normal(seen.shape)
    recording = ij.as_recording(
        seen,
        force[:, None],
        sampling_rate=1.0 / DT,
        sensors=list(SENSORS),
        inputs=["p"],
        quantity="acceleration",
        name="hit",
    )
    guess = chain.with_joints({"J1": ij.Iwan4(**(TRUTH | {"F_S": 8.0, "chi": -0.3, "beta": 3.0}))})
    return ij.Study(
        guess,
        [ij.Measurement(recording, mode=MODES[0])],
        sensors=SENSORS,
        inputs={"p": row},
        modes=MODES,
        fixed={"J1.K_T": TRUTH["K_T"]},
        fit={"starts": 8, **fit},
    )


def test_the_joint_of_a_hit_that_moves_two_modes():
    alone = study_of(0.5, 300.0).fit().only.solution
    assert abs(alone.values["J1.F_S"] / TRUTH["F_S"] - 1.0) > 0.05
    together = study_of(0.5, 300.0, coupled=True).fit().only.solution
    assert together.converged
    for name, true in TRUTH.items():
        assert abs(together.values[f"J1.{name}"] / true - 1.0) < 0.02
    # The second mode has no curve of its own here; how far it moves is seen all the same.
    (coupling,) = together.coupling
    assert coupling.modes == (MODES[1],)
    assert np.all(np.diff(coupling.amplitude[:, 0]) < 0.0)


@pytest.mark.long
def test_where_only_their_sum_slips_the_strength_is_not_known():
    """Alone it would be 6.9 +- 0.09, where 10 is true."""
    alone = study_of(1.0, 100.0).fit().only.solution
    assert abs(alone.values["J1.F_S"] - TRUTH["F_S"]) > 10.0 * alone.std["J1.F_S"]
    together = study_of(1.0, 100.0, coupled=True).fit().only.solution
    for name, true in TRUTH.items():
        off = abs(together.values[f"J1.{name}"] - true)
        assert off <= 2.0 * together.std[f"J1.{name}"]


def test_curves_without_times_and_modes_on_their_own_are_refused():
    q = np.geomspace(1.0, 10.0, 8)
    curves = ij.ModalCurves(
        q, 0.19 - 1e-4 * q, 1e-3 + 0.0 * q, frequency_std=1e-5 + 0.0 * q, damping_std=1e-5 + 0.0 * q
    )
    given = [ij.Measurement(curves, mode=1)]
    with pytest.raises(InputError, match="curves without a time history"):
        ij.Study(ij.three_mass(zeta=1e-4), given, modes=[1], fit={"coupled": True}).fit()
