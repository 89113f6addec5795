"""What curves below macroslip say of Iwan joints, and what they leave open."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.estimation.parameters import Parameter
from iwanjax.joints.iwan import distribution_of, phi_max_of, physical_of
from iwanjax.types import Scalar

# Onsets of macroslip that are tried: a prime, so that each of a few joints goes through all of
# them in an order of its own.
_PLACES = 7
# The first one over the largest deflection, the last one over where the Dirac slider has no
# strength left, and the farthest in any case: so far, too, is the stiffest of joints to begin with.
_BEYOND, _SHORT, _FARTHEST = 1.001, 0.98, 10.0


class IwanPlace(NamedTuple):
    """An Iwan joint among the parameters of a fit.

    Attributes
    ----------
    owner : str
        The joint, or the group that shares its parameters; empty for a mode's only one.
    positions : mapping of str to int
        Where F_S, K_T, chi and beta are.
    reach : float
        Largest deflection that the curves take it to.
    """

    owner: str
    positions: Mapping[str, int]
    reach: float


class Microslip(NamedTuple):
    """What is alike for curves that stay below macroslip.

    Attributes
    ----------
    thetas : tuple of (parameters,) array
        Parameters that the curves cannot tell from the estimate.
    reaches : dict of str to float
        For each joint that is not known to come to macroslip, the largest deflection.
    """

    thetas: tuple[np.ndarray, ...]
    reaches: dict[str, float]


def drop_of(K_T: Array, phi_max: Array, chi: Array, beta: Array, d: Scalar) -> Array:
    r"""By how much an Iwan joint's secant is below K_T in microslip, force/length.

    .. math:: c = \frac{K_T}{(1+\beta)(\chi+2)}\left(\frac{d}{\phi_{max}}\right)^{\chi+1}

    Parameters
    ----------
    K_T, phi_max, chi, beta : array
        The joint.
    d : float or array
        Deflection, length.
    """
    return K_T / ((chi + 2.0) * (1.0 + beta)) * (d / phi_max) ** (chi + 1.0)


def alike_in_microslip(
    F_S: float,
    K_T: float,
    chi: float,
    beta: float,
    reach: float,
    stiffest: float | None = None,
) -> list[dict[str, float]]:
    r"""Iwan joints that no deflection up to ``reach`` tells from one in microslip.

    Below macroslip the force is :math:`K_Tu - R\,u^{\chi+2}/[(\chi+1)(\chi+2)]`: with K_T, chi
    and R kept, :math:`\phi_{max}` may be anything from the largest deflection on to where
    the Dirac slider has no strength left (3.33),
    :math:`\phi_{max}^{\chi+1} = (\chi+1)K_T/R`.

    Parameters
    ----------
    F_S, K_T, chi, beta : float
        The joint.
    reach : float
        Largest deflection in the curves.
    stiffest : float, optional
        Largest K_T, where a mode has other stiffness beside the joint: in
        :class:`~iwanjax.ModalOscillator` only their sum shows, so that K_T is as large as the
        sliders need and no Dirac slider is made up. By default K_T stays.

    Returns
    -------
    list of dict of str to float
        F_S, K_T, chi and beta of each; empty where there is no room.
    """
    n = chi + 1.0
    if not (n > 0.0 and K_T > 0.0 and F_S > 0.0 and reach > 0.0):
        return []
    R = float(distribution_of(*(jnp.asarray(x) for x in (F_S, K_T, chi, beta)))[0])
    if not 0.0 < R < np.inf:
        return []
    # By logarithms: near chi = -1 it is beyond all numbers.
    most = K_T if stiffest is None else stiffest
    last = min(math.log(n * most / R) / n, math.log(_FARTHEST * reach))
    first, last = _BEYOND * reach, _SHORT * math.exp(last)
    if last <= first:
        return []
    found = []
    for phi_max in np.geomspace(first, last, _PLACES):
        yielding = R * phi_max**n / n
        whole = K_T if stiffest is None else yielding / _SHORT**n
        S = whole - yielding
        joint = physical_of("microslip", R, S, chi, phi_max)
        found.append({name: float(value) for name, value in joint.items()})
    return found


def without_macroslip(place: IwanPlace, theta: np.ndarray) -> list[np.ndarray]:
    r"""Parameters in which a joint that comes to macroslip is one that does not.

    With the same chi and R, the onset of macroslip beyond the curves, and K_T from what the sliders
    need on: curves that end in macroslip by an estimate may as well be those of a stiffer joint in
    microslip beside others that are softer. That is a valley of its own, to which few starts lead.

    Parameters
    ----------
    place : IwanPlace
        Of the joint.
    theta : (parameters,) array
        The estimate.

    Returns
    -------
    list of (parameters,) array
        Empty for a joint that stays below macroslip, too.
    """
    own = _of_place(place, theta)
    chi, n = float(own[2]), float(own[2]) + 1.0
    R, found = float(distribution_of(*own)[0]), []
    # A search may end where a joint has no strength left.
    if not (n > 0.0 and 0.0 < R < np.inf) or _below(place, theta):
        return []
    for phi_max in place.reach * np.geomspace(_BEYOND, _FARTHEST, _PLACES):
        yielding = R * phi_max**n / n
        for K_T in yielding * np.geomspace(1.0 / _SHORT, _FARTHEST, _PLACES // 2):
            joint = physical_of("microslip", R, K_T - yielding, chi, phi_max)
            found.append(_moved(theta, [(place, {k: float(v) for k, v in joint.items()})]))
    return found


def in_other_ends(
    places: Sequence[IwanPlace],
    theta: np.ndarray,
    others: Iterable[tuple[Sequence[IwanPlace], np.ndarray]],
) -> dict[str, float]:
    """Joints that come to macroslip in an estimate and not in another: how far they reach there.

    Parameters
    ----------
    places, theta
        The estimate's.
    others : iterable of (places, (parameters,) array)
        Other ends of the search that are as good.
    """
    slip = {place.owner for place in places if not _below(place, theta)}
    found: dict[str, float] = {}
    for own, end in others:
        for place in own:
            if place.owner in slip and _below(place, end):
                found[place.owner] = max(place.reach, found.get(place.owner, 0.0))
    return found


def _below(place: IwanPlace, theta: np.ndarray) -> bool:
    """Whether a joint stays below macroslip."""
    return float(phi_max_of(*_of_place(place, theta))) > place.reach


def _of_place(place: IwanPlace, theta: np.ndarray) -> list[Array]:
    """F_S, K_T, chi and beta of a place's joint."""
    order = ("F_S", "K_T", "chi", "beta")
    return [jnp.asarray(theta[place.positions[name]]) for name in order]


