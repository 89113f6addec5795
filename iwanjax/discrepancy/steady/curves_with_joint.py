"""Curves of one mode, with a joint left out beside its own."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.effects import Kind
from iwanjax.discrepancy.evidence import correlation_time
from iwanjax.discrepancy.steady.curves import CurveFit
from iwanjax.discrepancy.steady.left_out import VALUES, AddedJoint, as_slider
from iwanjax.discrepancy.steady.one_joint import Deviations, linearised
from iwanjax.discrepancy.steady.starts import least_cost, slopes
from iwanjax.joints import Iwan4
from iwanjax.joints.iwan import IWAN_PARAMETERS
from iwanjax.quasistatic.modal import Beside, about
from iwanjax.updating.modal import ModalProblem, modal_parameters, modal_problem
from iwanjax.updating.parameters import Chart, drawn
from iwanjax.updating.problem import AbstractProblem, Measured, Reference

# Starts of a search, those of them that are run, and the strengths of the joint left out to begin
# with, over what the curves' fall of frequency alone would ask for.
_STARTS, _RUNS, _STRENGTHS = 16, 8, (1.0, 0.1)


class WithJoint(AbstractProblem):
    """A mode's joint and another beside it, held against measured curves.

    Parameters are those of ``base`` and the other joint's, which moves in the variables of a mode
    that has it alone (``own``). f_0 is with both stuck.
    """

    measured: Measured
    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)
    base: ModalProblem
    own: ModalProblem

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """The base's parameters, then the other joint's."""
        # The first two of its own are the mode's frequency and damping, the base's affair.
        other = self.own.to_values(jnp.concatenate([jnp.zeros(2), z[-VALUES:]]))
        return jnp.concatenate([self.base.to_values(z[:-VALUES]), other[2:]])

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        other = jnp.concatenate([theta[:2], theta[-VALUES:]])
        z = self.own.to_variables(other)[2:]
        return jnp.concatenate([self.base.to_variables(theta[:-VALUES]), z])

    def model(self, theta: Float[Array, " parameters"]) -> eqx.Module:
        """The oscillator without the other joint's slip."""
        return self.base.model(theta[:-VALUES])

    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """What a ring-down shows at the measured amplitudes."""
        return self.at(theta, self.measured.q)

    def at(self, theta: Float[Array, " parameters"], q: Array) -> tuple[Array, Array]:
        """What it shows at others."""
        oscillator = self.base.model(theta[:-VALUES])
        joint = Iwan4(*theta[-VALUES:])
        further = Beside(
            joint.harmonic_stiffness(about(q)) - joint.K_T,
            joint.tip_stiffness(q) - joint.K_T,
            joint.dissipation(q),
        )
        f, zeta = oscillator.ringdown_frequency_and_damping(q, further)
        return jnp.where(oscillator.K_inf > joint.K_T, f, jnp.nan), zeta


@dataclass(frozen=True, eq=False)
class JointFit:
    """A mode's curves explained by its joint and another one.

    Attributes
    ----------
    force : AddedJoint
        The kind.
    problem : WithJoint
        What was searched.
    theta : (parameters,) array
        Where it ended; the last are the other joint's.
    cost : float
        Sum of squared residuals over their deviations.
    """

    force: AddedJoint
    problem: WithJoint
    theta: np.ndarray
    cost: float

    @property
    def unknowns(self) -> int:
        """Values that were adjusted."""
        return len(self.problem.base.chart.free) + VALUES

    @property
    def count(self) -> int:
        """Values that were measured."""
        return 2 * self.problem.measured.q.size

    @property
    def gives_energy(self) -> bool:
        """A joint never does."""
        return False

    def predicted(self, curves: ModalCurves, which: int = 0) -> ModalCurves:
        """The model at the amplitudes of other curves of the mode, whichever it is."""
        q = curves.as_quantity("displacement").amplitude
        f, zeta = _at(self.problem, jnp.asarray(self.theta), q)
        return ModalCurves(
            curves.amplitude, f, zeta, quantity=curves.quantity, unit=curves.unit, name=curves.name
        )

    def correlation(self) -> float:
        """Correlation time of the residuals in levels, mean over the curves."""
        problem = self.problem
        found = _at(problem, jnp.asarray(self.theta), problem.measured.q)
        both = np.stack([np.asarray(x) for x in problem.compared(*found)], axis=1)
        parts = (both[part] for part in problem.measured.slices)
        return float(np.mean([correlation_time(part[None]) for part in parts]))

    def added(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters of the joint left out, and their deviations, linearised."""
        found = np.asarray(slopes(self.problem, jnp.asarray(self.theta)))
        std = linearised(found, self.cost, self.correlation())
        return self.theta[-VALUES:], std[-VALUES:]

    def deviations(self) -> Deviations:
        """Of what has neither size nor shape."""
        return Deviations(math.nan, math.nan, math.nan)


def fit_with_joint(
    alone: CurveFit,
    kind: Kind,
    curves: Sequence[ModalCurves],
    found: Sequence[CurveFit],
    random: np.random.Generator,
) -> JointFit:
    """The joint and another one.

    From joints of all strengths that slip within the measured amplitudes, and from the sliders
    that were found beside the joint: what a joint has for its limit never fits better than it.

    Parameters
    ----------
    alone : CurveFit
        The joint alone.
    kind : Kind
        What another one is called.
    curves : sequence of ModalCurves
        Those that are fitted.
    found : sequence of CurveFit
        Forces beside the joint.
    random : Generator
        Of the starts.
    """
    base = alone.problem.base
    row = tuple(modal_parameters(Iwan4, curves).values())
    own = modal_problem(Iwan4, curves, row, base.reference)
    problem = WithJoint(
        measured=base.measured,
        chart=base.chart,
        names=(*base.names, *(info.name for info in IWAN_PARAMETERS)),
        reference=base.reference,
        base=base,
        own=own,
    )
    draws = own.spread(drawn(row, random, _STARTS))
    others = np.asarray(_improved(own, jnp.asarray(draws)))[:, 2:]
    strengths = np.resize(_STRENGTHS, _STARTS)[:, None]
    others = np.where([name in ("F_S", "K_T") for name in own.names[2:]], strengths, 1.0) * others
    starts = np.column_stack([np.tile(alone.theta[:-1], (_STARTS, 1)), others])
    for i, fit in enumerate(_sliders(found)[: _RUNS - 1]):
        slider = as_slider(float(fit.theta[-1]), fit.force.shape if fit.force else 1.0)
        starts[-1 - i * _STARTS // _RUNS] = np.append(_stuck(fit), slider)
    cost, theta = least_cost(problem, starts, _STARTS, _RUNS)
    return JointFit(AddedJoint(kind), problem, theta, cost)


def _sliders(found: Sequence[CurveFit]) -> list[CurveFit]:
    """Sliders beside the joint, the best first."""
    sliders = [
        fit for fit in found if fit.force is not None and fit.force.kind.name == "coulomb_friction"
    ]
    return sorted(sliders, key=lambda each: each.cost)


def _stuck(fit: CurveFit) -> np.ndarray:
    """The joint's parameters, f_0 with the slider stuck."""
    theta = fit.theta[:-1].copy()
    theta[0] = math.sqrt(theta[0] ** 2 + float(fit.theta[-1]) / (2.0 * math.pi) ** 2)
    return theta


@eqx.filter_jit
def _improved(own: ModalProblem, draws: Array) -> Array:
    return jax.vmap(own.improved)(draws)


@eqx.filter_jit
def _at(problem: WithJoint, theta: Array, q: Array) -> tuple[Array, Array]:
    return problem.at(theta, q)
