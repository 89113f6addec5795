"""A jointed structure in the coordinates it is integrated in: modes about a reference stiffness."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.structures import JointedStructure
from iwanjax.types import ArrayLike, as_real, is_traced

# Off-diagonal modal damping up to this share of the diagonal is none.
_CLASSICAL = 1e-9
# Squared frequencies within this share of the largest are those of rigid-body modes.
_RIGID = 1e-13


class ModalCoordinates(eqx.Module):
    r"""Modes q with what joints, inputs and sensors see of them.

    .. math:: \ddot q + C\dot q + \omega^2 q = W f + P^T g, \qquad
              d = P q + R_{dg}\,g + R_{df} f, \qquad y = Y q + R_{yg}\,g + R_{yf} f

    with the pseudo-forces g = K_ref d - F(d) of the joints, so that the left side holds their
    reference stiffness; R are the flexibilities of modes that were left out.

    Attributes
    ----------
    omega2 : (modes,) array
        Squared circular frequencies.
    C : (modes,) or (modes, modes) array
        Modal damping; a matrix where it couples the modes.
    Phi : (n, modes) array
        Mass-normalised shapes, rigid-body modes among them.
    P : (joints, modes) array
        Joint deflections.
    W : (modes, inputs) array
        Modal forces.
    Y : (sensors, modes) array
        What the sensors see.
    stiffness : (joints,) array
        Reference stiffness of the joints.
    R_dg, R_df, R_yg, R_yf : arrays
        Residual flexibilities, of zeros where all modes are kept.
    """

    omega2: Float[Array, " modes"]
    C: Float[Array, "*modes"]
    Phi: Float[Array, "n modes"]
    P: Float[Array, "joints modes"]
    W: Float[Array, "modes inputs"]
    Y: Float[Array, "sensors modes"]
    stiffness: Float[Array, " joints"]
    R_dg: Float[Array, "joints joints"]
    R_df: Float[Array, "joints inputs"]
    R_yg: Float[Array, "sensors joints"]
    R_yf: Float[Array, "sensors inputs"]


def modal_coordinates(
    structure: JointedStructure, inputs: Array, sensors: Array, modes: int | None
) -> ModalCoordinates:
    """The coordinates of a structure, differentiable with respect to its matrices.

    Derivatives with respect to M and K do not exist where natural frequencies coincide.

    Parameters
    ----------
    structure : JointedStructure
        Its reference stiffness is that of its own modes.
    inputs : (inputs, n) array
        Rows along which forces act.
    sensors : (sensors, n) array
        Rows of the outputs.
    modes : int or None
        Elastic modes to keep, the lowest first; the others act by their flexibility.

    Raises
    ------
    InputError
        For more modes than there are.
    """
    linear, B = structure.structure, structure.rows
    stiffness = structure.basis.stiffness
    omega2, Phi, damping = _modes(linear.M, linear.C, linear.K, B, stiffness)
    if not is_traced(damping) and _classical(np.asarray(damping)):
        damping = jnp.diagonal(damping)
    kept = omega2.shape[0]
    if modes is not None:
        if is_traced(omega2):
            raise InputError("simulate: modes= cannot be chosen while the matrices are traced")
        rigid = int(np.sum(np.asarray(omega2) == 0.0))
        if not 1 <= modes <= kept - rigid:
            raise InputError(f"modes = {modes}; expected 1 to {kept - rigid} elastic modes")
        kept = rigid + modes
    return _coordinates(omega2, damping, Phi, B, inputs, sensors, stiffness, kept)


@partial(jax.jit, static_argnums=7)
def _coordinates(
    omega2: Array,
    damping: Array,
    Phi: Array,
    B: Array,
    inputs: Array,
    sensors: Array,
    stiffness: Array,
    kept: int,
) -> ModalCoordinates:
    """What acts on the modes that are kept, and what the others add."""
    P, W, Y = B @ Phi, Phi.T @ inputs.T, sensors @ Phi
    left = slice(kept, None)
    flexibility = 1.0 / omega2[left]
    P_left, Y_left = P[:, left] * flexibility, Y[:, left] * flexibility
    return ModalCoordinates(
        omega2=omega2[:kept],
        C=damping[(slice(kept),) * damping.ndim],
        Phi=Phi[:, :kept],
        P=P[:, :kept],
        W=W[:kept],
        Y=Y[:, :kept],
        stiffness=stiffness,
        R_dg=P_left @ P[:, left].T,
        R_df=P_left @ W[left],
        R_yg=Y_left @ P[:, left].T,
        R_yf=Y_left @ W[left],
    )


@jax.jit
def _modes(M: Array, C: Array, K: Array, B: Array, stiffness: Array) -> tuple[Array, Array, Array]:
    """All modes, those of rigid bodies with frequency zero, and the damping between them."""
    K = K + (B.T * stiffness) @ B
    lower = jnp.linalg.cholesky(M)
    half = jax.lax.linalg.triangular_solve(lower, K, left_side=True, lower=True)
    whole = jax.lax.linalg.triangular_solve(lower, half.T, left_side=True, lower=True)
    values, vectors = jnp.linalg.eigh(0.5 * (whole + whole.T))
    Phi = jax.lax.linalg.triangular_solve(
        lower, vectors, left_side=True, lower=True, transpose_a=True
    )
    n = values.shape[0]
    omega2 = jnp.where(jnp.abs(values) < _RIGID * n * values[-1], 0.0, values)
    return omega2, Phi, Phi.T @ C @ Phi


def _classical(damping: np.ndarray) -> bool:
    """Whether modal damping does not couple modes."""
    diagonal = np.diagonal(damping)
    coupled = np.max(np.abs(damping - np.diag(diagonal)))
    return bool(coupled <= _CLASSICAL * np.max(np.abs(diagonal)))


def rows_of(rows: ArrayLike, name: str, n: int) -> Array:
    """Rows of a structure of n coordinates, (rows, n); a single one may come without an axis.

    Raises
    ------
    InputError
        For another shape.
    """
    checked = jnp.atleast_2d(as_real(rows, name))
    if checked.ndim != 2 or checked.shape[1] != n:
        raise InputError(f"{name} has shape {checked.shape}; expected (rows, {n}) like M")
    return checked


def vector_of(values: ArrayLike, name: str, n: int) -> Array:
    """A value for each coordinate, (n,).

    Raises
    ------
    InputError
        For another shape.
    """
    checked = as_real(values, name)
    if checked.shape != (n,):
        raise InputError(f"{name} has shape {checked.shape}; expected ({n},) like M")
    return checked


def force_of(force: ArrayLike, inputs: int) -> Array:
    """Force histories, (N, inputs) or (batch, N, inputs); of one input also (N,).

    Raises
    ------
    InputError
        For another shape, or a single sample.
    """
    f = as_real(force, "force")
    if f.ndim == 1 and inputs == 1:
        f = f[:, None]
    if f.ndim not in (2, 3) or f.shape[-1] != inputs:
        raise InputError(
            f"force has shape {f.shape}; expected (N, {inputs}), a column for each "
            "input or coordinate, or a batch of such"
        )
    if f.shape[-2] < 2:
        raise InputError(f"force has {f.shape[-2]} sample(s); expected at least 2")
    return f
