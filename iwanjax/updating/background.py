"""Damping of a structure's modes beside its joints, as parameters of a fit."""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Parameter
from iwanjax.estimation.priors import LogNormal, Uniform
from iwanjax.structures import JointedStructure
from iwanjax.updating.problem import Measured

# Deviation of the logarithm of a ratio about that of the structure's C: as of a joint's strength.
_PRIOR_SIGMA = 1.0
# Deviations by which noise may have lowered the least damping of a curve: once in 30 000 levels.
_CERTAIN = 4.0
# Bound of a ratio over the largest damping of its curve, as for a mode alone.
_REACH = 1.5
# Levels of lowest amplitude that a search starts from, and the share of their damping.
_LOWEST, _SHARE = 3, 0.5


def background_name(mode: int) -> str:
    """What the damping ratio of an elastic mode (lowest 0) beside the joints is called."""
    return f"mode{mode}.zeta_0"


def modes_of(
    structure: JointedStructure, curves: Sequence[ModalCurves], modes: Sequence[int] | None
) -> tuple[int, ...]:
    """The elastic mode of each curve, 0, 1, ... unless given.

    Raises
    ------
    InputError
        For modes that do not exist or do not match the curves.
    """
    count = structure.basis.omega2.shape[0]
    which = tuple(range(len(curves))) if modes is None else tuple(int(m) for m in modes)
    if len(which) != len(curves) or len(set(which)) != len(which):
        raise InputError(
            f"fit: got modes {list(which)} for {len(curves)} curve(s); expected one each, all "
            "different (merge several hits of a mode with merge_curves)"
        )
    for mode in which:
        if not 0 <= mode < count:
            raise InputError(f"fit: mode {mode} does not exist; expected 0 to {count - 1}")
    return which


def viscous_ratios(structure: JointedStructure, modes: Sequence[int]) -> np.ndarray:
    r"""Damping ratios that C gives to modes, :math:`\varphi_r^TC\varphi_r/(2\omega_r)`."""
    phi = np.asarray(structure.basis.Phi)[:, list(modes)]
    omega = np.sqrt(np.asarray(structure.basis.omega2)[list(modes)])
    return np.sum(phi * (np.asarray(structure.structure.C) @ phi), axis=0) / (2.0 * omega)


def as_damped_in(
    structure: JointedStructure,
    other: JointedStructure,
    modes: Sequence[int],
    parameters: Sequence[Parameter],
) -> tuple[Parameter, ...]:
    """Parameters of another structure's damping, those held at what C gives it moved to this one.

    With one more joint, modes are other ones: the same C damps them differently.

    Parameters
    ----------
    structure, other : JointedStructure
        Of one C.
    modes : sequence of int
        Elastic modes, lowest 0, of each parameter.
    parameters : sequence of Parameter
        Damping ratios of the other's modes, 1; what is free, or fixed at another value, stays.
    """
    ratios = (viscous_ratios(each, modes) for each in (structure, other))
    return tuple(
        replace(p, value=float(here)) if p.fixed and p.value == there else p
        for p, here, there in zip(parameters, *ratios, strict=True)
    )


def background_parameters(
    structure: JointedStructure, curves: Sequence[ModalCurves], modes: Sequence[int]
) -> dict[str, Parameter]:
    """Damping ratio of each mode beside the joints, with a prior.

    Where the structure's C gives a mode some damping this is the median of the prior and the
    starting value. Else the curve says how much it may be: joints only dissipate, so that no
    level is damped less (uniform between zero and the curve's least, noise allowed for), and
    a search starts at half of what the lowest amplitudes have.

    Parameters
    ----------
    structure : JointedStructure
    curves : sequence of ModalCurves
    modes : sequence of int
        The elastic mode of each curve.

    Returns
    -------
    dict of str to Parameter
        Keyed ``"mode1.zeta_0"`` for elastic mode 1, in the order of the curves.
    """
    measured = Measured.of(curves)
    found = {}
    for mode, viscous, part in zip(
        modes, viscous_ratios(structure, modes), measured.slices, strict=True
    ):
        q, zeta, std = (
            np.asarray(x[part]) for x in (measured.q, measured.damping, measured.damping_std)
        )
        least = float(max(np.min(zeta + _CERTAIN * std), np.median(std)))
        upper = _REACH * float(max(zeta.max(), least, viscous))
        name, meaning = background_name(mode), f"damping ratio of mode {mode} beside the joints"
        if viscous > 0.0:
            found[name] = Parameter(
                name,
                float(viscous),
                LogNormal(float(viscous), _PRIOR_SIGMA),
                meaning=meaning,
                lower=0.0,
                upper=upper,
                transform="log",
            )
            continue
        low = float(np.mean(zeta[np.argsort(q)[:_LOWEST]]))
        found[name] = Parameter(
            name,
            _SHARE * float(np.clip(low, 0.0, least)) or _SHARE * least,
            Uniform(0.0, least),
            meaning=meaning,
            lower=0.0,
            upper=upper,
            transform="logit",
        )
    return found


def refuse_undamped(parameters: Sequence[Parameter]) -> None:
    """Refuse a mode whose damping has to come from the joints alone.

    Their parameters would pay for damping that every structure has beside them, and be wrong
    by tens of per cent.

    Raises
    ------
    InputError
    """
    for p in parameters:
        if p.fixed and p.value == 0.0:
            raise InputError(
                f"fit: {p.name} is fixed at 0, so that the joints alone would have to explain the "
                "measured damping; leave it free, or fix it to the ratio without joints, for "
                "instance 1e-4"
            )


def with_background(
    structure: JointedStructure, modes: Sequence[int], ratios: Float[Array, " modes"]
) -> JointedStructure:
    r"""The structure with these damping ratios of some modes in its C.

    The dampers that a mode has are scaled, :math:`C \to S^TCS` with
    :math:`S = I + \sum_r(\sqrt{\zeta_r/\zeta_{C,r}} - 1)\,\varphi_r\varphi_r^TM`; a mode
    without any gets :math:`M\varphi_r\,2\zeta_r\omega_r\,\varphi_r^TM` (2.25). Both leave the
    ratios of other modes and a positive semidefinite C as they are.

    Parameters
    ----------
    structure : JointedStructure
    modes : sequence of int
        Elastic modes at the structure's reference stiffness.
    ratios : (modes,) array
        May be traced.
    """
    own = viscous_ratios(structure, modes)
    damped = own > 0.0
    which = jnp.asarray(tuple(modes))
    omega = jnp.sqrt(structure.basis.omega2[which])
    phi = structure.basis.Phi[:, which]
    shapes = structure.structure.M @ phi
    scale = jnp.where(damped, jnp.sqrt(ratios / np.where(damped, own, 1.0)), 1.0)
    S = jnp.eye(structure.structure.size) + phi * (scale - 1.0) @ shapes.T
    added = jnp.where(damped, 0.0, 2.0 * ratios * omega)
    C = S.T @ structure.structure.C @ S + shapes * added @ shapes.T
    return eqx.tree_at(lambda js: js.structure.C, structure, C)
