"""The hits in configs/modal_ringdown come from the script beside them."""

import json

import numpy as np
import pytest
from modal_ringdown import FOLDER, make_hits

import iwanjax as ij

# Long enough for macroslip, both modes and the noise.
SECONDS = 0.2


@pytest.fixture(scope="module")
def truth():
    return json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def again():
    return make_hits.simulate(SECONDS)


@pytest.mark.parametrize("i", range(4))
def test_a_hit_is_what_its_script_makes(again, i):
    time, response, _ = again
    with np.load(FOLDER / f"hit{i + 1}.npz") as stored:
        assert sorted(stored) == ["response", "time"]
        n = stored["time"].size
        assert stored["response"].shape == (n, 1)
        assert (stored["time"].dtype, stored["response"].dtype) == (np.float64, np.float32)
        np.testing.assert_array_equal(stored["time"], np.arange(n) / make_hits.SAMPLING_RATE)
        # Another BLAS may round a sample to the next number of single precision.
        np.testing.assert_array_max_ulp(stored["response"][: time.size, 0], response[:, i], 2)
        # The rest is not made again, but it decays on and its noise is there.
        assert n == round(make_hits.DURATION * make_hits.SAMPLING_RATE)
        late = stored["response"][-round(make_hits.SAMPLING_RATE) :, 0]
        assert make_hits.noise_deviation()[i] < np.std(late) < 0.02 * np.max(response[:, i])


def test_the_truth_is_the_scripts_and_the_joints(truth, again):
    made = make_hits.truth(again[2])
    assert {k: v for k, v in truth.items() if k != "hits"} == {
        k: v for k, v in made.items() if k != "hits"
    }
    for name, hit in truth["hits"].items():
        assert hit["use"] == made["hits"][name]["use"]
        for key in set(hit) - {"use", "smallest_amplitude"}:
            assert hit[key] == pytest.approx(made["hits"][name][key], rel=1e-9)
    joint = ij.Iwan4(**{k: truth["parameters"][k] for k in ("F_S", "K_T", "chi", "beta")})
    assert float(joint.phi_max) == pytest.approx(truth["parameters"]["phi_max"], rel=1e-12)


def test_the_hits_reach_from_macroslip_to_the_linear_range(truth):
    phi_max = truth["parameters"]["phi_max"]
    largest = [hit["largest_displacement"] / phi_max for hit in truth["hits"].values()]
    smallest = [hit["smallest_amplitude"] / phi_max for hit in truth["hits"].values()]
    assert largest == pytest.approx([2.5, 1.2, 0.4, 1.6], rel=0.03)
    assert max(smallest) < 0.02
    assert [hit["use"] for hit in truth["hits"].values()] == ["fit"] * 3 + ["hold_out"]


def test_the_bank_of_sliders_is_the_joint():
    """Virgin curve and loss against the closed forms, as exactly as an interval is narrow."""
    truth = make_hits.TRUTH
    joint = ij.Iwan4(F_S=truth.F_S, K_T=truth.K_T, chi=truth.chi, beta=truth.beta)
    phi, k = make_hits.sliders(truth)
    assert k.sum() == pytest.approx(truth.K_T, rel=1e-12)
    assert phi @ k == pytest.approx(truth.F_S, rel=1e-12)
    d = truth.phi_max * np.array([0.01, 0.1, 0.5, 0.99, 1.5])
    # A slider in place of its interval errs within it only, by no more than this.
    off = 0.25 * np.max(k[:-1] * np.diff(phi))
    force = np.minimum(d[:, None], phi) @ k
    np.testing.assert_allclose(force, joint.backbone(d), rtol=0, atol=off)
    loss = 4.0 * np.maximum(d[:, None] - phi, 0.0) @ (k * phi)
    np.testing.assert_allclose(loss, joint.dissipation(d), rtol=0, atol=4.0 * truth.phi_max * off)
    # Of the whole that is little.
    assert off < 1e-3 * truth.F_S


def test_the_data_are_small_and_stand_alone():
    assert sum(file.stat().st_size for file in FOLDER.glob("*.npz")) < 1_000_000
    source = (FOLDER / "make_hits.py").read_text(encoding="utf-8")
    assert "import iwanjax" not in source
    assert "from iwanjax" not in source
