"""Curves of one mode, with a force, another mode or a joint left out beside its joint."""

import math
from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.effects.kinds import ForceKind, NamedKind
from iwanjax.estimation.parameters import Chart, drawn
from iwanjax.identification.steady.cycle import (
    AbstractActing,
    ActingForce,
    ActingJoint,
    ActingMode,
    InteractingMode,
    shows,
    unit_on,
)
from iwanjax.identification.steady.fit import (
    AbstractEffectValues,
    AbstractSteadyProblem,
    JointValues,
    PlacedEffect,
    Size,
    SteadyFit,
    best_of,
    joints_to_begin_with,
    searched,
    with_sizes,
)
from iwanjax.identification.steady.shapes import as_joint, best_shape
from iwanjax.joints import Iwan4
from iwanjax.joints.force_law import Scales
from iwanjax.joints.iwan import IWAN_PARAMETERS
from iwanjax.quasistatic.modal import Beside, about
from iwanjax.settings.stages import settings
from iwanjax.updating.modal import ModalProblem, modal_parameters, modal_problem
from iwanjax.updating.problem import AbstractProblem, Measured, Reference


class AbstractCurvesProblem(AbstractSteadyProblem, AbstractProblem):
    """What all problems of curves share: frequency and damping are compared, level by level."""

    @property
    def count(self) -> int:
        """Frequencies and damping ratios."""
        return 2 * self.measured.q.size

    @property
    def unknowns(self) -> int:
        """Values that are adjusted beside the effect's, each curve's shift among them."""
        return super().unknowns + len(self.measured.slices) * (self.reference == "shift")

    def series(self, residuals: np.ndarray) -> tuple[np.ndarray, ...]:
        """Frequency and damping side by side, of each curve."""
        both = residuals.reshape(2, -1).T
        return tuple(both[part] for part in self.measured.slices)

    def model(self, theta: Float[Array, " parameters"]) -> eqx.Module:
        """The model without the effect."""
        return self.base.model(theta[: -self.beside.count])


