"""Several modes in motion at once: what each one's joints do to its frequency and damping."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.joints.sliders import SliderBank
from iwanjax.results import AbstractResult
from iwanjax.structures import JointedStructure
from iwanjax.types import ArrayLike, as_real, require_double_precision

# Samples per cycle of the fastest mode: sliders are exact between the turns of a motion.
_SAMPLES = 32
_MOST_ROUNDS, _TOLERANCE = 20, 1e-4
_BATCH = 32
# Fractional parts of its multiples fill the circle evenly: phases of the modes at the start.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
# Intervals of a table over thresholds and over the shares of two motions. Farthest off the motion
# itself, macroslip included, over the largest change: 0.9 % with 64, 0.14 % with 128, 0.09 % with
# 256.
_TABLE = 128


@dataclass(frozen=True, eq=False)
class CoupledModes(AbstractResult):
    """Result of :func:`iwanjax.coupled_modes`.

    Attributes
    ----------
    amplitude : (levels, modes) array
        Modal displacement amplitudes, as given.
    frequency, damping : (levels, modes) array
        Hz and 1, of each mode while the others move too; NaN for a mode at rest.
    stroke : (levels, joints) array
        Sum of the modes' amplitudes at each joint, length: how far it may be driven.
    share : (levels, modes, joints) array
        Each mode's part of that stroke; where it is small, the others rule the joint and a
        single-mode model is wrong.
    converged : (levels,) bool array
        Whether the modes' shapes came to rest.
    modes : tuple of int
        Which modes these are.
    """

    amplitude: Float[Array, "levels modes"]
    frequency: Float[Array, "levels modes"]
    damping: Float[Array, "levels modes"]
    stroke: Float[Array, "levels joints"] = field(repr=False)
    share: Float[Array, "levels modes joints"] = field(repr=False)
    converged: Bool[Array, " levels"] = field(repr=False)
    modes: tuple[int, ...]


def coupled_modes(
    structure: JointedStructure,
    amplitude: ArrayLike,
    zeta0: ArrayLike | None = None,
    *,
    modes: Sequence[int] | None = None,
    cycles: int = 40,
    sliders: int = 80,
) -> CoupledModes:
    r"""Frequency and damping of each mode when several move at once.

    A joint does not know which mode moves it. Its deflection and its force are
    quasi-periodic,

    .. math:: d(t) = \mathrm{Re}\sum_s D_s e^{i\theta_s}, \qquad \dot\theta_s = \omega_s, \qquad
              G_s = 2\,\langle g\,e^{-i\theta_s}\rangle

    with the pseudo-force g = K_T d - F(d) averaged over the torus of the phases: the joint's
    sliders are driven along this motion, and the average is weighted by a smooth window,
    which converges much faster than a plain one (Das et al. 2017). Then

    .. math:: \omega_s^2 = \omega_{0s}^2 - \frac{\mathrm{Re}\,p_s\cdot G_s}{A_s}, \qquad
              \zeta_s = \zeta_{0s}\frac{\omega_{0s}}{\omega_s}
              - \frac{\mathrm{Im}\,p_s\cdot G_s}{2\omega_s^2A_s}

    and the other modes answer the force at :math:`\omega_s` too, so that shapes change with
    amplitude: :math:`D_s = p_sA_s + \sum_{r\ne s} p_rp_r^T G_s/(\omega_{0r}^2-\omega_s^2)`.
    With one mode alone it is :func:`~iwanjax.qsma` with shapes updated. It goes beyond the
    thesis, whose modal Iwan model takes each mode to move alone (Sec. 2.3.1, Eq. 2.30).

    Parameters
    ----------
    structure : JointedStructure
        One parameter set.
    amplitude : (levels, modes) array_like
        Modal displacement amplitudes, mass-normalised; 0 for a mode at rest.
    zeta0 : float or (modes,) array_like, optional
        Damping ratios beside the joints; by default those of the structure's own C.
    modes : sequence of int, optional
        Which elastic modes the columns are; by default the first ones.
    cycles : int
        Of the slowest mode, that are averaged over.
    sliders : int
        Of an Iwan joint.

    Returns
    -------
    CoupledModes

    Raises
    ------
    InputError
        For amplitudes of another shape, negative or all zero, modes that do not exist, and
        batches of parameter sets.
    PrecisionError
        When JAX computes in float32.

    Examples
    --------
    >>> import iwanjax as ij
    >>> alone, both = [1.0, 0.0, 0.0], [1.0, 0.0, 3.0]
    >>> modes = ij.coupled_modes(ij.three_mass(), [alone, both], 1e-4)
    >>> bool(modes.frequency[1, 0] < modes.frequency[0, 0])  # the third mode makes the joint softer
    True
    """
    require_double_precision("coupled_modes")
    structure.require_joints("coupled_modes")
    A = as_real(amplitude, "amplitude")
    if A.ndim != 2 or A.size == 0:
        raise InputError(f"amplitude has shape {A.shape}; expected (levels, modes)")
    if bool(jnp.any(A < 0)) or not bool(jnp.all(jnp.any(A > 0, axis=1))):
        raise InputError("amplitude: expected numbers >= 0, at least one of each level positive")
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves(structure.elements)):
        raise InputError("coupled_modes takes one parameter set; the joints carry a batch")
    count = structure.basis.omega2.shape[0]
    which = tuple(range(A.shape[1])) if modes is None else tuple(int(m) for m in modes)
    if len(which) != A.shape[1] or len(set(which)) != len(which):
        raise InputError(f"modes = {list(which)} for {A.shape[1]} columns of amplitudes")
    for mode in which:
        if not 0 <= mode < count:
            raise InputError(f"mode {mode} does not exist; expected 0 to {count - 1}")
    if cycles < 5:
        raise InputError(f"cycles = {cycles}; expected at least 5")
    basis = structure.basis
    chosen = list(which)
    omega_0 = np.sqrt(np.asarray(basis.omega2)[chosen])
    if zeta0 is None:
        shapes = np.asarray(basis.Phi)[:, chosen]
        C = np.asarray(structure.structure.C)
        ratios = np.sum(shapes * (C @ shapes), axis=0) / (2.0 * omega_0)
    else:
        ratios = np.broadcast_to(np.asarray(as_real(zeta0, "zeta0")), omega_0.shape)
    steps = round(cycles * _SAMPLES * omega_0.max() / omega_0.min())
    # Always as many levels at a time, so that one kernel does for all.
    levels = A.shape[0]
    padded = jnp.concatenate([A, jnp.repeat(A[-1:], -levels % _BATCH, axis=0)])
    rounds = [
        _coupled(
            structure.elements,
            basis.omega2,
            basis.P,
            basis.stiffness,
            some,
            jnp.asarray(ratios),
            _Options(which, steps, sliders),
        )
        for some in padded.reshape(-1, _BATCH, A.shape[1])
    ]
    omega, zeta, change = (
        jnp.concatenate([getattr(each, name) for each in rounds])[:levels]
        for name in ("omega", "zeta", "change")
    )
    parts = A[:, :, None] * jnp.abs(basis.P[:, chosen]).T
    stroke = jnp.sum(parts, axis=1)
    return CoupledModes(
        amplitude=A,
        frequency=omega / (2.0 * math.pi),
        damping=zeta,
        stroke=stroke,
        share=parts / jnp.where(stroke > 0, stroke, 1.0)[:, None, :],
        converged=change <= _TOLERANCE,
        modes=which,
    )


class _Options(eqx.Module):
    modes: tuple[int, ...] = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    sliders: int = eqx.field(static=True)


class _Round(eqx.Module):
    """Joint deflections at each mode's frequency, and what came of them."""

    D: Complex[Array, "levels joints modes"]
    omega: Float[Array, "levels modes"]
    zeta: Float[Array, "levels modes"]
    change: Float[Array, " levels"]
    count: Array


