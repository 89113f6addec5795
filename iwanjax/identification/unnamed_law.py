r"""A general law at a place, fitted to recordings beside the joints.

Its strengths are linear in the force, each with a Gaussian prior about zero whose deviation is
that of its group (the spline, saturating dampers, sliders, each power of the motion), and none but
the spring's are negative. The search is that of every hypothesis: Gauss-Newton on the innovations
of an observer of a longer and longer memory, up to the free run. Between memories each group's
deviation :math:`s` is set to

.. math:: s^2 = \frac{\sum_i w_i^2}{\sum_i \gamma_i}, \qquad
          \gamma_i = 1 - \frac{C_{ii}}{s^2}

by its strengths w and their covariance C (MacKay, Neural Computation 4, 1992, Eq. 3.20):
:math:`\sum\gamma` is how many of them the recordings determine.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.effects.kinds import UnnamedKind
from iwanjax.estimation.evidence import MODEL_ERROR_ALLOWANCE
from iwanjax.identification.hypotheses import LawStart, with_law
from iwanjax.identification.joint_priors import FreeLaw, joints_of
from iwanjax.identification.likelihood import covariance, left_by_noise
from iwanjax.identification.multistart import (
    SHORT_TIME_CONSTANT,
    HypothesisFit,
    multistart,
)
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.identification.receptance import nearest_oscillators
from iwanjax.joints import PlaceMotion, UnnamedLaw
from iwanjax.joints.unnamed_terms import (
    BANKS,
    ELASTIC,
    FEW,
    GROUPS,
    LINEAR,
    PARTS,
    RESONATES,
    TERMS,
)

SHAPED = np.array([PARTS["duhem"].start, RESONATES])
"""Terms that have a shape of their own."""

# Terms that take part after others.
_WIDER = {LINEAR: FEW, FEW: BANKS}
# A group's prior deviation changes no more than this in one round, either way: what a short memory
# does not determine a longer one may.
_MOST = 10.0


@dataclass(frozen=True, eq=False)
class UnnamedFit:
    """A general law at a place, as fitted.

    Attributes
    ----------
    place : Place
        Where it acts.
    problem : HistoryProblem
        With the law as its last joint.
    fitted : HypothesisFit
        Joints and law.
    """

    place: Place
    problem: HistoryProblem
    fitted: HypothesisFit

    @property
    def law(self) -> UnnamedLaw:
        """The law, its strengths as fitted."""
        joint, z = self.joint, self.fitted.theta.mean(axis=0)[self.own]
        return joint.at(jax.device_put(np.maximum(z, joint.least)))

    @property
    def determined(self) -> np.ndarray:
        """What the recordings say of each term, 0 (nothing) to 1, (terms,)."""
        known = np.diag(covariance(self.problem, self.fitted, False))[self._strengths]
        joint, z = self.joint, self.fitted.theta.mean(axis=0)[self._strengths]
        # At its least value but for rounding: what a force is at most made of counts as none.
        held = z <= joint.least[: z.size] + 1e-9 * np.max(np.abs(z))
        found = np.zeros(len(TERMS))
        found[joint.terms] = np.where(held, 0.0, np.clip(1.0 - known, 0.0, 1.0))
        return found

    @property
    def joint(self) -> FreeLaw:
        """The law as it is fitted."""
        joint = self.problem.joints[-1]
        assert isinstance(joint, FreeLaw)
        return joint

    def onward(
        self,
        memories: Sequence[float],
        steps: int,
        in_time: Callable[[], bool] = lambda: True,
        wider: bool = True,
    ) -> "UnnamedFit":
        """The fit gone on with, with longer memories; arguments as :func:`fit_unnamed_law`.

        More terms take part where those that do leave more than noise, and stay where they gain
        more than a model may be off by: else they learn its errors, which other recordings pay for.
        Not ``wider``, none do.
        """
        found = self
        for memory in memories:
            if not in_time():
                break
            loose = loosened(found)
            known = memory, steps, in_time
            found = _searched(self.place, loose.problem, loose.fitted.start, *known)
            enough = (1.0 + MODEL_ERROR_ALLOWANCE) * left_by_noise(found.problem, memory)
            while wider and found.joint.free in _WIDER and found.fitted.cost > enough and in_time():
                more = with_terms(found, _WIDER[found.joint.free])
                other = _searched(self.place, *more, *known)
                if not other.gains_on(found):
                    break
                found = other
        return found

    def gains_on(self, other: "UnnamedFit") -> bool:
        """Whether it leaves less than a fit with fewer terms by more than models are off."""
        return self.fitted.cost < (1.0 - MODEL_ERROR_ALLOWANCE) * other.fitted.cost

    @property
    def own(self) -> slice:
        """Where the law's parameters are in theta."""
        last = self.problem.parameters
        return slice(last - self.joint.count, last)

    @property
    def _strengths(self) -> slice:
        return slice(self.own.start, self.own.start + self.joint.terms.size)


