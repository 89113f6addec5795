"""A joint left out of a mode's curves and an elastic force beside it: softening, then hardening."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.steady.curves import ModeFit, ModeProblem, largest_size, omega_of
from iwanjax.identification.steady.cycle import (
    AbstractActing,
    ActingForce,
    ActingJoint,
    shows,
    unit_on,
)
from iwanjax.identification.steady.fit import (
    JOINT_VALUES,
    AbstractEffectValues,
    JointValues,
    PlacedEffect,
    Size,
    searched,
    with_sizes,
)
from iwanjax.identification.steady.shapes import best_shape
from iwanjax.joints.force_law import Scales
from iwanjax.quasistatic.modal import Beside, ModalOscillator, about
from iwanjax.settings.stages import settings


class JointAndSize(AbstractEffectValues):
    """Variables of a joint left out, then of a force's size."""

    joint: JointValues
    size: Size

    @property
    def count(self) -> int:
        """Of both."""
        return self.joint.count + self.size.count

    def to_values(self, z: Float[Array, " 5"]) -> Float[Array, " 5"]:
        """The joint's parameters and the size."""
        own, size = z[:JOINT_VALUES], z[JOINT_VALUES:]
        return jnp.concatenate([self.joint.to_values(own), self.size.to_values(size)])

    def to_variables(self, values: Float[Array, " 5"]) -> Float[Array, " 5"]:
        """The inverse of :meth:`to_values`."""
        own, size = values[:JOINT_VALUES], values[JOINT_VALUES:]
        return jnp.concatenate([self.joint.to_variables(own), self.size.to_variables(size)])


class ActingBoth(AbstractActing):
    """A joint left out, stuck in f_0, and a force beside it."""

    force: ActingForce

    def further(
        self, values: Float[Array, " 5"], oscillator: ModalOscillator, q: Float[Array, " N"]
    ) -> tuple[Beside, Array]:
        """The joint's slip, and the force in proportion to its size."""
        slip, stuck = ActingJoint().further(values[:JOINT_VALUES], oscillator, q)
        push, _ = self.force.further(values[JOINT_VALUES:], oscillator, q)
        return jax.tree.map(jnp.add, slip, push), stuck

    def at(self, effect: PlacedEffect | None, q: Array, which: int, omega: float) -> "ActingBoth":
        """At other amplitudes, or with a force of another shape."""
        assert effect is not None
        assert effect.force is not None
        return ActingBoth(self.force.at(PlacedEffect(effect.force, effect.shape), q, which, omega))


class Neighbour(NamedTuple):
    """A force that hardens or softens without loss, and its size where it acts alone."""

    kind: ForceKind
    size: float


def elastic_neighbours(found: Sequence[ModeFit], room: int) -> list[Neighbour]:
    """Forces of fits that take nothing from a cycle: what beside a joint changes stiffness only.

    Parameters
    ----------
    found : sequence of SteadyFit
        With a force beside the model.
    room : int
        Measured values beyond those that the model with a joint left out adjusts.
    """
    kept = []
    for fit in found:
        effect, acting = fit.effect, fit.problem.acting
        if effect is None or not isinstance(acting, ActingForce):
            continue
        assert isinstance(effect.kind, ForceKind)
        loss, q = np.asarray(acting.unit.loss), np.asarray(fit.problem.measured.q)
        turned = np.abs(np.asarray(acting.unit.stiffness)[1]) * q**2
        lossless = float(np.abs(loss).sum()) <= settings().steady.lossless * float(turned.sum())
        added = len(effect.sizes) + (effect.shape_info is not None)
        if lossless and added < room:
            kept.append(Neighbour(effect.kind, float(fit.values[0])))
    return kept


def fit_with_both(
    joined: ModeFit, kind: ForceKind, size: float, random: np.random.Generator
) -> ModeFit | None:
    """A joint left out and a force beside it; None where curves cannot show the force.

    From the joint as it is without the force, stronger and weaker, with sizes of the force up to
    what the curves would ask of it alone; shapes as of a force alone.

    Parameters
    ----------
    joined : SteadyFit
        The model with the joint that was left out.
    kind : ForceKind
        The force.
    size : float
        To begin with beside random ones: of the force where it acts alone.
    random : Generator
        Of the starts.
    """
    known, measured = settings().steady, joined.problem.measured
    q, omega = np.asarray(about(measured.q)), omega_of(measured)
    begin = kind.shapes(Scales(float(q.max()), 2.0 * math.pi / omega))
    assert joined.effect is not None
    joined_kind, own_values = joined.effect.kind, joined.problem.beside
    assert isinstance(own_values, JointValues)
    joints = np.tile(joined.theta, (known.starts, 1))
    strengths = np.geomspace(*known.both, known.starts)[:, None]
    joints[:, joined.problem.places[:2]] *= strengths

    def at(shape: float) -> ModeFit | None:
        unit = unit_on(PlacedEffect(kind, shape), measured.q, omega)
        if not shows(unit, q):
            return None
        largest = largest_size(measured, unit)
        starts = with_sizes(joints, kind, largest, random)
        starts[::2, -1] = size
        own = Size(jnp.asarray(largest), jnp.asarray(float(kind.positive)))
        problem = ModeProblem(
            measured=measured,
            chart=joined.problem.chart,
            names=(*joined.problem.names, "size"),
            reference=joined.problem.reference,
            base=joined.problem.base,
            beside=JointAndSize(own_values, own),
            acting=ActingBoth(ActingForce(unit)),
        )
        effect = PlacedEffect(joined_kind, shape, force=kind)
        return searched(effect, problem, starts, known.runs)

    return best_shape(kind, begin, at)
