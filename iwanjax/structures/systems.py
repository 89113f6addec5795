"""Systems the literature keeps coming back to, by name and with their options."""

from collections.abc import Callable, Mapping

import numpy as np

from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint, Iwan4
from iwanjax.structures.checks import finite_array
from iwanjax.structures.jointed import JointedStructure
from iwanjax.structures.linear import LinearStructure
from iwanjax.types import ArrayLike


def three_mass(
    *,
    mass: float = 10.0,
    stiffness: float = 9.0,
    joint: AbstractJoint | None = None,
    zeta: float = 0.0,
) -> JointedStructure:
    """Segalman's chain: ground - m1 - m2 = m3, an Iwan joint beside the last spring.

    Thesis Sec. 2.3.1. The joint is called ``"J1"`` and sees u3 - u2.

    Parameters
    ----------
    mass : float
        Each mass, 10.
    stiffness : float
        Each spring (ground-1, 1-2, 2-3), 9.
    joint : joint, optional
        Iwan4 with F_S = 10, K_T = 1, chi = -0.5, beta = 5 by default.
    zeta : float
        Damping ratio of each mode at low amplitude (2.25), 1; the thesis takes 1e-4.

    Examples
    --------
    >>> import iwanjax as ij
    >>> chain = ij.three_mass()
    >>> chain.labels, chain.modes().omega.shape
    (('J1',), (3,))
    """
    m, k = _positive(mass, "mass"), _positive(stiffness, "stiffness")
    structure = LinearStructure(
        m * np.eye(3), None, k * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    )
    element = Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0) if joint is None else joint
    return damped(structure, {"J1": (np.array([0.0, -1.0, 1.0]), element)}, zeta)


def oscillator(
    *, mass: float = 1.0, stiffness: float, joint: AbstractJoint, zeta: float = 0.0
) -> JointedStructure:
    """One mass on a spring and a joint in parallel: Sec. 4.5, and the modal Iwan model (2.7).

    With unit mass the coordinate is a mass-normalised modal displacement and the joint a
    modal Iwan element; ``stiffness`` is then omega_inf squared. The joint is ``"J1"``.

    Parameters
    ----------
    mass : float
        Mass, 1.
    stiffness : float
        Spring beside the joint (K_inf), force/length.
    joint : joint
        The element.
    zeta : float
        Damping ratio at low amplitude, 1.

    Examples
    --------
    >>> import iwanjax as ij
    >>> mode = ij.oscillator(stiffness=3.0, joint=ij.Jenkins(F_S=1.0, K_T=1.0), zeta=0.01)
    >>> mode.modes().omega.tolist()  # the joint sticks: (3 + 1)^(1/2)
    [2.0]
    """
    m, k = _positive(mass, "mass"), _positive(stiffness, "stiffness")
    structure = LinearStructure([[m]], None, [[k]])
    return damped(structure, {"J1": (np.array([1.0]), joint)}, zeta)


def damped(
    structure: LinearStructure,
    joints: Mapping[str, tuple[ArrayLike, AbstractJoint]],
    zeta: ArrayLike,
) -> JointedStructure:
    """Joints on a structure whose modes at low amplitude have these damping ratios (2.25).

    Parameters
    ----------
    structure : LinearStructure
        Its own C is replaced, unless ``zeta`` is zero.
    joints : mapping of str to (row, joint)
        As for :class:`JointedStructure`.
    zeta : float or (k,) array_like
        Damping ratio of each elastic mode, 1, lowest mode first; not negative. The last is that
        of all higher modes too.

    Raises
    ------
    InputError
        As :class:`JointedStructure`, for a negative ratio, and more of them than elastic modes.
    """
    ratios = np.atleast_1d(finite_array(zeta, "zeta"))
    if np.any(ratios < 0):
        raise InputError(
            f"zeta = {ratios.min():g} is negative; expected a damping ratio, for instance 1e-4"
        )
    undamped = JointedStructure(structure, joints)
    if not np.any(ratios):
        return undamped
    higher = undamped.basis.omega2.shape[0] - ratios.size
    C = undamped.linearised("low").damping_matrix(np.pad(ratios, (0, max(higher, 0)), "edge"))
    return JointedStructure(LinearStructure(structure.M, C, structure.K), joints)


def _positive(value: float, name: str) -> float:
    number = float(finite_array(value, name))
    if number <= 0:
        raise InputError(f"{name} = {number:g} must be positive")
    return number


SYSTEMS: dict[str, Callable[..., JointedStructure]] = {
    "three_mass": three_mass,
    "oscillator": oscillator,
}
"""Builders that a study file may name."""
