r"""A general law at a place, fitted to recordings beside the joints.

Its strengths are linear in the force, each with a Gaussian prior about zero whose deviation is
that of its part (spring, dampers, sliders, relaxation), and none but the spring's are negative.
The search is that of every hypothesis: Gauss-Newton on the innovations of an observer of a longer
and longer memory, up to the free run. Between memories each part's deviation :math:`s` is set to

.. math:: s^2 = \frac{\sum_i w_i^2}{\sum_i \gamma_i}, \qquad
          \gamma_i = 1 - \frac{C_{ii}}{s^2}

by its strengths w and their covariance C (MacKay, Neural Computation 4, 1992, Eq. 3.20):
:math:`\sum\gamma` is how many of them the recordings determine.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.effects.kinds import UnnamedKind
from iwanjax.identification.joint_priors import FreeLaw
from iwanjax.identification.likelihood import covariance
from iwanjax.identification.multistart import HypothesisFit, multistart
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.joints import UnnamedLaw
from iwanjax.joints.unnamed_terms import PARTS, TERMS

# A part's prior deviation changes no more than this in one round, either way: what a short memory
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
        joint, z = self.joint, self.fitted.theta.mean(axis=0)[self._own]
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
        self, memories: Sequence[float], steps: int, in_time: Callable[[], bool] = lambda: True
    ) -> "UnnamedFit":
        """The fit gone on with, with longer memories; arguments as :func:`fit_unnamed_law`."""
        found = self
        for memory in memories:
            if not in_time():
                break
            begun = loosened(found)
            (fit,) = multistart(begun.problem, [begun.fitted.start], memory, steps, in_time=in_time)
            found = UnnamedFit(self.place, begun.problem, fit)
        return found

    @property
    def _own(self) -> slice:
        last = self.problem.parameters
        return slice(last - self.joint.count, last)

    @property
    def _strengths(self) -> slice:
        return slice(self._own.start, self._own.start + self.joint.terms.size)


def with_unnamed_law(
    problem: HistoryProblem,
    kind: UnnamedKind,
    place: Place,
    z: Sequence[np.ndarray],
    duhem: bool = False,
) -> tuple[HistoryProblem, list[Start]]:
    """A general law more at a place, without any force yet, and the search it takes.

    Parameters
    ----------
    problem : HistoryProblem
        Of the model without it.
    kind : UnnamedKind
        What to call it.
    place : Place
        Where.
    z : sequence of array
        Joints to begin with, (parameters,), or these, the strengths of the free terms after them
        and the shape of the curve.
    duhem : bool
        Whether with a spring that yields along a curve in place of other hysteresis.
    """
    # As much force as bends the structure as far as the place has moved.
    force, law = place.scales.deflection * place.scales.stiffness, blank_at(place)
    joint, p = FreeLaw(law, jnp.full(len(TERMS), force), duhem), problem.parameters
    free = joint.terms
    own = np.stack([np.pad(each[p:], (0, p + joint.count - each.size)) for each in z])
    # What a part begins with may be more, and no search would keep that far beyond its prior.
    begun, loose = np.zeros(len(TERMS)), np.array(joint.loose)
    begun[free] = np.max(np.abs(own[:, : free.size]), axis=0)
    for part in PARTS.values():
        loose[part] = max(force, float(np.max(begun[part])))
    joint = replace(joint, loose=jax.device_put(loose))
    own[:, : free.size] /= loose[free]
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
    whole = [np.concatenate([each[:p], there]) for each, there in zip(z, own, strict=True)]
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
    z: Sequence[np.ndarray],
    memories: Sequence[float],
    steps: int,
    in_time: Callable[[], bool] = lambda: True,
    duhem: bool = False,
) -> UnnamedFit:
    """The general law at a place, fitted with longer and longer memories of the observer.

    Parameters
    ----------
    problem, kind, place
        As for :func:`with_unnamed_law`.
    z : sequence of array
        Where to begin, the best of which is gone on with after the first memory.
    memories : sequence of float
        Of the observer, cycles; infinite for the free run.
    steps : int
        Of each search, at most.
    in_time : function
        False when it is time to stop.
    duhem
        As for :func:`with_unnamed_law`.
    """
    here, starts = with_unnamed_law(problem, kind, place, z, duhem)
    fits = multistart(here, starts, memories[0], steps, in_time=in_time)
    found = UnnamedFit(place, here, min(fits, key=lambda each: each.cost))
    return found.onward(memories[1:], steps, in_time)


def loosened(found: UnnamedFit) -> UnnamedFit:
    """The same fit with each part's prior as wide as its strengths are."""
    problem, fitted, joint = found.problem, found.fitted, found.joint
    determined, z = found.determined, np.zeros(len(TERMS))
    z[joint.terms] = fitted.theta.mean(axis=0)[found._strengths]
    factor = np.ones(len(TERMS))
    for part in PARTS.values():
        size = math.sqrt(float(np.sum(z[part] ** 2)) / max(float(np.sum(determined[part])), 1e-12))
        # Of a part of which nothing is known, as in a fit that broke down, it stays as it is.
        factor[part] = min(max(size, 1.0 / _MOST), _MOST) if math.isfinite(size) else 1.0
    wider = FreeLaw(joint.given, jax.device_put(np.array(joint.loose) * factor), joint.duhem)
    rescaled = replace(problem, joints=(*problem.joints[:-1], wider))
    theta = fitted.theta.copy()
    theta[:, found._strengths] /= factor[joint.terms]
    solution = replace(fitted.solution, values=theta)
    return UnnamedFit(found.place, rescaled, replace(fitted, solution=solution))
