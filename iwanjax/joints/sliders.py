"""Banks of Jenkins sliders: the discrete form of Iwan's elements (thesis Sec. 4.2.3)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.discrete import AbstractDiscrete, Reaction

SLIDERS = 200
"""Sliders of an Iwan element unless told otherwise."""

# The weakest threshold but one, over phi_max: the grid is graded from there on.
_FINEST = 3e-5


class SliderState(NamedTuple):
    """What a bank remembers.

    Attributes
    ----------
    d : array
        Deflection of the bank.
    stretch : (sliders,) array
        Of each spring.
    direction : (sliders,) array
        1 or -1 for a slider that slips that way, 0 for one that sticks.
    """

    d: Array
    stretch: Float[Array, " sliders"]
    direction: Float[Array, " sliders"]


class SliderBank(AbstractDiscrete):
    r"""Springs k in parallel, each in series with a Coulomb slider of threshold k phi.

    A slider that sticks lets go when its spring's stretch reaches :math:`\phi`; while it
    slips its spring keeps the stretch :math:`\theta\phi`, until the motion turns. The
    thesis counts slipping sliders from the weakest on (4.15), which fails for theta < 1 as
    soon as a history is not a virgin loading or a symmetric cycle; here every slider knows
    by itself which way it slips.

    Parameters
    ----------
    phi : (sliders,) array
        Thresholds, length.
    k : (sliders,) array
        Stiffnesses, force/length.
    theta : array, optional
        Kinetic over static friction, 1. Without it both are the same, which takes half the time:
        no slider needs to know which way it slips.
    """

    phi: Float[Array, " sliders"]
    k: Float[Array, " sliders"]
    theta: Array | None = None

    def init(self) -> SliderState:
        """All sliders stick, no spring is stretched."""
        still = jnp.zeros_like(self.phi * self.k)
        return SliderState(jnp.zeros_like(still[..., 0]), still, still)

    def step(self, d: Array, v: Array, dt: Array, state: SliderState) -> Reaction:
        """Move to d: exact for any motion that does not turn on the way."""
        moved = (d - state.d)[..., None]
        trial = state.stretch + moved
        if self.theta is None:
            return self._held(d, trial, moved == 0.0, state)
        kinetic = self.theta * self.phi
        goes_on = state.direction * moved > 0.0
        threshold = jnp.where(goes_on, kinetic, self.phi)
        # At rest nothing changes: a slider that slipped is at its kinetic threshold still.
        slips = (jnp.abs(trial) >= threshold) & (moved != 0.0)
        stretch = jnp.where(slips, jnp.copysign(kinetic, trial), trial)
        direction = jnp.where(slips, jnp.sign(trial), jnp.where(moved == 0, state.direction, 0.0))
        held = jnp.where(slips, 0.0, self.k)
        # The spring falls from its threshold to the kinetic stretch, then the slider is dragged.
        beyond = jnp.abs(trial) - threshold
        # As a product: of a difference of squares rounding may leave less than nothing.
        fallen = 0.5 * (threshold - kinetic) * (threshold + kinetic)
        lost = jnp.where(slips, fallen + kinetic * beyond, 0.0)
        after = SliderState(d, stretch, direction)
        return self._reaction(self.k * stretch, held, self.k * lost, after)

    def _held(self, d: Array, trial: Array, rests: Array, state: SliderState) -> Reaction:
        """The step of sliders whose springs keep the stretch they let go at."""
        stretch = jnp.clip(trial, -self.phi, self.phi)
        pull = self.k * stretch
        held = jnp.where((stretch == trial) | rests, self.k, 0.0)
        after = SliderState(d, stretch, state.direction)
        return self._reaction(pull, held, pull * (trial - stretch), after)

    def _reaction(self, pull: Array, held: Array, lost: Array, state: SliderState) -> Reaction:
        """Of all sliders: sums of their forces, of what sticks, and of what each lost."""
        force, stiffness, loss = _sums(pull, held, lost)
        return Reaction(force, stiffness, jnp.zeros_like(force), state, loss)

    def energy(self, d: Array, state: SliderState) -> Array:
        """Of the springs."""
        return 0.5 * jnp.sum(self.k * state.stretch**2, axis=-1)


@jax.custom_jvp
def _sums(*terms: Array) -> tuple[Array, ...]:
    """Of each term over its last axis, all in one pass.

    On CPUs XLA makes a loop of each sum, which reads the sliders and moves them once more; one for
    all three takes half the time. Without a derivative of its own a reduction of several arrays
    would be differentiated as a tree of pairs.
    """
    zeros = tuple(jnp.zeros((), term.dtype) for term in terms)
    return tuple(jax.lax.reduce(terms, zeros, _added, (terms[0].ndim - 1,)))


@_sums.defjvp
def _sums_jvp(
    terms: tuple[Array, ...], tangents: tuple[Array, ...]
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    return _sums(*terms), tuple(jnp.sum(tangent, axis=-1) for tangent in tangents)


def _added(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def iwan_sliders(
    K_T: Array, chi: Array, beta: Array, phi_max: Array, sliders: int
) -> tuple[Float[Array, " sliders"], Float[Array, " sliders"]]:
    r"""Thresholds and stiffnesses of a four-parameter distribution.

    Boundaries :math:`b_i` in geometric progression, so that strokes of any size meet as
    many sliders: uniform ones lose all damping below the first. An interval's slider has its
    stiffness (4.14) and, unlike the midpoint of (4.13), its force:

    .. math:: k_i = \int_{b_i}^{b_{i+1}}\rho\,d\phi, \qquad
              k_i\phi_i = \int_{b_i}^{b_{i+1}}\phi\rho\,d\phi

    so that K_T and F_S are exact. The last slider is the Dirac share at phi_max.

    Parameters
    ----------
    K_T, chi, beta, phi_max : array
        Of the element.
    sliders : int
        At least 3.

    Returns
    -------
    (phi, k) : two (sliders,) arrays

    Raises
    ------
    InputError
        For too few sliders.
    """
    if sliders < 3:
        raise InputError(f"sliders = {sliders}; expected at least 3")
    K_T, chi, beta, phi_max = (jnp.asarray(x)[..., None] for x in (K_T, chi, beta, phi_max))
    n = chi + 1.0
    # The last of the graded boundaries is phi_max itself.
    log_b = np.linspace(np.log(_FINEST), 0.0, sliders - 1)
    shares, moments = (_intervals(exponent, log_b) for exponent in (n, n + 1.0))
    power_law = K_T / (1.0 + beta)
    k = jnp.concatenate([power_law * shares, K_T - power_law], axis=-1)
    inside = phi_max * n / (n + 1.0) * moments / shares
    return jnp.concatenate([inside, phi_max + jnp.zeros_like(inside[..., :1])], axis=-1), k


def _intervals(exponent: Array, log_b: np.ndarray) -> Array:
    """b_{i+1}^e - b_i^e, the first interval from zero on, without the difference of near equals."""
    lower = jnp.exp(exponent * log_b[:-1])
    rest = lower * jnp.expm1(exponent * np.diff(log_b))
    return jnp.concatenate([lower[..., :1], rest], axis=-1)
