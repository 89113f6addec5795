"""Modes of a structure one at a time, by the first harmonic of what does not follow a line."""

import abc
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from iwanjax.joints import AbstractJoint
from iwanjax.structures import ModalBasis
from iwanjax.structures.small import solve_general

# Newton steps, and the size of the last one, over the deflections, above which there is no cycle.
_STEPS, _ACCEPTED = 12, 1e-8


class AbstractCyclic(eqx.Module):
    """What an element does over a steady cycle of amplitude |d|, elementwise."""

    @abc.abstractmethod
    def stiffness(self, d: Array) -> Array:
        """In-phase first harmonic over d."""

    @abc.abstractmethod
    def tip(self, d: Array) -> Array:
        """Stiffness at the tips that a free decay shrinks by."""

    @abc.abstractmethod
    def loss(self, d: Array, omega: Array) -> Array:
        """Energy that it takes from a cycle."""


class OfJoint(AbstractCyclic):
    """A joint's."""

    joint: AbstractJoint

    def stiffness(self, d: Array) -> Array:
        """In-phase first harmonic over d."""
        return self.joint.harmonic_stiffness(d)

    def tip(self, d: Array) -> Array:
        """Stiffness at the tips that a free decay shrinks by."""
        return self.joint.tip_stiffness(d)

    def loss(self, d: Array, omega: Array) -> Array:
        """Energy that it takes from a cycle."""
        return self.joint.dissipation(d, omega=omega)


class Backbones(NamedTuple):
    """Cycles of single modes, (curves, levels) each unless said otherwise; NaN where there is none.

    Attributes
    ----------
    frequency : Hz.
    damping : as a ring-down shows it.
    d : (elements, curves, levels) signed amplitudes of the elements' deflections.
    """

    frequency: Float[Array, "curves levels"]
    damping: Float[Array, "curves levels"]
    d: Float[Array, "elements curves levels"]