def with_unnamed_law(
    problem: HistoryProblem,
    kind: UnnamedKind,
    place: Place,
    begun: Sequence[LawStart[UnnamedLaw]],
    terms: tuple[int, ...] = FEW,
) -> tuple[HistoryProblem, list[Start]]:
    """A general law more at a place, and the search it takes.

    Parameters
    ----------
    problem : HistoryProblem
        Of the model without it.
    kind : UnnamedKind
        What to call it.
    place : Place
        Where.
    begun : sequence of LawStart
        Laws to begin with, of the scales of that place, and the joints' z.
    terms : tuple of int
        Whose strengths are fitted.
    """
    # As much force as bends the structure as far as the place has moved.
    force, loose = place.scales.deflection * place.scales.stiffness, np.zeros(len(TERMS))
    # What a group begins with may be more, and no search would keep that far beyond its prior.
    largest = np.max(np.abs([np.stack(law.strengths) for law, _ in begun]), axis=0)
    for part in GROUPS:
        loose[part] = max(force, float(np.max(largest[part])))
    joint = FreeLaw(blank_at(place), jax.device_put(loose), terms)
    predictor = eqx.tree_at(
        lambda p: (p.joints, p.stiffness, p.within),
        problem.predictor,
        (
            jnp.concatenate([problem.predictor.joints, jnp.asarray(place.row)[None]]),
            jnp.append(problem.predictor.stiffness, 0.0),
            jnp.append(problem.predictor.within, 0.0),
        ),
    )
    other = replace(
        problem, predictor=predictor, joints=(*problem.joints, joint), compiled=set(), _process={}
    )
    hypothesis = replace(other.nothing(), kinds=(kind,), where=(place.label,))
    whole = [np.concatenate([z, joint.reached(law)]) for law, z in begun]
    return other, [Start(hypothesis, other.map.given(each)) for each in whole]


def blank_at(place: Place) -> UnnamedLaw:
    """The law without any force, of the largest motions that a place has seen."""
    seen = place.scales
    rate = 2.0 * math.pi * seen.deflection / seen.period
    return UnnamedLaw.blank(seen.deflection, rate, seen.period)


def fit_unnamed_law(
    problem: HistoryProblem,
    kind: UnnamedKind,
    place: Place,
    begun: Sequence[LawStart[UnnamedLaw]],
    memories: Sequence[float],
    steps: int,
    in_time: Callable[[], bool] = lambda: True,
    terms: tuple[int, ...] = FEW,
) -> UnnamedFit:
    """The general law at a place, fitted with longer and longer memories of the observer.

    Parameters
    ----------
    problem, kind, place
        As for :func:`with_unnamed_law`.
    begun
        As for :func:`with_unnamed_law`; the best is gone on with after the first memory.
    memories : sequence of float
        Of the observer, cycles; infinite for the free run.
    steps : int
        Of each search, at most.
    in_time : function
        False when it is time to stop.
    terms
        As for :func:`with_unnamed_law`, to begin with.
    """
    here, starts = with_unnamed_law(problem, kind, place, begun, terms)
    fits = multistart(here, starts, memories[0], steps, in_time=in_time)
    found = UnnamedFit(place, here, min(fits, key=lambda each: each.cost))
    return found.onward(memories[1:], steps, in_time)


def loosened(found: UnnamedFit) -> UnnamedFit:
    """The same fit with each group's prior as wide as its strengths are."""
    problem, fitted, joint = found.problem, found.fitted, found.joint
    determined, z = found.determined, np.zeros(len(TERMS))
    z[joint.terms] = fitted.theta.mean(axis=0)[found._strengths]
    factor = np.ones(len(TERMS))
    for part in GROUPS:
        size = math.sqrt(float(np.sum(z[part] ** 2)) / max(float(np.sum(determined[part])), 1e-12))
        # Of a group of which nothing is known, as of one without terms or in a fit that broke down,
        # it stays as it is.
        here = np.isin(joint.terms, np.arange(len(TERMS))[part]).any() and math.isfinite(size)
        factor[part] = min(max(size, 1.0 / _MOST), _MOST) if here else 1.0
    wider = FreeLaw(joint.given, jax.device_put(np.array(joint.loose) * factor), joint.free)
    rescaled = replace(problem, joints=(*problem.joints[:-1], wider))
    theta = fitted.theta.copy()
    theta[:, found._strengths] /= factor[joint.terms]
    solution = replace(fitted.solution, values=theta)
    return UnnamedFit(found.place, rescaled, replace(fitted, solution=solution))


