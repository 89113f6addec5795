r"""What recordings say of effects at size zero, beyond what joints and states may do as well.

With the columns h of all effects and G those of what is fitted anyhow (joints, errors of the linear
model, states), in deviations of the noise,

.. math:: F = H^T H - H^T G\,(G^T G + P)^{-1} G^T H

is the Fisher information of the effects' sizes with the others refitted; P is the prior's
precision. It adds up over recordings and, in the free run, over sensors, so that those of a plan,
and what might be added to it, are made once and put together in any way. With a memory of some
cycles every sensor steers the observer, so that information of fewer is another one.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iwanjax.identification.columns import UnitEffect, columns
from iwanjax.identification.free_values import free_values
from iwanjax.identification.linearise import linearise
from iwanjax.identification.multistart import HypothesisFit
from iwanjax.identification.problem import HistoryProblem


class RecordingInformation(NamedTuple):
    """Products of columns in one recording.

    Attributes
    ----------
    products : (sensors, values, values) array
        Of shared values, then effects, then the recording's own state.
    shared : int
        How many values recordings share.
    states : int
        How many values are the recording's own.
    samples : (sensors,) array
        That are compared.
    """

    products: Float[np.ndarray, "sensors values values"]
    shared: int
    states: int
    samples: Float[np.ndarray, " sensors"]

    def among(self, effects: Sequence[int]) -> "RecordingInformation":
        """The same of some of the effects."""
        values = self.products.shape[1]
        own = range(values - self.states, values)
        at = [*range(self.shared), *(self.shared + i for i in effects), *own]
        return self._replace(products=self.products[:, at][:, :, at])

    def of(
        self, sensors: Sequence[int] | slice = slice(None)
    ) -> Float[np.ndarray, "values values"]:
        """Products of shared values and effects by some of the sensors, the state refitted."""
        whole = self.products[sensors].sum(axis=0)
        last = len(whole) - self.states
        beside = whole[:last, last:]
        own = whole[last:, last:] + np.eye(self.states)
        return whole[:last, :last] - beside @ np.linalg.solve(own, beside.T)


def seen(
    problem: HistoryProblem, base: HypothesisFit, effects: Sequence[UnitEffect]
) -> RecordingInformation:
    """Products of columns about what a model predicts of one recording.

    Parameters
    ----------
    problem : HistoryProblem
        Of one recording.
    base : HypothesisFit
        The model without any effect, with the memory that is asked for.
    effects : sequence of UnitEffect
        Of size 1.
    """
    (line,) = linearise(problem, [(base.hypothesis, base.theta)], base.time_constant)
    slopes = np.asarray(line.slopes)[0]
    shared = free_values(problem, base.hypothesis)
    own = list(range(base.values, len(slopes)))
    # Of hundreds of effects in all samples half the memory is enough.
    acting = columns(problem, base, effects)[:, 0].astype(np.float32)
    weight = np.asarray(problem.data.weight)[0]
    products = np.stack(
        [
            _product([slopes[shared, :, s], acting[:, :, s], slopes[own, :, s]])
            for s in range(weight.shape[1])
        ]
    )
    return RecordingInformation(products, len(shared), len(own), np.count_nonzero(weight, axis=0))


def _product(parts: Sequence[np.ndarray]) -> np.ndarray:
    whole = np.concatenate(parts).astype(float)
    # An effect that breaks the model down says nothing.
    whole[~np.all(np.isfinite(whole), axis=1)] = 0.0
    return whole @ whole.T


def fisher(parts: Iterable[np.ndarray], shared: int) -> np.ndarray:
    """Information of effects in recordings together, what these share refitted: (effects,) twice.

    Parameters
    ----------
    parts : iterable of (shared + effects, shared + effects) array
        Of each recording, by :meth:`RecordingInformation.of`.
    shared : int
        How many values recordings share; the prior of each has unit deviation.
    """
    whole = sum(parts, np.zeros(()))
    own, beside = whole[:shared, :shared] + np.eye(shared), whole[:shared, shared:]
    return whole[shared:, shared:] - beside.T @ np.linalg.solve(own, beside)