@eqx.filter_jit
def _coupled(
    elements: tuple[AbstractJoint, ...],
    omega2: Array,
    P: Array,
    stiffness: Array,
    A: Array,
    zeta0: Array,
    options: _Options,
) -> _Round:
    chosen = jnp.array(options.modes)
    own, at_rest = P[:, chosen], A == 0
    omega_0 = jnp.sqrt(omega2[chosen])
    safe = jnp.where(at_rest, 1.0, A)

    def improve(last: _Round) -> _Round:
        G = _projections(elements, stiffness, last.D, last.omega, options)
        force = jnp.einsum("jm,ljm->lm", own, G)
        omega = jnp.sqrt(jnp.maximum(omega_0**2 - force.real / safe, 1e-6 * omega_0**2))
        zeta = zeta0 * omega_0 / omega - force.imag / (2.0 * omega**2 * safe)
        # All modes but the mode itself answer at its frequency.
        gap = omega2 - (omega**2)[:, :, None]
        others = jnp.where(jnp.arange(omega2.shape[0]) == chosen[:, None], 0.0, 1.0 / gap)
        D = own * A[:, None, :] + jnp.einsum("jr,lmr,kr,lkm->ljm", P, others, P, G)
        moved = jnp.sqrt(jnp.sum(jnp.abs(D - last.D) ** 2, axis=(1, 2)))
        size = jnp.sqrt(jnp.sum(jnp.abs(D) ** 2, axis=(1, 2)))
        retuned = jnp.max(jnp.abs(omega / last.omega - 1.0), axis=1)
        return _Round(D, omega, zeta, jnp.maximum(moved / size, retuned), last.count + 1)

    def proceed(last: _Round) -> Array:
        return (last.count < _MOST_ROUNDS) & ~jnp.all(last.change <= _TOLERANCE)

    start = _Round(
        (own * A[:, None, :]).astype(complex),
        omega_0 + jnp.zeros_like(A),
        jnp.zeros_like(A),
        jnp.full(A.shape[0], jnp.inf),
        jnp.zeros((), int),
    )
    found = jax.lax.while_loop(proceed, improve, start)
    missing = jnp.where(at_rest, jnp.nan, 0.0)
    return eqx.tree_at(
        lambda r: (r.omega, r.zeta), found, (found.omega + missing, found.zeta + missing)
    )