def backbones(
    basis: ModalBasis,
    rows: Float[Array, "elements modes"],
    held: Float[Array, " elements"],
    elements: Sequence[AbstractCyclic],
    modes: Int[Array, " curves"],
    q: Float[Array, "curves levels"],
    viscous: Float[Array, " curves"],
) -> Backbones:
    r"""Frequency and ring-down damping of single modes against modal displacement.

    Beside the linear structure, whose elements are held by springs of stiffness k, stand the
    pseudo-forces :math:`\sigma_j = [k_j - k_{1j}(d_j)]\,d_j` of the first harmonic. Mode r of
    amplitude q makes all modes s answer at its frequency,

    .. math:: \omega^2 = \omega_r^2 - \frac{1}{q}\sum_j p_{jr}\sigma_j, \qquad
              d_i = p_{ir}q + \sum_{s\ne r}\frac{p_{is}}{\omega_s^2-\omega^2}\sum_j p_{js}\sigma_j,

    which Newton's method solves for the few d. Quasi-static modal analysis lets the other modes
    follow statically instead (:math:`\omega = 0` in the sum), which for the higher modes is 1 or
    2 per cent of damping. What a ring-down shows of the loss is as for
    :meth:`~iwanjax.ModalOscillator.ringdown_frequency_and_damping`. Derivatives are implicit.

    Parameters
    ----------
    basis : ModalBasis
        Of the linear structure with the springs.
    rows : (elements, modes) array
        p, each element's deflection per unit modal displacement.
    held : (elements,) array
        Stiffness that the basis has in each element's place.
    elements : sequence of AbstractCyclic
        As many.
    modes : (curves,) array of int
        r of each curve.
    q : (curves, levels) array
        Modal displacement amplitudes.
    viscous : (curves,) array
        2 zeta omega_r of each mode's own damping.

    Returns
    -------
    Backbones
    """
    own = rows[:, modes][:, :, None]
    others = 1.0 - jax.nn.one_hot(modes, basis.omega2.size, axis=0)[:, :, None]

    def pseudo(d: Array) -> Array:
        return held[:, None, None] * d - _each(lambda e, x: e.stiffness(x) * x, elements, d)

    def balance(d: Array) -> _Balance:
        sigma, slope = jax.jvp(pseudo, (d,), (jnp.ones_like(d),))
        modal = jnp.einsum("jk,jcl->kcl", rows, sigma)
        pull = jnp.sum(own * sigma, axis=0)
        omega2 = basis.omega2[modes][:, None] - pull / q
        # A mode that nothing pulls at is where it was: its own difference is none.
        apart = jnp.where(others > 0.0, basis.omega2[:, None, None] - omega2, 1.0)
        gives = others / apart
        rest = d - own * q - jnp.einsum("jk,kcl->jcl", rows, gives * modal)
        # The frequency at which the others answer moves with d, and with q.
        shifted = jnp.einsum("jk,kcl->jcl", rows, gives**2 * modal)
        J = jnp.einsum("ik,jk,kcl->ijcl", rows, rows, gives)
        J = jnp.eye(len(d))[..., None, None] - (J - shifted[:, None] * own / q) * slope
        driven = own + shifted * pull / q**2
        return _Balance(rest, J, driven, omega2, pull / q**2, slope, gives * modal)

    def advance(_: int, state: tuple[Array, Array]) -> tuple[Array, Array]:
        now = balance(state[0])
        move = _solved(now.J, now.rest)
        return state[0] - move, move

    start = jnp.broadcast_to(own * q, (len(elements), *q.shape))
    d, move = jax.lax.fori_loop(0, _STEPS, advance, (start, start))
    good = jnp.max(jnp.abs(move), axis=0) <= _ACCEPTED * jnp.max(jnp.abs(d), axis=0)
    # One more step carries the derivatives: those of the solution itself.
    d = jax.lax.stop_gradient(d)
    now = balance(d)
    # Where the others have most of the motion another mode is meant.
    good = good & (jnp.sum(now.others**2, axis=0) < q**2)
    d = d - _solved(jax.lax.stop_gradient(now.J), now.rest)
    now = balance(d)
    omega = jnp.sqrt(now.omega2)
    follows = _solved(now.J, now.driven)
    stiffening = now.risen - jnp.sum(own * now.slope * follows, axis=0) / q
    yielded = held[:, None, None] - _each(lambda e, x: e.tip(x), elements, d)
    at_tip = basis.omega2[modes][:, None] - jnp.sum(own * yielded * follows, axis=0)
    loss = jnp.sum(_each(lambda e, x: e.loss(x, omega), elements, d), axis=0)
    zeta = (loss / (2.0 * math.pi * q**2) + 0.5 * viscous[:, None] * omega) / at_tip
    zeta = zeta * (1.0 + q * stiffening / now.omega2)
    f = omega / (2.0 * math.pi)
    return Backbones(jnp.where(good, f, jnp.nan), jnp.where(good, zeta, jnp.nan), d)


class _Balance(NamedTuple):
    """Where some deflections leave the equations.

    Attributes
    ----------
    rest : what is left of d.
    J : its derivative by d, (elements, elements, curves, levels).
    driven : its derivative by q, negative.
    omega2, risen : squared frequency, and its derivative by q.
    slope : of each pseudo-force.
    others : modal displacements of all modes but the one, (modes, curves, levels).
    """

    rest: Array
    J: Array
    driven: Array
    omega2: Array
    risen: Array
    slope: Array
    others: Array


def _solved(J: Array, right: Array) -> Array:
    return jnp.stack(solve_general([list(row) for row in J], list(right)))


def _each(
    told: Callable[[AbstractCyclic, Array], Array], elements: Sequence[AbstractCyclic], d: Array
) -> Array:
    return jnp.stack([told(each, x) for each, x in zip(elements, d, strict=True)])