def with_terms(found: UnnamedFit, terms: tuple[int, ...]) -> tuple[HistoryProblem, Start]:
    """The search with other terms that begins as a fit has ended.

    Groups that had no term so far begin a tenth as loose as others did: they take over no more than
    what nothing else does, and grow where that is much.
    """
    problem, joint, loose = found.problem, found.joint, np.array(found.joint.loose)
    for part in GROUPS:
        if not np.any(np.isin(joint.terms, np.arange(len(TERMS))[part])):
            loose[part] /= _MOST
    other = FreeLaw(joint.given, jax.device_put(loose), terms)
    theta, own = np.atleast_2d(found.fitted.start.theta), found.own
    law = np.broadcast_to(other.reached(found.law), (len(theta), other.count))
    whole = np.concatenate([theta[:, : own.start], law, theta[:, own.stop :]], axis=1)
    joints = (*problem.joints[:-1], other)
    made = replace(problem, joints=joints, compiled=set(), _process={})
    return made, Start(found.fitted.hypothesis, whole)


def _searched(
    place: Place,
    problem: HistoryProblem,
    start: Start,
    memory: float,
    steps: int,
    in_time: Callable[[], bool],
) -> UnnamedFit:
    (fit,) = multistart(problem, [start], memory, steps, in_time=in_time)
    return UnnamedFit(place, problem, fit)


def nearest_strengths(
    place: Place, motion: PlaceMotion, force: np.ndarray, terms: np.ndarray
) -> np.ndarray:
    """Of a place's general law whose force in some motion is nearest to one.

    By least squares, each strength at least what the law allows; none where the motion or the force
    is no number. What has a shape of its own has none.

    Parameters
    ----------
    place : Place
        That the law is scaled to.
    motion : PlaceMotion
        Of the place, (recordings, N).
    force : (recordings, N) array
        To be come near to.
    terms : array of int
        Which may have any strength. Within what a place has seen splines make up any power of the
        deflection: together one would cancel the other.

    Returns
    -------
    (terms,) array
        Of all terms.
    """
    blank, strengths = blank_at(place), np.zeros(len(TERMS))
    terms = np.setdiff1d(terms, SHAPED)
    each = jnp.eye(len(TERMS))[terms]
    units = jax.vmap(lambda s: force_in(blank.with_strengths(s), motion))(each)
    from scipy.optimize import nnls  # here, because few need it and it is slow to import

    columns = np.asarray(units).reshape(len(terms), -1).T
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(force))):
        return strengths
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    columns = columns / size
    # Springs may be negative.
    elastic = int(np.sum(terms < ELASTIC))
    found, _ = nnls(np.hstack([columns, -columns[:, :elastic]]), np.ravel(force), maxiter=10**5)
    found[:elastic] -= found[len(terms) :]
    strengths[terms] = found[: len(terms)] / size
    return strengths


@eqx.filter_jit
def force_in(law: UnnamedLaw, motion: PlaceMotion) -> Array:
    """The law's force along a place's motion, from rest on: (recordings, N).

    That of masses that do not resonate by the accelerations: where an observer corrects deflections
    and rates, those are no differences of them.
    """
    element, masses = law.discrete().apart()
    inertia = masses.force(motion.d, motion.v, motion.a) if masses else jnp.zeros_like(motion.d)

    def one(d: Array, v: Array) -> Array:
        def advance(state: Any, end: tuple[Array, Array]) -> tuple[Any, Array]:
            found = element.step(*end, motion.dt, state)
            return found.state, found.force

        return jax.lax.scan(advance, element.init(), (d, v))[1]

    return inertia + jax.vmap(one)(motion.d, motion.v)


def resonating(
    problem: HistoryProblem,
    place: Place,
    beside: Sequence[np.ndarray],
    steps: int,
    in_time: Callable[[], bool] = lambda: True,
) -> LawStart[UnnamedLaw]:
    """A general law that is nothing but the oscillator which leaves least when attached to a place.

    No law of the place's own motion looks like something that moves by itself: from those no search
    ends in a resonance. Of oscillators over the band of the modes, light and heavy, those that
    leave least as they are, by the receptances of the place, are fitted with the shortest memory.

    Parameters
    ----------
    problem, place, beside
        As for :func:`~iwanjax.identification.receptance.nearest_oscillators`.
    steps : int
        Of the search, at most.
    in_time : function
        False when it is time to stop.
    """
    near = nearest_oscillators(problem, place, beside, SHORT_TIME_CONSTANT)
    own, starts = with_law(problem, UnnamedKind(), place, near)
    fits = multistart(own, starts, SHORT_TIME_CONSTANT, steps, in_time=in_time)
    z = min(fits, key=lambda each: each.cost).theta.mean(axis=0)[: own.parameters]
    found = joints_of(own.joints, jax.device_put(z))[-1]
    m, k, c = (float(getattr(found, info.name)) for info in found.parameters)
    law, strengths = blank_at(place), np.zeros(len(TERMS))
    omega = 2.0 * math.pi / place.scales.period
    strengths[RESONATES] = m * float(law.rate) * omega
    shape = np.log([math.sqrt(k / m) / omega, 0.5 * c / math.sqrt(k * m)])
    law = law.with_strengths(strengths).with_resonance(shape)
    return LawStart(law, z[: problem.parameters])
