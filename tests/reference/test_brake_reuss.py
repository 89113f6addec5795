"""Numbers of the reduced Brake-Reuss beam that an independent computation left (file not here)."""

import numpy as np
import pytest

import iwanjax as ij

pytestmark = pytest.mark.reference

# Table 3.5: chi, phi_max (mm), R, K_T (N/mm) of joints 1 = 5, 2 = 4, 3.
TABLE_3_5 = [
    (-0.418, 8.789e-4, 7.947e6, 5.7609e5),
    (-0.639, 4.346e-4, 5.199e5, 1.0865e5),
    (-0.271, 6.612e-4, 4.769e7, 3.7345e5),
]


@pytest.fixture(scope="module")
def beam(reference_data):
    data = np.load(reference_data / "reference" / "brb_reduced.npz")
    joints = [
        ij.Iwan4.from_distribution(
            R=R, S=K_T - R * phi_max ** (chi + 1) / (chi + 1), chi=chi, phi_max=phi_max
        )
        for chi, phi_max, R, K_T in TABLE_3_5
    ]
    places = [joints[0], joints[1], joints[2], joints[1], joints[0]]
    structure = ij.LinearStructure(data["M"], None, data["K"])
    system = ij.JointedStructure(
        structure, {f"J{i + 1}": (data["B"][i], joint) for i, joint in enumerate(places)}
    )
    return data, system


def test_modes(beam):
    data, system = beam
    np.testing.assert_allclose(system.modes().omega, data["w"], rtol=1e-9)
    assert float(system.modes().frequency[1]) == pytest.approx(175.339, abs=5e-4)


def test_first_bending(beam):
    data, system = beam
    solution = ij.qsma(system, 1, [179.51, 1995.3], zeta0=5.37e-4)
    shift = solution.curves.frequency - system.modes().frequency[1]
    np.testing.assert_allclose(shift, [-0.3865, -1.8394], rtol=1e-4)
    np.testing.assert_allclose(solution.curves.damping, [1.16853e-3, 4.05132e-3], rtol=1e-4)
    # phi_s holds point s in modal coordinates.
    tip = solution.curves.scaled(abs(data["phi_s"][1]), "displacement", "mm")
    np.testing.assert_allclose(tip.amplitude, [4.676e-3, 5.285e-2], rtol=1e-4)


@pytest.mark.parametrize("r", [1, 2, 6])
def test_sum_of_dissipations_is_the_work_integral(beam, r):
    _, system = beam
    alpha = np.geomspace(10**1.25, 10**3.3, 50)
    joints = ij.qsma(system, r, alpha)
    work = ij.qsma(system, r, alpha, dissipation="work")
    np.testing.assert_allclose(work.dissipation, joints.dissipation, rtol=1e-6)
