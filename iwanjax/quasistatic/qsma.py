"""Quasi-static modal analysis: frequency and damping against amplitude from static solves."""

import warnings
from collections.abc import Sequence
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint, PowerLawDamping
from iwanjax.quasistatic.levels import Background, Levels, Task, solve_levels
from iwanjax.quasistatic.shape import updated_shapes
from iwanjax.quasistatic.work import work_dissipation, work_path
from iwanjax.results import AbstractResult, Result
from iwanjax.structures import JointedStructure, modal_assurance
from iwanjax.types import ArrayLike, as_real, is_traced, require_double_precision


class QsmaSolution(AbstractResult, eqx.Module):
    """Result of :func:`qsma`.

    Arrays have shape (..., levels), with leading axes for the batch of parameter sets and
    for the modes where several were asked for.

    Attributes
    ----------
    curves : ModalCurves
        Modal displacement, frequency in Hz and damping ratio; NaN where not converged.
    alpha : (..., levels) array
        Load levels.
    q : (..., levels) array
        Modal displacement amplitude phi^T M u.
    dissipation : (..., levels) array
        Energy per cycle lost in the joints.
    deflection : (..., levels, joints) array or None
        Deflection of each joint at the tip of the cycle, signed, in the order of
        ``structure.labels``.
    result : (..., levels) int array
        A :class:`~iwanjax.results.Result` code for each level.
    error : (..., levels) array
        Size of the last Newton step relative to the deflections.
    structure : JointedStructure
        What was analysed.
    modes : tuple of int
        The modes that were analysed.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> solution = ij.qsma(ij.three_mass(), 0, np.geomspace(1e-2, 1.0, 5), 1e-4)
    >>> solution.deflection.shape  # levels, joints
    (5, 1)
    >>> np.allclose(solution.alpha / solution.q, (2 * np.pi * solution.curves.frequency) ** 2)
    True
    """

    curves: ModalCurves
    alpha: Float[Array, "*batch levels"]
    q: Float[Array, "*batch levels"]
    dissipation: Float[Array, "*batch levels"]
    deflection: Float[Array, "*batch levels joints"] | None
    result: Int[Array, "*batch levels"]
    error: Float[Array, "*batch levels"]
    structure: JointedStructure
    modes: tuple[int, ...] = eqx.field(static=True)

    _shown = ("modes", "alpha", "curves", "dissipation", "deflection", "converged")

    @property
    def converged(self) -> Array:
        """Which levels are solved, (..., levels) of bool."""
        return self.result == Result.CONVERGED

    @property
    def participation(self) -> Float[Array, "*batch levels modes"]:
        """Share q_k/q_r of every elastic mode k in the static shape (thesis Sec. 3.3.3).

        The check on the single-mode assumption: a share of another mode above a few
        hundredths says that the mode shape changes with amplitude.

        Returns
        -------
        (..., levels, modes) array
            Signed; 1 for the loaded mode itself.

        Raises
        ------
        InputError
            Without deflections, or when the parameter sets differ in stiffness from the
            structure's reference: each would have modes of its own.
        """
        joints = self.structure.elements
        basis = self.structure.basis
        if self.deflection is None:
            raise InputError("participation needs the deflections: qsma(..., deflections=True)")
        if not _at_reference(self.structure):
            raise InputError(
                "participation: the joints' stiffness differs from the structure's reference, so "
                "that each set has its own modes; build a JointedStructure for the set of interest"
            )
        batch = _batch_shape(joints)
        extra = self.deflection.ndim - 1 - len(batch)
        slack = []
        for joint, d in zip(joints, jnp.moveaxis(self.deflection, -1, 0), strict=True):
            each = jax.tree.map(
                lambda leaf: leaf.reshape(*leaf.shape, *(1,) * extra) if leaf.ndim else leaf, joint
            )
            slack.append(each.initial_stiffness * d - each.law()(d)[0])
        modal = jnp.stack(slack, axis=-1) @ basis.P
        loaded = jnp.eye(basis.omega2.shape[0])[jnp.asarray(self.modes)][:, None, :]
        if self.alpha.ndim == len(batch) + 1:
            loaded = loaded[0]
        q = (self.alpha[..., None] * loaded + modal) / basis.omega2
        return q / self.q[..., None]


