"""A mode's joint that another mode moves as well, against the mode's curves."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.effects import ModeKind
from iwanjax.discrepancy.evidence import correlation_time
from iwanjax.discrepancy.steady.one_joint import (
    Deviations,
    MovedJoint,
    linearised,
    to_size,
    to_variable,
)
from iwanjax.discrepancy.steady.starts import least_cost, slopes
from iwanjax.joints import AbstractJoint
from iwanjax.quasistatic.modal import Beside
from iwanjax.updating.modal import ModalProblem
from iwanjax.updating.parameters import Chart
from iwanjax.updating.problem import AbstractProblem, Measured, Reference

# Samples per cycle of the faster mode, cycles of the slower one that are averaged over after some
# in which the sliders forget the start, and sliders of an Iwan joint.
_SAMPLES, _CYCLES, _SETTLING, _SLIDERS = 32, 24, 6, 100
_BLOCK = 256
# Phase of the other mode at the start, of a turn: no simple share of one.
_PHASE = 0.5 * (math.sqrt(5.0) - 1.0)
# Ratios to begin with, one search from the best of some joints with each; every so many of the
# joints that the fit of the joint alone began with; and ratios over what was found for a second
# search.
_RATIOS, _EVERY, _NEARER = (0.1, 0.3, 1.0, 3.0), 16, (1.0, 0.9, 1.1, 1.3)

# Tolerances of the searches: each step takes a motion of some thousand samples.
_ROUGH, _FINE = 1e-3, 1e-5


class InteractingMode(NamedTuple):
    """Another mode that moved while one rang down.

    Attributes
    ----------
    name : str
        Its own.
    frequency : float
        Hz.
    amplitude : tuple of (levels,) arrays
        Displacement at the same sensor while each curve of the one was at each of its levels, in
        the order of the curves, those held out last.
    """

    name: str
    frequency: float
    amplitude: tuple[np.ndarray, ...]


class WithInteractingMode(AbstractProblem):
    r"""A mode's joint that is moved by q sin(omega t) and, ratio times, by another mode.

    Attributes
    ----------
    other : (N,) array
        Amplitude of the other mode at each measured level.
    omega : (2,) array
        Circular frequencies of the mode and of the other, rad/s.
    steps : int
        Of the motion that is averaged over.
    """

    measured: Measured
    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)
    base: ModalProblem
    other: Float[Array, " N"]
    omega: Float[Array, " 2"]
    steps: int = eqx.field(static=True)

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """The base's parameters; the ratio moves by its logarithm."""
        ratio = to_size(z[-1], jnp.ones(()), jnp.ones(()))
        return jnp.append(self.base.to_values(z[:-1]), ratio)

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        variable = to_variable(theta[-1], jnp.ones(()), jnp.ones(()))
        return jnp.append(self.base.to_variables(theta[:-1]), variable)

    def model(self, theta: Float[Array, " parameters"]) -> eqx.Module:
        """The oscillator on its own."""
        return self.base.model(theta[:-1])

    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """What a ring-down shows at the measured amplitudes."""
        return self.at(theta, self.measured.q, self.other, self.measured.largest)

    def at(
        self,
        theta: Float[Array, " parameters"],
        q: Float[Array, " N"],
        other: Float[Array, " N"],
        largest: Array | None,
    ) -> tuple[Array, Array]:
        """What it shows at others."""
        oscillator = self.base.model(theta[:-1])
        further = moved_by_both(oscillator.joint, q, theta[-1] * other, self.omega, self.steps)
        f, zeta = oscillator.ringdown_frequency_and_damping(q, further, largest=largest)
        return jnp.where(oscillator.K_inf > 0, f, jnp.nan), zeta


def moved_by_both(
    joint: AbstractJoint,
    q: Float[Array, " N"],
    other: Float[Array, " N"],
    omega: Float[Array, " 2"],
    steps: int,
) -> Beside:
    r"""What a second motion changes of a joint's first harmonic and loss in the first.

    .. math:: d = q\cos\theta + Q\cos\Theta, \qquad
              C = 2\,\langle F\,e^{-i\theta}\rangle, \qquad
              k_1 = \frac{\mathrm{Re}\,C}{q}, \qquad D = \pi q\,\mathrm{Im}\,C,

    less the same with Q = 0: averages over one long motion of the joint's sliders, weighted by
    a smooth window (Das et al. 2017), as for :func:`iwanjax.coupled_modes`.

    Parameters
    ----------
    joint : AbstractJoint
        Per unit modal mass.
    q, other : (N,) array
        Amplitudes of the joint's deflection, q and Q.
    omega : (2,) array
        Circular frequencies of both, rad/s.
    steps : int
        Of the motion.

    Returns
    -------
    Beside
        (N,) each; of the slope at the tip the change is taken to be that of k_1.
    """
    element = joint.discrete(_SLIDERS)
    dt = 2.0 * math.pi / (_SAMPLES * jnp.max(omega))
    settling = steps * _SETTLING // _CYCLES
    x = (np.arange(steps) + 0.5) / steps
    window = np.concatenate([np.zeros(settling), np.exp(-1.0 / (x * (1.0 - x)))])
    window = jnp.asarray(2.0 * window / window.sum())

    def average(one: Array, two: Array) -> Array:
        def advance(state, k):
            theta, Theta = omega[0] * dt * k, omega[1] * dt * k + 2.0 * math.pi * _PHASE
            d = one * jnp.cos(theta) + two * jnp.cos(Theta)
            v = -one * omega[0] * jnp.sin(theta) - two * omega[1] * jnp.sin(Theta)
            reaction = element.step(d, v, dt, state[0])
            turn = jnp.stack([jnp.cos(theta), -jnp.sin(theta)])
            return (reaction.state, state[1] + window[k] * reaction.force * turn), None

        start = (element.init(), jnp.zeros(2))
        return jax.lax.scan(advance, start, jnp.arange(settling + steps))[0][1]

    both, own = (jax.vmap(average)(q, Q) for Q in (other, jnp.zeros_like(other)))
    k, loss = ((both - own) / q[:, None]).T * jnp.stack([jnp.ones_like(q), math.pi * q**2])
    return Beside(jnp.broadcast_to(k, (3, *k.shape)), k, loss)


