"""Nonlinear normal modes of a jointed structure by phase resonance."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.curves import ModalCurves
from iwanjax.dynamics.continuation import Solution, follow
from iwanjax.dynamics.coordinates import ModalCoordinates, modal_coordinates
from iwanjax.dynamics.harmonic_balance import Cycle, PeriodicSystem
from iwanjax.dynamics.steady_control import PhaseResonance
from iwanjax.dynamics.steady_state import HARMONICS, SAMPLES, TOLERANCE, parameter_set, positive
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.joints.sliders import SLIDERS
from iwanjax.structures import JointedStructure
from iwanjax.types import ArrayLike, require_double_precision


def nonlinear_modes(
    structure: JointedStructure,
    mode: int,
    levels: ArrayLike,
    *,
    harmonics: tuple[int, ...] = HARMONICS,
    samples: int = SAMPLES,
    periods: int = 2,
    modes: int | None = None,
    sliders: int = SLIDERS,
    tolerance: float = TOLERANCE,
) -> ModalCurves:
    r"""Frequency and damping against amplitude from phase resonance.

    A force :math:`M\varphi_r f\cos(\Omega t)` holds the fundamental q of the modal
    displacement :math:`\varphi_r^TMu` a quarter period behind itself; it feeds what the motion
    loses, in joints, dampers and all harmonics:

    .. math:: E = \pi f q, \qquad
              \zeta = \frac{E}{2\pi\Omega^2q^2} = \frac{f}{2\Omega^2q}

    so that frequency and damping mean what they do for :func:`iwanjax.qsma`, but all modes
    take part, with their inertia, and the motion has harmonics.

    Parameters
    ----------
    structure : JointedStructure
        One parameter set.
    mode : int
        Index among the elastic modes, lowest first.
    levels : (levels,) array_like
        Amplitudes q of the modal displacement, positive; followed in the order given, in steps
        of any length. Where slip makes the mode another one, as where a joint much stiffer than
        the structure lets go, several motions are in phase resonance: levels close together
        stay with one.
    harmonics, samples, periods, modes, sliders, tolerance
        As for :func:`harmonic_response`.

    Returns
    -------
    ModalCurves
        Against q; NaN where no motion was found, as where friction damps the mode more than
        critically. Levels beyond are followed from the last that was found.

    Raises
    ------
    InputError, PrecisionError
        As for :func:`harmonic_response`, and for a mode that does not exist.

    Examples
    --------
    >>> import iwanjax as ij
    >>> joint = ij.Iwan4(F_S=1.0, K_T=1.0, chi=-0.5, beta=1.0)
    >>> curves = ij.nonlinear_modes(ij.oscillator(stiffness=3.0, joint=joint), 0, [0.1, 0.2])
    >>> curves.frequency.round(4).tolist(), curves.damping.round(4).tolist()
    ([0.3148, 0.3133], [0.0028, 0.004])
    """
    require_double_precision("nonlinear_modes")
    q = jnp.atleast_1d(positive(levels, "levels"))
    basis = structure.basis
    count = basis.omega2.shape[0] if modes is None else min(modes, basis.omega2.shape[0])
    if not 0 <= mode < count:
        raise InputError(f"mode = {mode}; expected 0 to {count - 1}, elastic modes lowest first")
    pattern = (structure.structure.M @ basis.Phi[:, mode])[None]
    cycle = Cycle.of(harmonics, samples, periods)
    modal = modal_coordinates(structure, pattern, pattern, modes)
    omega_0 = jnp.sqrt(basis.omega2[mode])
    start = (q, omega_0, basis.P[:, mode])
    found = _resonant(
        parameter_set(structure), modal, start, cycle, sliders, jnp.asarray(tolerance)
    ).motion
    zeta = 0.5 * found.f.imag / (found.omega**2 * q)
    return ModalCurves(q, found.omega / (2.0 * np.pi), zeta, name=f"mode {mode}")


@eqx.filter_jit
def _resonant(
    elements: tuple[AbstractJoint, ...],
    modal: ModalCoordinates,
    start: tuple[Array, Array, Array],
    cycle: Cycle,
    sliders: int,
    tolerance: Array,
) -> Solution:
    """One level after the other."""
    system = PeriodicSystem.of(elements, modal, cycle, sliders)
    q, omega_0, shape = start
    same = [jnp.broadcast_to(x, (q.size, *x.shape)) for x in (omega_0, shape)]
    return follow(system, PhaseResonance(q, *same), tolerance)