def qsma(
    structure: JointedStructure,
    mode: int | Sequence[int] | ArrayLike = 0,
    alpha: ArrayLike | None = None,
    zeta0: ArrayLike | PowerLawDamping | None = None,
    *,
    frequency: Literal["secant", "first_harmonic"] = "secant",
    dissipation: Literal["joints", "work"] = "joints",
    shape: Literal["linear", "updated"] = "linear",
    deflections: bool = True,
) -> QsmaSolution:
    r"""Quasi-static modal analysis (thesis Sec. 3.2; Lacayo and Allen 2019).

    The structure is loaded statically by the inertia of mode r,

    .. math:: K u + f_J(u) = \alpha\,M\varphi_r, \qquad q = \varphi_r^T M u,

    and Masing's rules turn the loading curve into the steady loop of each level:

    .. math:: \omega = \sqrt{\alpha/q}\ (3.17), \qquad
              \zeta = \frac{D}{2\pi\alpha q} + \zeta_0\ (3.20).

    Pure, jitted and differentiable in the joints' parameters and in alpha (implicitly:
    one small linear solve a level). Joints whose parameters are arrays are a batch.

    Parameters
    ----------
    structure : JointedStructure
        May float freely: rigid-body modes are out of its basis.
    mode : int, sequence of int, or (n,) array of float
        Index among the elastic modes, lowest first; several of them; or a shape, for
        which the mode with the highest modal assurance is taken.
    alpha : (levels,) or (modes, levels) array_like
        Load amplitudes, increasing, force/mass^(1/2).
    zeta0 : float, (modes,) array_like or PowerLawDamping, optional
        Background damping ratio; by default that of the structure's C.
    frequency : {"secant", "first_harmonic"}
        The secant of the modal loop (3.17), or the in-phase first harmonic of the joints'
        forces under sinusoidal deflection, which is what a Hilbert transform of a
        ring-down measures. In microslip the secant lies above it, by 0.05 to 0.08 % of
        frequency for the oscillator of Sec. 4.5.
    dissipation : {"joints", "work"}
        The sum of the joints' closed forms, or the work integral
        D = 8 int alpha dq - 4 alpha q of the modal curve, for any Masing joint. The
        thesis's (3.14) to (3.16) hold for uniform steps of q only.
    shape : {"linear", "updated"}
        Load in the linear mode shape, the other modes following statically; or in the
        shape that the deflection itself has at this level (after Festjens et al. 2013),
        for joints that slip so much that the shares of other modes are not small.
    deflections : bool
        Whether to keep the joints' deflections (memory, for large batches).

    Returns
    -------
    QsmaSolution
        Levels that did not converge hold NaN and a code in ``result`` that says why;
        outside a transformation a warning says so too.

    Raises
    ------
    InputError
        For a mode that does not exist, levels that are not positive and increasing,
        negative damping, parameter batches that do not match.
    PrecisionError
        When JAX computes in float32.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> solution = ij.qsma(ij.three_mass(), 0, np.geomspace(1e-2, 1.0, 5), 1e-4)
    >>> solution.curves.frequency.shape
    (5,)
    >>> bool(solution.curves.damping[-1] > solution.curves.damping[0] > 1e-4)
    True
    """
    require_double_precision("qsma")
    if not isinstance(structure, JointedStructure):
        raise InputError(
            f"qsma expects a JointedStructure, got {type(structure).__name__}; a structure "
            "without joints is linear: see LinearStructure.modes"
        )
    structure.require_joints("qsma")
    modes, single = _modes(structure, mode)
    levels = _load_levels(alpha, len(modes))
    joints = structure.elements
    batch = _batch_shape(joints)
    flat = tuple(
        jax.tree.map(
            lambda leaf: jnp.broadcast_to(leaf, batch).reshape(-1) if leaf.ndim else leaf, joint
        )
        for joint in joints
    )
    if dissipation == "work":
        path, wanted = work_path(levels)
    elif dissipation == "joints":
        path, wanted = levels, np.arange(levels.shape[1])
    else:
        raise InputError(f"dissipation={dissipation!r}: expected 'joints' or 'work'")
    if frequency not in ("secant", "first_harmonic"):
        raise InputError(f"frequency={frequency!r}: expected 'secant' or 'first_harmonic'")
    if shape not in ("linear", "updated"):
        raise InputError(f"shape={shape!r}: expected 'linear' or 'updated'")
    fixed = _at_reference(structure)
    if shape == "updated" and not (fixed and dissipation == "joints" and deflections):
        raise InputError(
            "shape='updated' needs joints of the structure's reference stiffness, "
            "dissipation='joints' and deflections=True"
        )
    task = Task(
        structure.basis,
        path,
        _background(structure, zeta0, modes),
        jnp.asarray(modes),
        fixed,
        frequency,
        deflections,
    )
    found = solve_levels(flat, task)
    if shape == "updated" and found.deflection is not None:
        found = eqx.filter_jit(updated_shapes)(flat, task, found, found.deflection)
    if dissipation == "work":
        found = _by_work(found, task, wanted)
    _warn(found.result)

    def array(x: Array) -> Array:
        return x[:, 0].reshape(*batch, *x.shape[2:]) if single else x.reshape(*batch, *x.shape[1:])

    q = array(found.q)
    return QsmaSolution(
        curves=ModalCurves(
            q,
            array(found.frequency),
            array(found.damping),
            name=", ".join(f"mode {r}" for r in modes),
        ),
        alpha=levels[0] if single else levels,
        q=q,
        dissipation=array(found.dissipation),
        deflection=None if found.deflection is None else array(found.deflection),
        result=array(found.result),
        error=array(found.error),
        structure=structure,
        modes=modes,
    )


