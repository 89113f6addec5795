"""Loops of a joint on its own, with another joint beside it."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.effects import Kind
from iwanjax.discrepancy.evidence import correlation_time
from iwanjax.discrepancy.steady.left_out import VALUES, AddedJoint, as_slider
from iwanjax.discrepancy.steady.loops import JointAndForce, LoopFit, LoopHistories
from iwanjax.discrepancy.steady.one_joint import Deviations, linearised
from iwanjax.discrepancy.steady.starts import least_cost, slopes
from iwanjax.joints import Iwan4
from iwanjax.joints.hysteresis import hysteresis
from iwanjax.joints.iwan import IWAN_PARAMETERS
from iwanjax.updating.parameters import Chart
from iwanjax.updating.problem import AbstractLeastSquares
from iwanjax.updating.structural import joint_parameters

# Shares of the largest force, and deflections over the largest, at which the other joint slips to
# begin with; starts of a search, and those of them that are run.
_SHARES, _SLIPS, _STARTS, _RUNS = (0.5, 0.1), (1.0, 0.1, 0.3, 3.0), 16, 4


class TwoJoints(AbstractLeastSquares):
    """A joint and another beside it, held against loops as one with a force of size zero is."""

    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    base: JointAndForce
    own: Chart

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """The joint's parameters, then the other's."""
        mine = self.base.chart.to_values(z[:-VALUES])
        return jnp.concatenate([mine, self.own.to_values(z[-VALUES:])])

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        mine = self.base.chart.to_variables(theta[:-VALUES])
        return jnp.concatenate([mine, self.own.to_variables(theta[-VALUES:])])

    def along(
        self, theta: Float[Array, " parameters"], loops: LoopHistories
    ) -> Float[Array, "loops N"]:
        """What the other joint does along deflections."""
        return hysteresis(Iwan4(*theta[-VALUES:]), loops.d, sliders=None)

    def joined(self, theta: Float[Array, " parameters"], loops: LoopHistories) -> JointAndForce:
        """The joint with what the other does as a force of size one."""
        both = (loops, self.along(theta, loops))
        return eqx.tree_at(lambda p: (p.loops, p.unit), self.base, both)

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """Predicted less measured over deviations, each loop without its mean."""
        return self.joined(theta, self.base.loops).residuals(jnp.append(theta[:-VALUES], 1.0))

    def predict(self, theta: Float[Array, " parameters"], loops: LoopHistories) -> Array:
        """Forces along deflections, without offsets."""
        return self.joined(theta, loops).predict(jnp.append(theta[:-VALUES], 1.0))


@dataclass(frozen=True, eq=False)
class TwoJointsFit:
    """Loops explained by a joint and another one.

    Attributes
    ----------
    force : AddedJoint
        The kind.
    problem : TwoJoints
        What was searched.
    theta : (parameters,) array
        Where it ended; the last are the other joint's.
    cost : float
        Sum of squared residuals over their deviations.
    """

    force: AddedJoint
    problem: TwoJoints
    theta: np.ndarray
    cost: float

    @property
    def unknowns(self) -> int:
        """Values that were adjusted."""
        return len(self.problem.base.chart.free) + VALUES

    @property
    def count(self) -> int:
        """Values that were measured."""
        return int(np.count_nonzero(np.asarray(self.problem.base.loops.weight)))

    def forces(self, loops: LoopHistories) -> np.ndarray:
        """Predicted, without offsets, (loops, N)."""
        return np.asarray(_predicted(self.problem, jnp.asarray(self.theta), loops))

    def correlation(self) -> float:
        """Correlation time of the residuals in values, mean over the loops."""
        loops = self.problem.base.loops
        weight = np.asarray(loops.weight)
        off = (self.forces(loops) - np.asarray(loops.force)) * weight
        used = [row[w > 0][None, :, None] for row, w in zip(off, weight, strict=True) if w.any()]
        return float(np.mean([correlation_time(row - row.mean()) for row in used]))

    def added(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters of the other joint, and their deviations, linearised."""
        found = np.asarray(slopes(self.problem, jnp.asarray(self.theta)))
        std = linearised(found, self.cost, self.correlation())
        return self.theta[-VALUES:], std[-VALUES:]

    def deviations(self) -> Deviations:
        """Of what has neither size nor shape."""
        return Deviations(math.nan, math.nan, math.nan)


def loops_with_joint(alone: LoopFit, kind: Kind, found: Sequence[LoopFit]) -> TwoJointsFit:
    """The joint and another one.

    From other joints of some strengths and slips, and from the sliders that were found beside
    the joint: what a joint has for its limit never fits better than it.

    Parameters
    ----------
    alone : LoopFit
        The joint alone.
    kind : Kind
        What another one is called.
    found : sequence of LoopFit
        Forces beside the joint.
    """
    base = alone.problem
    force, deflection = float(jnp.ptp(base.loops.force)) / 2.0, base.loops.largest
    given = _joint(0.5 * force, deflection)
    problem = TwoJoints(
        chart=base.chart,
        names=(*base.names[:-1], *(info.name for info in IWAN_PARAMETERS)),
        base=eqx.tree_at(lambda p: p.unit, base, jnp.zeros_like(base.loops.d)),
        own=Chart(tuple(joint_parameters("other", Iwan4(*given)).values())),
    )
    others = [
        _joint(share * force, slip * deflection)
        for share, slip in itertools.product(_SHARES, _SLIPS)
    ]
    sliders = [
        fit for fit in found if fit.force is not None and fit.force.kind.name == "coulomb_friction"
    ]
    starts = [np.append(alone.theta[:-1], other) for other in others]
    for fit in sorted(sliders, key=lambda each: each.cost)[: _RUNS - 1]:
        assert fit.force is not None
        slider = as_slider(float(fit.theta[-1]), fit.force.shape)
        starts.insert(0, np.append(fit.theta[:-1], slider))
    rows = np.resize(np.array(starts), (_STARTS, len(starts[0])))
    cost, theta = least_cost(problem, rows, _STARTS, _RUNS)
    return TwoJointsFit(AddedJoint(kind), problem, theta, cost)


def _joint(F_S: float, slip: float) -> np.ndarray:
    """Parameters of a joint of some strength, whose mean slider slips at a deflection."""
    return np.array([F_S, F_S / slip, -0.5, 1.0])


@eqx.filter_jit
def _predicted(problem: TwoJoints, theta: Array, loops: LoopHistories) -> Array:
    return problem.predict(theta, loops)