def window_of(steps: int) -> tuple[int, Array]:
    """How many samples come first, and weights of all, nought for those; they add up to 2."""
    # So long the sliders forget the start.
    settling = steps // 4
    x = (np.arange(steps) + 0.5) / steps
    window = np.concatenate([np.zeros(settling), np.exp(-1.0 / (x * (1.0 - x)))])
    return settling, jnp.asarray(2.0 * window / window.sum())


def _projections(
    elements: tuple[AbstractJoint, ...],
    stiffness: Array,
    D: Array,
    omega: Array,
    options: _Options,
) -> Complex[Array, "levels joints modes"]:
    """Twice the average of g exp(-i theta) over the phases, along one long motion."""
    dt = 2.0 * math.pi / (_SAMPLES * jnp.max(omega))
    settling, window = window_of(options.steps)
    phases = 2.0 * math.pi * ((np.arange(len(options.modes)) * _GOLDEN) % 1.0)
    found = []
    for j, joint in enumerate(elements):
        element = joint.discrete(options.sliders)

        def one(D: Array, omega: Array, element=element, j=j) -> Array:
            """One level: D (modes,), omega (modes,)."""

            def advance(state, k):
                turn = jnp.exp(1j * (omega * dt * k + phases))
                moving = D * turn
                d, v = jnp.sum(moving.real), jnp.sum((1j * omega * moving).real)
                reaction = element.step(d, v, dt, state[0])
                g = stiffness[j] * d - reaction.force
                return (reaction.state, state[1] + window[k] * g * turn.conj()), None

            steps = jnp.arange(settling + options.steps)
            total = jnp.zeros(D.shape, complex)
            return jax.lax.scan(advance, (element.init(), total), steps)[0][1]

        found.append(jax.vmap(one)(D[:, j], omega))
    return jnp.stack(found, axis=1)