@dataclass(frozen=True, eq=False)
class CoupledFit:
    """A mode's curves explained by its joint and by another mode that moves it.

    Attributes
    ----------
    force : MovedJoint
        The kind.
    companion : InteractingMode
        The other mode.
    problem : WithInteractingMode
        What was searched, with the estimator's deviations.
    theta : (parameters,) array
        Where it ended; the last is the ratio.
    left : float
        Sum of squared residuals over these.
    cost : float
        What the same likelihood is worth with the deviations that the joint alone is judged by.
    """

    force: MovedJoint
    interacting: InteractingMode
    problem: WithInteractingMode
    theta: np.ndarray
    left: float
    cost: float

    @property
    def unknowns(self) -> int:
        """Values that were adjusted."""
        return len(self.problem.base.chart.free) + 1

    @property
    def count(self) -> int:
        """Values that were measured."""
        return 2 * self.problem.measured.q.size

    @property
    def gives_energy(self) -> bool:
        """The joint never does."""
        return False

    def predicted(self, curves: ModalCurves, which: int) -> ModalCurves:
        """The model at the amplitudes of the curve of this number."""
        seen = curves.as_quantity("displacement")
        other = jnp.asarray(self.interacting.amplitude[which])
        f, zeta = _at(self.problem, jnp.asarray(self.theta), seen.amplitude, other, seen.largest)
        return ModalCurves(
            curves.amplitude, f, zeta, quantity=curves.quantity, unit=curves.unit, name=curves.name
        )

    def correlation(self) -> float:
        """Correlation time of the residuals in levels, mean over the curves."""
        problem = self.problem
        measured = problem.measured
        theta = jnp.asarray(self.theta)
        found = _at(problem, theta, measured.q, problem.other, measured.largest)
        both = np.stack([np.asarray(x) for x in problem.compared(*found)], axis=1)
        parts = (both[part] for part in problem.measured.slices)
        return float(np.mean([correlation_time(part[None]) for part in parts]))

    def deviations(self) -> Deviations:
        """Of the ratio, linearised; there is no shape."""
        found = linearised(
            np.asarray(slopes(self.problem, jnp.asarray(self.theta))), self.left, self.correlation()
        )
        return Deviations(float(found[-1]), math.nan, float(found[-1]))


def fit_coupled(
    base: ModalProblem,
    own: ModalProblem,
    joint: np.ndarray,
    draws: np.ndarray,
    kind: ModeKind,
    interacting: InteractingMode,
) -> CoupledFit | None:
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
    kind : ModeKind
        What it is called.
    companion : InteractingMode
        The other mode.
    """
    problem = _with(base, interacting)
    if not bool(jnp.any(problem.other > 0.0)):
        return None
    joints = np.concatenate([joint[None], draws[::_EVERY]])
    starts = np.concatenate(
        [np.column_stack([joints, np.full(len(joints), ratio)]) for ratio in _RATIOS]
    )
    _, theta = least_cost(problem, starts, len(starts), len(_RATIOS), _ROUGH)
    problem = _with(own, interacting)
    starts = np.tile(theta, (len(_NEARER), 1))
    starts[:, -1] *= _NEARER
    left, theta = least_cost(problem, starts, len(starts), 1, _FINE)
    return CoupledFit(MovedJoint(kind), interacting, problem, theta, left, _worth(base, own, left))


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


def _with(base: ModalProblem, interacting: InteractingMode) -> WithInteractingMode:
    measured = base.measured
    omega = 2.0 * math.pi * np.array([float(jnp.mean(measured.frequency)), interacting.frequency])
    return WithInteractingMode(
        measured=measured,
        chart=base.chart,
        names=(*base.names, "ratio"),
        reference=base.reference,
        base=base,
        other=jnp.asarray(np.concatenate(interacting.amplitude[: len(measured.slices)])),
        omega=jnp.asarray(omega),
        # Rounded up, so that modes of about the same ratio share a kernel.
        steps=_BLOCK * math.ceil(_CYCLES * _SAMPLES * omega.max() / omega.min() / _BLOCK),
    )


@eqx.filter_jit
def _at(
    problem: WithInteractingMode, theta: Array, q: Array, other: Array, largest: Array | None
) -> tuple[Array, Array]:
    return problem.at(theta, q, other, largest)
