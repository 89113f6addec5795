"""Ground motion as an input of studies: what files may say, simulations and a diagnosis."""

import numpy as np
import pytest
import scipy.integrate
import yaml
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.errors import InputError

M = np.diag([2.0, 1.0])
K = np.array([[9e4, -4e4], [-4e4, 4e4]])
C = 3e-5 * K
RATE, N, CUBIC = 512.0, 500, 3e7
T = np.arange(N) / RATE


def driven(level, seed):
    """Absolute accelerations, and the ground's; integrated in absolute coordinates."""
    random = np.random.default_rng(seed)
    f = np.arange(8.0, 60.0, 0.9)
    phase = 2 * np.pi * random.random(f.size)

    def shaken(t):
        return (
            level
            * np.tanh(30.0 * t)
            * np.sqrt(2.0 / f.size)
            * np.cos(2 * np.pi * f * t + phase).sum()
        )

    def masses(z):
        d, v = z[:2] - z[4], z[2:4] - z[5]
        return -(K @ d + C @ v + np.array([0.0, CUBIC * d[1] ** 3])) / np.diag(M)

    found = scipy.integrate.solve_ivp(
        lambda t, z: np.concatenate([z[2:4], masses(z), [z[5], shaken(t)]]),
        (0.0, T[-1]),
        np.zeros(6),
        method="DOP853",
        t_eval=T,
        rtol=1e-8,
        atol=1e-12,
    ).y
    response = np.array([masses(z) for z in found.T])
    response += 2e-3 * np.std(response) * random.standard_normal(response.shape)
    response[:, 0] += 0.03 * np.std(response)
    return response, np.array([[shaken(t)] for t in T])


def write(folder, inputs):
    np.savez(
        folder / "model.npz",
        **{"M": M, "C": C, "K": K},
        **{"row_labels": ["m1-ground", "m2-ground"], "rows": np.eye(2)},
        **{"sensor_labels": ["a1", "a2"], "sensor_rows": np.eye(2)},
        **{"input_labels": list(inputs), "input_rows": np.stack(list(inputs.values()))},
    )


def study(folder, **sections):
    told = {"name": "shaken", "model": {"file": "model.npz"}, **sections}
    (folder / "study.yaml").write_text(yaml.safe_dump(told))
    return ij.load_study(folder / "study.yaml")


def entry(file, use="fit", quantity="acceleration"):
    return {
        "file": file,
        "use": use,
        "sampling_rate": RATE,
        "response": {"array": "response", "sensors": ["a1", "a2"], "quantity": quantity},
        "force": {"array": "force", "inputs": ["base"]},
    }


def test_a_model_without_base_is_told_what_its_row_is(tmp_path):
    write(tmp_path, {"m1": np.array([1.0, 0.0])})
    np.savez(tmp_path / "rec.npz", response=np.ones((N, 2)), force=np.ones((N, 1)))
    wanted = r"study.yaml:\d+: recordings\[0\].force.inputs\[0\]: .*no input 'base'.*-M r"
    with pytest.raises(InputError, match=wanted):
        study(tmp_path, recordings=[entry("rec.npz")])


def test_simulated_accelerations_are_absolute(tmp_path):
    """Far below its first mode a structure moves with the ground."""
    write(tmp_path, {"m1": np.array([1.0, 0.0]), "base": -np.diag(M)})
    slow = 3.0 * np.sin(2 * np.pi * 0.2 * np.arange(2000) / 200.0) ** 2
    np.savez(tmp_path / "ground.npz", force=slow[:, None], response=slow[:, None])
    excitation = {
        "type": "recording",
        "file": "ground.npz",
        "array": "force",
        "input": ["base"],
        "sampling_rate": 200.0,
    }
    cases = [{"name": "slow", "every": 2, "excitation": excitation}]
    found = study(tmp_path, simulate=cases).simulate()["slow"]
    assert isinstance(found, ij.SimulatedResponse)
    absolute = np.asarray(found.acceleration)
    assert absolute.shape == (1000, 2)
    assert_allclose(absolute, np.stack([slow[::2]] * 2, axis=1), atol=0.05)
    assert np.abs(found.displacement).max() < 1e-3  # relative to the ground


@pytest.mark.long
def test_a_spring_is_found_on_a_shaken_ground(tmp_path):
    write(tmp_path, {"base": -np.diag(M)})
    uses = [("fit", 2.0), ("fit", 20.0), ("hold_out", 15.0)]
    for i, (_, level) in enumerate(uses):
        response, a = driven(level, i)
        np.savez(tmp_path / f"{i}.npz", response=response, force=a)
    entries = [entry(f"{i}.npz", use) for i, (use, _) in enumerate(uses)]
    names = ["cubic_stiffness", "viscous_damping", "stiffness_error"]
    verdict = study(tmp_path, recordings=entries, hypotheses=names).diagnose()["shaken"]
    assert (verdict.what[0].kind.name, verdict.what[0].where) == ("cubic_stiffness", "m2-ground")
    assert verdict.what[0].parameters[0].value == pytest.approx(CUBIC, rel=0.05)
    assert any("offsets were taken off: a1 +" in line for line in verdict.warnings)
    assert verdict.after.hold_out < 1.5 * verdict.noise_floor.hold_out