class TwoMotionTable(eqx.Module):
    r"""What two motions at once make of a slider, for any joint that is made of sliders.

    .. math:: d = q\cos\theta + Q\cos\Theta, \qquad
              R(u, s) = \frac{2}{q} \langle z\, e^{-i\theta} \rangle, \qquad
              u = \frac{\phi}{q + Q}, \quad s = \frac{Q}{q + Q}

    The stretch z of a slider's spring scales with the motion, so that with thresholds and
    amplitudes over the stroke q + Q one table serves all parameters, amplitudes and sliders of a
    pair of frequencies. Averages are taken along one long motion, weighted by a smooth window
    (Das et al. 2017).

    Attributes
    ----------
    harmonic : (2, thresholds, shares) array
        Real part of R, and minus its imaginary part, on an even grid over [0, 1] x [0, 1).
    """

    harmonic: Float[Array, "2 thresholds shares"]

    @classmethod
    def of(cls, omega: ArrayLike, steps: int, samples: int) -> "TwoMotionTable":
        """Of two motions of circular frequencies omega (2,), rad/s.

        Parameters
        ----------
        omega : (2,) array
            Rad/s.
        steps, samples : int
            Of the motion that is averaged over, and of a cycle of the faster one.
        """
        return cls(_table(as_real(omega, "TwoMotionTable: omega"), steps, samples))

    def of_sliders(
        self, bank: SliderBank, q: Float[Array, " N"], other: Float[Array, " N"]
    ) -> Float[Array, "2 N"]:
        """Stiffness and loss factor of a bank in the first of two motions, force/length.

        Parameters
        ----------
        bank : SliderBank
            Whose sliders slip at their thresholds (no ``theta``).
        q, other : (N,) array
            Amplitudes q and Q of both motions, length.
        """
        stroke = (q + other)[:, None]
        thresholds, shares = (size - 1 for size in self.harmonic.shape[1:])
        x = jnp.minimum(bank.phi / stroke, 1.0) * thresholds
        # A column beyond the last would be of a first motion of no size: where the second is more
        # than 127 times as large, it is taken for that.
        y = jnp.minimum(other[:, None] / stroke * (shares + 1), shares)
        i = jnp.minimum(jnp.floor(x), thresholds - 1).astype(int)
        j = jnp.minimum(jnp.floor(y), shares - 1).astype(int)
        right, up = x - i, y - j
        low, high = (
            self.harmonic[:, i, k] * (1.0 - right) + self.harmonic[:, i + 1, k] * right
            for k in (j, j + 1)
        )
        return jnp.sum(bank.k * (low * (1.0 - up) + high * up), axis=-1)


@partial(jax.jit, static_argnums=(1, 2))
def _table(omega: Array, steps: int, samples: int) -> Float[Array, "2 thresholds shares"]:
    u = jnp.linspace(0.0, 1.0, _TABLE + 1)[:, None]
    s = jnp.arange(_TABLE) / _TABLE
    dt = 2.0 * math.pi / (samples * jnp.max(omega))
    settling, window = window_of(steps)

    def advance(state, k):
        stretch, d, total = state
        theta, Theta = omega[0] * dt * k, omega[1] * dt * k + 2.0 * math.pi * _GOLDEN
        moved = (1.0 - s) * jnp.cos(theta) + s * jnp.cos(Theta)
        stretch = jnp.clip(stretch + moved - d, -u, u)
        turn = jnp.stack([jnp.cos(theta), -jnp.sin(theta)])[:, None, None]
        return (stretch, moved, total + window[k] * stretch * turn), None

    still = jnp.zeros((_TABLE + 1, _TABLE))
    start = (still, jnp.zeros(_TABLE), jnp.zeros((2, *still.shape)))
    steps_of_all = jnp.arange(settling + steps)
    return jax.lax.scan(advance, start, steps_of_all)[0][2] / (1.0 - s)