def microslip(
    places: Sequence[IwanPlace],
    parameters: Sequence[Parameter],
    theta: np.ndarray,
    as_good: Callable[[np.ndarray], bool],
) -> Microslip:
    """Estimates that differ from one in where joints come to macroslip, and explain as well.

    A search ends on a kink that noise has made at the last levels, or anywhere beyond: its
    slope there knows nothing of the plain on the other side.

    Parameters
    ----------
    places : sequence of IwanPlace
    parameters : sequence of Parameter
    theta : (parameters,) array
        The estimate.
    as_good : function of a (parameters,) array
        Whether the curves leave it open.
    """
    families: list[tuple[IwanPlace, list[dict[str, float]]]] = []
    for place in places:
        at = place.positions
        own = {name: float(theta[i]) for name, i in at.items()}
        family = [
            joint
            for joint in alike_in_microslip(**own, reach=place.reach)
            if all(
                parameters[i].lower <= joint[name] <= parameters[i].upper for name, i in at.items()
            )
        ]
        free = not any(parameters[at[name]].fixed for name in ("F_S", "beta"))
        if (
            free
            and len(family) == _PLACES
            and as_good(_moved(theta, [(place, family[_PLACES // 2])]))
        ):
            families.append((place, family))
    candidates = [
        _moved(
            theta,
            [
                (place, family[(k * (1 + j % (_PLACES - 1)) + j) % _PLACES])
                for j, (place, family) in enumerate(families)
            ],
        )
        for k in range(_PLACES)
    ]
    return Microslip(
        tuple(each for each in candidates if families and as_good(each)),
        {place.owner: place.reach for place, _ in families},
    )


def _moved(
    theta: np.ndarray, joints: Sequence[tuple[IwanPlace, Mapping[str, float]]]
) -> np.ndarray:
    """Parameters with other joints at some places."""
    there = theta.copy()
    for place, joint in joints:
        for name, i in place.positions.items():
            there[i] = joint[name]
    return there


def left_open(name: str, reaches: Mapping[str, float]) -> bool:
    """Whether microslip leaves a quantity open of a joint that ``reaches`` names.

    That is all but K_T, chi and R: priors alone say how far macroslip is.
    """
    owner, _, quantity = name.rpartition(".")
    return owner in reaches and quantity in ("F_S", "beta", "S", "phi_max")
