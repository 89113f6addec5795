"""From a jointed structure to the few equations that its slipping joints need."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from iwanjax.joints import AbstractJoint
from iwanjax.quasistatic.equilibrium import Condensed
from iwanjax.structures.jointed import ModalBasis
from iwanjax.structures.modification import ModifiedModes, modified_modes


class Reduction(NamedTuple):
    """One mode's load on the joints that slip, and the way back to all joints.

    Attributes
    ----------
    mode : ModifiedModes
        Frequency and joint deflections of the mode at low amplitude.
    system : Condensed
        Equations of the nonlinear joints.
    nonlinear : tuple of int
        Which joints ``system`` keeps.
    eliminated : list
        Steps that recover the deflections of the linear ones.
    """

    mode: ModifiedModes
    system: Condensed
    nonlinear: tuple[int, ...]
    eliminated: list[tuple[int, list[int], list[Array], Array]]

    def all_deflections(self, d: Sequence[Array], alpha: Array) -> list[Array]:
        """Deflections of all joints from those of the nonlinear ones, at load alpha."""
        known = dict(zip(self.nonlinear, d, strict=True))
        for i, others, row, load in reversed(self.eliminated):
            known[i] = alpha * load - sum(
                (a * known[j] for a, j in zip(row, others, strict=True)), jnp.zeros(())
            )
        return [known[i] for i in sorted(known)]


def reduce_to_joints(
    basis: ModalBasis, joints: Sequence[AbstractJoint], modes: Int[Array, " K"], fixed: bool
) -> Reduction:
    r"""Condense statics under the load alpha M phi_r (thesis Eqs. 3.7, 3.13).

    With G = P Lambda^-1 P^T the flexibility at the joints, the structure without joints
    has C = G^-1 - diag(K_T) there, whatever the K_T; only the load
    c = (C + diag(K_T)) B^T phi / omega_0^2 follows the modified mode. Linear springs
    are eliminated, so that they may vary in a batch at the cost of a few products.

    Parameters
    ----------
    basis : ModalBasis
        Reference modes.
    joints : m joints
        Parameters with the batch on their only axis, or scalars.
    modes : (K,) array of int
        The K modes whose shapes load the structure.
    fixed : bool
        Whether the joints have the reference's stiffness, so that its modes hold.

    Returns
    -------
    Reduction
        Entries broadcast against (K, S).
    """
    stiffness = [joint.initial_stiffness for joint in joints]
    mode = _low_amplitude_modes(basis, stiffness, modes, fixed)
    kept = list(basis.independent)
    G = (basis.P / basis.omega2) @ basis.P.T
    inverse = jnp.linalg.inv(G[np.ix_(kept, kept)])
    inverse = 0.5 * (inverse + inverse.T)
    if len(kept) < len(joints):
        T = G[:, kept] @ inverse
        C0 = inverse - T.T @ (basis.stiffness[:, None] * T)
        C = [[C0[i, j] for j in range(len(kept))] for i in range(len(kept))]
        pull = [k * y for k, y in zip(stiffness, mode.y, strict=True)]
        y_kept = [mode.y[i] for i in kept]
        c = [
            (
                sum((C[i][j] * y_kept[j] for j in range(len(kept))), jnp.zeros(()))
                + sum((T[k, i] * pull[k] for k in range(len(joints))), jnp.zeros(()))
            )
            / mode.lam
            for i in range(len(kept))
        ]
        rows = [[T[k, i] for i in range(len(kept))] for k in range(len(joints))]
        return Reduction(mode, Condensed(C, c, rows), tuple(range(len(joints))), [])
    C0 = inverse - jnp.diag(basis.stiffness)
    m = len(joints)
    C = [[C0[i, j] for j in range(m)] for i in range(m)]
    c = [
        (sum((C[i][j] * mode.y[j] for j in range(m)), jnp.zeros(())) + stiffness[i] * mode.y[i])
        / mode.lam
        for i in range(m)
    ]
    return _without_linear(mode, C, c, joints)


def _without_linear(
    mode: ModifiedModes, C: list[list[Array]], c: list[Array], joints: Sequence[AbstractJoint]
) -> Reduction:
    """Eliminate the elements whose force is proportional to their deflection."""
    remaining = list(range(len(joints)))
    eliminated = []
    for i in [i for i, joint in enumerate(joints) if joint.linear]:
        if len(remaining) == 1:  # nothing slips: keep one equation to solve
            break
        pivot = C[i][i] + joints[i].initial_stiffness
        others = [j for j in remaining if j != i]
        row = [C[i][j] / pivot for j in others]
        eliminated.append((i, others, row, c[i] / pivot))
        C = [list(entries) for entries in C]
        c = list(c)
        for a, j in zip(row, others, strict=True):
            c[j] = c[j] - a * c[i]
            for k in others:
                C[j][k] = C[j][k] - a * C[i][k]
        remaining = others
    system = Condensed(
        [[C[i][j] for j in remaining] for i in remaining], [c[i] for i in remaining], None
    )
    return Reduction(mode, system, tuple(remaining), eliminated)


def _low_amplitude_modes(
    basis: ModalBasis, stiffness: Sequence[Array], modes: Int[Array, " K"], fixed: bool
) -> ModifiedModes:
    """The K modes with the joints stuck, stacked on an axis before the batch."""
    if fixed:
        lam = basis.omega2[modes][:, None]
        return ModifiedModes(lam, [row[modes][:, None] for row in basis.P], jnp.ones_like(lam))
    change = [k - k_0 for k, k_0 in zip(stiffness, basis.stiffness, strict=True)]
    return modified_modes(basis, modes, change)