def _modes(
    structure: JointedStructure, mode: int | Sequence[int] | ArrayLike
) -> tuple[tuple[int, ...], bool]:
    """Indices of the modes asked for, and whether it was a single one."""
    basis = structure.basis
    count = basis.omega2.shape[0]
    asked = np.asarray(mode)
    if asked.dtype.kind == "f":
        n = structure.structure.size
        if asked.shape != (n,) or not np.all(np.isfinite(asked)) or not np.any(asked):
            raise InputError(
                f"mode: a shape must be {n} finite numbers, not all zero; got an array of shape "
                f"{asked.shape} (indices must be integers)"
            )
        assurance = modal_assurance(basis.Phi, asked[:, None], structure.structure.M)
        return (int(np.argmax(assurance)),), True
    if asked.dtype.kind not in "iu" or asked.ndim > 1 or asked.size == 0:
        raise InputError(f"mode = {mode!r}: expected an index, a list of indices or a shape")
    indices = tuple(int(r) for r in np.atleast_1d(asked))
    for r in indices:
        if not 0 <= r < count:
            raise InputError(
                f"mode {r} does not exist: the structure has {count} elastic modes, 0 to "
                f"{count - 1}, lowest first"
            )
    return indices, asked.ndim == 0


def _load_levels(alpha: ArrayLike | None, modes: int) -> Float[Array, "modes levels"]:
    """Checked load levels, one row for each mode."""
    if alpha is None:
        raise InputError(
            "qsma needs load levels alpha=, for instance numpy.geomspace(1e-2, 1e2, 50)"
        )
    levels = as_real(alpha, "alpha")
    if levels.ndim not in (1, 2) or levels.size == 0:
        raise InputError(f"alpha has shape {levels.shape}; expected (levels,) or (modes, levels)")
    if levels.ndim == 2 and levels.shape[0] != modes:
        raise InputError(
            f"alpha has {levels.shape[0]} rows for {modes} mode(s); expected one row each, or "
            "one row for all"
        )
    if not is_traced(levels):
        if not np.all(np.asarray(levels) > 0):
            raise InputError(f"alpha holds {np.min(np.asarray(levels)):g}; levels must be positive")
        if not np.all(np.diff(np.asarray(levels), axis=-1) > 0):
            raise InputError("alpha must increase from level to level; sort it")
    return jnp.broadcast_to(levels, (modes, levels.shape[-1]))


def _batch_shape(joints: Sequence[AbstractJoint]) -> tuple[int, ...]:
    """Common shape of the joints' parameters."""
    shapes = [jnp.shape(leaf) for leaf in jax.tree.leaves(joints)]
    if len({shape for shape in shapes if shape}) > 1:
        raise InputError(
            "qsma: the joints' parameters come in different batch shapes "
            f"{sorted({shape for shape in shapes if shape})}; give numbers or arrays of one shape"
        )
    return max(shapes, key=len)


def _background(
    structure: JointedStructure,
    zeta0: ArrayLike | PowerLawDamping | None,
    modes: tuple[int, ...],
) -> Background:
    """Damping ratio beside the joints, for each mode."""
    if isinstance(zeta0, PowerLawDamping):
        return zeta0
    if zeta0 is None:
        phi = structure.basis.Phi[:, jnp.asarray(modes)]
        omega = jnp.sqrt(structure.basis.omega2[jnp.asarray(modes)])
        return jnp.sum(phi * (structure.structure.C @ phi), axis=0) / (2.0 * omega)
    ratio = as_real(zeta0, "zeta0")
    if ratio.shape not in ((), (len(modes),)):
        raise InputError(
            f"zeta0 has shape {ratio.shape}; expected a number or one for each of the "
            f"{len(modes)} mode(s)"
        )
    if not is_traced(ratio) and np.any(np.asarray(ratio) < 0):
        raise InputError(f"zeta0 = {np.min(np.asarray(ratio)):g} is negative")
    return jnp.broadcast_to(ratio, (len(modes),))


def _at_reference(structure: JointedStructure) -> bool:
    """Whether the joints have just the stiffness that the modal basis includes."""
    stiffness = [joint.initial_stiffness for joint in structure.elements]
    if is_traced(stiffness, structure.basis):
        return False
    return all(
        bool(np.all(np.asarray(k) == k_0))
        for k, k_0 in zip(stiffness, np.asarray(structure.basis.stiffness), strict=True)
    )


def _by_work(found: Levels, task: Task, wanted: np.ndarray) -> Levels:
    """Dissipation and damping by the work integral, at the levels that were asked for."""
    energy = work_dissipation(task.alpha, found.q)
    # Of the sum of closed forms only the part beside the joints is kept.
    beside = found.damping - found.dissipation / (2.0 * jnp.pi * task.alpha * found.q)
    damping = energy / (2.0 * jnp.pi * task.alpha * found.q) + beside
    found = found._replace(dissipation=energy, damping=damping)
    return jax.tree.map(lambda x: x[:, :, wanted], found)


def _warn(result: Array) -> None:
    """Tell how many levels are missing, and why; a traced solve speaks by its NaN."""
    if is_traced(result):
        return
    codes = np.asarray(result)
    for code in np.unique(codes[codes != Result.CONVERGED]):
        warnings.warn(
            f"qsma: {np.sum(codes == code)} of {codes.size} levels hold NaN: "
            f"{Result(code).message}",
            stacklevel=3,
        )
