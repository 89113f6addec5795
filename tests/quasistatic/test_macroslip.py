"""Every level converges, from the first slider to all joints sliding."""

import numpy as np
import pytest

import iwanjax as ij

SETS = 512
# Range of phi_max in units of the deflection that the stuck joint has at the highest level.
REGIMES = {
    "onset": (0.5, 2.0),
    "one joint": (0.1, 2.0),
    "some joints": (0.03, 0.5),
    "most joints": (0.01, 0.1),
    "all joints": (1e-4, 1e-2),
}


def lap_joint() -> tuple[ij.LinearStructure, np.ndarray]:
    """Two free chains of 12 masses held together by weak springs and five joints."""
    n = 12
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    rows = np.zeros((5, 2 * n))
    for j in range(5):
        rows[j, n - 5 + j], rows[j, n + j] = -1.0, 1.0
    whole = np.zeros((2 * n, 2 * n))
    whole[:n, :n], whole[n:, n:] = K, K
    return ij.LinearStructure(np.eye(2 * n), None, whole + 0.05 * rows.T @ rows), rows


LONG = ("most joints", "all joints")


@pytest.mark.parametrize(
    "regime",
    [pytest.param(r, marks=pytest.mark.long) if r in LONG else r for r in REGIMES],
)
def test_all_levels_converge_to_1e_9(regime):
    structure, rows = lap_joint()
    stiff = ij.LinearSpring(k=1.0)
    stuck = ij.JointedStructure(structure, {f"J{j}": (rows[j], stiff) for j in range(5)})
    levels, modes = np.geomspace(1e-3, 1.0, 50), [0, 1, 2]
    stroke = np.abs(np.asarray(ij.qsma(stuck, modes, levels).deflection[:, -1])).max(axis=0)
    rng = np.random.default_rng(11)
    low, high = REGIMES[regime]
    joints = {}
    for j in range(5):
        chi, rho = rng.uniform(-0.99, -0.01, SETS), np.exp(rng.uniform(np.log(0.1), 0.0, SETS))
        phi = stroke[j] * np.exp(rng.uniform(np.log(low), np.log(high), SETS))
        F_S = phi * (1 - rho / (chi + 2))
        joints[f"J{j}"] = ij.Iwan4(F_S=F_S, K_T=np.ones(SETS), chi=chi, beta=1 / rho - 1)
    system = stuck.with_joints(joints)
    solution = ij.qsma(system, modes, levels)
    assert bool(solution.converged.all())
    assert float(solution.error.max()) < 1e-9
    phi = np.stack([np.asarray(joint.phi_max) for joint in joints.values()], axis=-1)
    sliding = np.abs(np.asarray(solution.deflection)) > phi[:, None, None, :]
    assert sliding.any()
    # And the equations are met, worked out again from the full matrices.
    K, M = np.asarray(structure.K), np.asarray(structure.M)
    Phi = np.asarray(system.basis.Phi)
    for i in (0, 100, 511):
        d = np.asarray(solution.deflection[i, 1])
        f = np.stack(
            [
                np.asarray(
                    ij.Iwan4(
                        F_S=joint.F_S[i], K_T=1.0, chi=joint.chi[i], beta=joint.beta[i]
                    ).backbone(d[:, j])
                )
                for j, joint in enumerate(joints.values())
            ],
            axis=-1,
        )
        load = levels[:, None] * (M @ Phi[:, 1]) - f @ rows
        # K u = load without rigid-body motion, which the elastic modes of K_0 exclude.
        K0 = K + rows.T @ rows
        u = np.linalg.pinv(K0, rcond=1e-12) @ (load + d @ rows).T
        np.testing.assert_allclose((rows @ u).T, d, atol=1e-8 * np.max(np.abs(d)))
        q = Phi[:, 1] @ M @ u
        np.testing.assert_allclose(solution.q[i, 1], q, rtol=1e-8)