class ModeProblem(AbstractCurvesProblem):
    """A mode's joint and what acts beside it, held against measured curves."""

    measured: Measured
    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)
    base: ModalProblem
    beside: AbstractEffectValues
    acting: AbstractActing

    def improved(self, theta: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """The base's, beside a force."""
        if not isinstance(self.acting, ActingForce):
            return theta
        n = self.beside.count
        return jnp.concatenate([self.base.improved(theta[:-n]), theta[-n:]])

    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """What a ring-down shows at the measured amplitudes."""
        return self.at(theta, self.measured.q, self.acting, self.measured.largest)

    def at(
        self,
        theta: Float[Array, " parameters"],
        q: Float[Array, " levels"],
        acting: AbstractActing,
        largest: Array | None,
    ) -> tuple[Array, Array]:
        """What it shows at others."""
        n = self.beside.count
        oscillator = self.base.model(theta[:-n])
        further, stuck = acting.further(theta[-n:], oscillator, q)
        f, zeta = oscillator.ringdown_frequency_and_damping(q, further, largest=largest)
        return jnp.where(oscillator.K_inf > stuck, f, jnp.nan), zeta

    def reshaped(self, effect: PlacedEffect) -> "ModeProblem":
        """The same with a force of another shape."""
        acting = self.acting.at(effect, self.measured.q, 0, omega_of(self.measured))
        return eqx.tree_at(lambda p: p.acting, self, acting)

    def predicted(
        self,
        theta: Array,
        effect: PlacedEffect | None,
        measured: Sequence[ModalCurves],
        which: int,
    ) -> tuple[ModalCurves, ...]:
        """The model at the amplitudes of the mode's curves, in their order."""
        found, omega = [], omega_of(self.measured)
        for i, curves in enumerate(measured):
            seen = curves.as_quantity("displacement")
            acting = self.acting.at(effect, seen.amplitude, i, omega)
            f, zeta = _at(self, theta, seen.amplitude, acting, seen.largest)
            found.append(as_measured(curves, f, zeta))
        return tuple(found)


ModeFit = SteadyFit[ModeProblem]


def as_measured(
    curves: ModalCurves, f: Array | np.ndarray, zeta: Array | np.ndarray
) -> ModalCurves:
    """Frequency and damping of a model at the amplitudes of measured curves."""
    return ModalCurves(
        curves.amplitude, f, zeta, quantity=curves.quantity, unit=curves.unit, name=curves.name
    )


def fit_alone(base: ModalProblem, draws: np.ndarray) -> ModeFit:
    """The joint alone, from draws of its parameters (starts, parameters)."""
    problem = _with_force(base, unit_on(None, base.measured.q, 0.0), 1.0, False)
    return searched(
        None, problem, np.column_stack([draws, np.zeros(len(draws))]), settings().steady.runs
    )


def fit_beside(
    alone: ModeFit, kind: ForceKind, draws: np.ndarray, random: np.random.Generator
) -> ModeFit | None:
    """The joint and a force; None where curves cannot show the force.

    Shapes are tried on a grid about those that the catalogue begins with, then nearer to the
    best, from the joint as it is alone and from some of the draws; the best then from all.
    """
    base = alone.problem.base
    q, omega = np.asarray(about(base.measured.q)), omega_of(base.measured)
    begin = kind.shapes(Scales(float(q.max()), 2.0 * math.pi / omega))
    few = joints_to_begin_with(alone, draws)

    def at(shape: float, joints: np.ndarray = few) -> ModeFit | None:
        effect = PlacedEffect(kind, shape)
        unit = unit_on(effect, base.measured.q, omega)
        if not shows(unit, q):
            return None
        largest = largest_size(base.measured, unit)
        problem = _with_force(base, unit, largest, kind.positive)
        starts = with_sizes(joints, kind, largest, random)
        return searched(effect, problem, starts, settings().steady.runs)

    best = best_shape(kind, begin, at)
    if best is None or best.effect is None:
        return None
    again = at(best.effect.shape, draws)
    return best if again is None else best_of([best, again])


def gives_energy(fit: ModeFit) -> bool:
    """Whether a fit's force works on the mode instead of taking from it."""
    acting = fit.problem.acting
    if not isinstance(acting, ActingForce):
        return False
    loss, q = np.asarray(acting.unit.loss), np.asarray(fit.problem.measured.q)
    turned = np.abs(np.asarray(acting.unit.stiffness)[1]) * q**2
    work = float(np.sign(fit.theta[-1]) * loss.sum())
    return work < -settings().steady.lossless * float(turned.sum())


def fit_with_joint(
    alone: ModeFit,
    kind: NamedKind,
    curves: Sequence[ModalCurves],
    limits: Sequence[ModeFit],
    random: np.random.Generator,
) -> ModeFit:
    """The joint and another one.

    From joints of all strengths that slip within the measured amplitudes, and from the sliders
    that were found beside the joint: what a joint has for its limit never fits better than it.

    Parameters
    ----------
    alone : SteadyFit
        The joint alone.
    kind : NamedKind
        What another one is called.
    curves : sequence of ModalCurves
        Those that are fitted.
    limits : sequence of SteadyFit
        Those beside the joint, the best first.
    random : Generator
        Of the starts.
    """
    base = alone.problem.base
    known = settings().steady
    row = tuple(modal_parameters(Iwan4, curves).values())
    own = modal_problem(Iwan4, curves, row, base.reference)
    names = tuple(info.name for info in IWAN_PARAMETERS)
    # The first two of its own are the mode's frequency and damping, the base's affair.
    problem = _problem(base, names, JointValues(own, 2), ActingJoint())
    draws = own.spread(drawn(row, random, known.starts))
    others = np.asarray(_improved(own, jnp.asarray(draws)))[:, 2:]
    # Over what the curves' fall of frequency alone would ask for.
    strengths = np.resize(known.strengths, known.starts)[:, None]
    others = np.where([name in ("F_S", "K_T") for name in own.names[2:]], strengths, 1.0) * others
    starts = np.column_stack([np.tile(alone.theta[:-1], (known.starts, 1)), others])
    runs, largest = known.joint_runs, float(np.max(base.measured.q))
    for i, fit in enumerate(limits[: runs - 1]):
        starts[-1 - i * known.starts // runs] = np.append(_stuck(fit), as_joint(kind, fit, largest))
    return searched(PlacedEffect(kind), problem, starts, runs)


def fit_coupled(
    base: ModalProblem,
    own: ModalProblem,
    joint: np.ndarray,
    draws: np.ndarray,
    kind: NamedKind,
    interacting: InteractingMode,
) -> ModeFit | None:
    r"""The joint and another mode that moves it; None where that did not move at all.

    Hits that another mode makes differ are taken to repeat badly by whom does not know of it: the
    deviations :math:`s` of ``base`` hold their scatter. The other mode has to explain it within
    the estimator's own, :math:`\sigma`, but for a common factor T. Both are Gaussian, so that
    :math:`\sum e^2/s^2` of the joint alone is to be compared with

    .. math:: \frac{1}{T}\sum\frac{e^2}{\sigma^2} + N \ln T + 2 \sum\ln\frac{\sigma}{s},
              \qquad T = \max\left(1, \frac{1}{N}\sum\frac{e^2}{\sigma^2}\right)

    Parameters
    ----------
    base : ModalProblem
        The joint alone.
    own : ModalProblem
        The same with the estimator's deviations; ``base`` itself where these are the same.
    joint : (parameters,) array
        Where the joint alone ended.
    draws : (starts, parameters) array
        Others to begin with: where the other mode moves the joint more than its own, the joint
        alone ends far from the truth.
    kind : NamedKind
        What it is called.
    interacting : InteractingMode
        The other mode.
    """

    def moved(base: ModalProblem) -> ModeProblem:
        measured = base.measured
        acting = ActingMode.of(interacting, omega_of(measured), len(measured.slices))
        return _problem(base, ("ratio",), Size(jnp.ones(()), jnp.ones(())), acting)

    if not any(np.any(each > 0.0) for each in interacting.amplitude[: len(base.measured.slices)]):
        return None
    known = settings().steady
    joints = np.concatenate([joint[None], draws[:: known.every]])
    starts = np.concatenate(
        [np.column_stack([joints, np.full(len(joints), ratio)]) for ratio in known.ratios]
    )
    effect = PlacedEffect(kind)
    first = searched(effect, moved(base), starts, len(known.ratios), len(starts), known.rough)
    starts = np.tile(first.theta, (len(known.nearer), 1))
    starts[:, -1] *= known.nearer
    fit = searched(effect, moved(own), starts, 1, len(starts), known.fine)
    return replace(fit, cost=_worth(base, own, fit.left))


def _worth(base: ModalProblem, own: ModalProblem, left: float) -> float:
    """A sum of squares over own deviations, as one over the base's."""
    if own is base:
        return left
    deviations = [
        np.concatenate([np.asarray(each.frequency_std), np.asarray(each.damping_std)])
        for each in (own.measured, base.measured)
    ]
    count = len(deviations[0])
    factor = max(1.0, left / count)
    narrower = float(np.sum(np.log(deviations[0] / deviations[1])))
    return left / factor + count * math.log(factor) + 2.0 * narrower


def _with_force(base: ModalProblem, unit: Beside, scale: float, positive: bool) -> ModeProblem:
    size = Size(jnp.asarray(scale), jnp.asarray(float(positive)))
    return _problem(base, ("size",), size, ActingForce(unit))


def _problem(
    base: ModalProblem, names: tuple[str, ...], values: AbstractEffectValues, acting: AbstractActing
) -> ModeProblem:
    return ModeProblem(
        measured=base.measured,
        chart=base.chart,
        names=(*base.names, *names),
        reference=base.reference,
        base=base,
        beside=values,
        acting=acting,
    )


def largest_size(measured: Measured, unit: Beside) -> float:
    """Size at which a force alone would make the changes that were measured."""
    q, f, zeta = (np.asarray(x) for x in (measured.q, measured.frequency, measured.damping))
    omega2 = (2.0 * math.pi * f) ** 2
    k, loss = np.asarray(unit.stiffness)[1], np.asarray(unit.loss) / (2.0 * math.pi * q**2)
    each = [
        float(change / largest)
        for change, largest in ((np.ptp(omega2), np.ptp(k)), (np.ptp(zeta * omega2), np.ptp(loss)))
        if largest > 0 and change > 0
    ]
    return min(each)


def _stuck(fit: ModeFit) -> np.ndarray:
    """The joint's parameters, f_0 with the slider stuck."""
    theta = fit.theta[:-1].copy()
    theta[0] = math.sqrt(theta[0] ** 2 + float(fit.theta[-1]) / (2.0 * math.pi) ** 2)
    return theta


def omega_of(measured: Measured) -> float:
    """Circular frequency of the cycles that forces are worked out for, rad/s."""
    return 2.0 * math.pi * float(np.mean(np.asarray(measured.frequency)))


@eqx.filter_jit
def _improved(own: ModalProblem, draws: Array) -> Array:
    return jax.vmap(own.improved)(draws)


@eqx.filter_jit
def _at(
    problem: ModeProblem, theta: Array, q: Array, acting: AbstractActing, largest: Array | None
) -> tuple[Array, Array]:
    return problem.at(theta, q, acting, largest)
