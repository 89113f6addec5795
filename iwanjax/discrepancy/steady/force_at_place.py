"""A force at one place of a structure, beside its joints, against the curves of its modes."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.discrepancy.steady.one_joint import to_size, to_variable
from iwanjax.quasistatic.modal import Beside
from iwanjax.quasistatic.single_harmonic import AbstractCyclic, Backbones, OfJoint, backbones
from iwanjax.updating.interpolate import cubic
from iwanjax.updating.parameters import Chart
from iwanjax.updating.problem import AbstractProblem, Measured, Reference
from iwanjax.updating.structural import StructuralProblem


class CyclicForce(AbstractCyclic):
    """A force of some size, from what one of unit size does at some amplitudes.

    Attributes
    ----------
    level : (curves, deflections) array
        Logarithms of the amplitudes, rising; beyond them the ends' values hold.
    unit : Beside
        In-phase stiffness, stiffness at the tip, and loss over d^2, (curves, deflections) each.
    size : array
        Its size.
    """

    level: Float[Array, "curves deflections"]
    unit: Beside
    size: Array

    def stiffness(self, d: Array) -> Array:
        """In-phase first harmonic over d."""
        return self._told(self.unit.stiffness, d)

    def tip(self, d: Array) -> Array:
        """Stiffness at the tips that a free decay shrinks by."""
        return self._told(self.unit.tip, d)

    def loss(self, d: Array, omega: Array) -> Array:
        """Energy that it takes from a cycle; its unit is at the curve's own frequency."""
        return self._told(self.unit.loss, d) * d**2

    def _told(self, values: Array, d: Array) -> Array:
        level = self.level
        at = jnp.log(jnp.maximum(jnp.abs(d), jnp.exp(level[:, :1])))
        return self.size * jax.vmap(cubic)(jnp.minimum(at, level[:, -1:]), level, values)


class WithForceAt(AbstractProblem):
    """A structure's joints and a force of some size at one place, against its modes' curves.

    Each mode moves on its own, as :func:`~iwanjax.quasistatic.single_harmonic.backbones` says.
    What the force does is data, so that all kinds and places share one compiled search.

    Attributes
    ----------
    row : (modes,) array
        Deflection of the force's place per unit modal displacement.
    level, unit : as of :class:`CyclicForce`
    """

    measured: Measured
    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)
    base: StructuralProblem
    row: Float[Array, " modes"]
    level: Float[Array, "curves deflections"]
    unit: Beside
    scale: Array
    positive: Array

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """The base's parameters; a size that must be positive moves by its logarithm."""
        return jnp.append(self.base.to_values(z[:-1]), to_size(z[-1], self.scale, self.positive))

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        variable = to_variable(theta[-1], self.scale, self.positive)
        return jnp.append(self.base.to_variables(theta[:-1]), variable)

    def model(self, theta: Float[Array, " parameters"]) -> eqx.Module:
        """The structure without the force."""
        return self.base.model(theta[:-1])

    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """What ring-downs show at the measured amplitudes."""
        found = self.cycles(theta, self.base.levels)
        there = (self.base.curve, self.base.level)
        return found.frequency[there], found.damping[there]

    def cycles(self, theta: Float[Array, " parameters"], q: Array) -> Backbones:
        """The same at modal displacements (curves, levels)."""
        base = self.base
        structure = base.jointed(theta[:-1])
        basis, modes = structure.basis, jnp.asarray(base.modes)
        force = CyclicForce(self.level, self.unit, theta[-1])
        return backbones(
            basis,
            jnp.concatenate([basis.P, self.row[None]]),
            jnp.append(basis.stiffness, 0.0),
            [*map(OfJoint, structure.elements), force],
            modes,
            q,
            2.0 * base.background(theta[:-1]) * jnp.sqrt(basis.omega2[modes]),
        )
