r"""Where something acts, whatever it is: all laws of a place at once against the residual.

With the columns H of every law and shape at a place and the residual e, both less what joints,
errors of the linear model and states explain, the place takes :math:`e^T H (H^T H)^+ H^T e` off the
squared residual. Many columns take something off anyhow, so that places are compared by evidence
(:func:`log_evidence`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from iwanjax.discrepancy.findings import PlaceEvidence
from iwanjax.effects.catalogue import kinds_in_time
from iwanjax.effects.kinds import ForceKind
from iwanjax.estimation.evidence import LEAST_GAIN, shares
from iwanjax.identification.columns import columns, unit_effects
from iwanjax.identification.free_values import free_values
from iwanjax.identification.likelihood import evidence
from iwanjax.identification.linearise import linearise
from iwanjax.identification.multistart import HypothesisFit
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem

# Share of a column's square, and of the largest eigenvalue, that is lost in rounding where a
# small difference of squares is left.
_ROUNDING = math.sqrt(np.finfo(float).eps)
# Singular values, over the largest, below which columns are combinations of one another.
_DEPENDENT = 1e-8


class Block(NamedTuple):
    """Columns of one place in the directions that they span.

    Attributes
    ----------
    strength : (directions,) array
        Eigenvalues of :math:`D^{-1/2} H^T H D^{-1/2}`, with the columns' squares D: they add up to
        the number of columns.
    taken : (directions,) array
        What each direction takes off the squared residual.
    """

    strength: Float[np.ndarray, " directions"]
    taken: Float[np.ndarray, " directions"]

    @property
    def reduction(self) -> float:
        """What all of them take off."""
        return float(self.taken.sum())


class Remaining(NamedTuple):
    """What refitted joints, errors of the linear model and states leave.

    Attributes
    ----------
    basis : (values + priors, free) array
        Orthonormal, of what they explain; the last rows are those of their priors.
    left : (values + priors,) array
        The residual, orthogonal to it.
    """

    basis: np.ndarray
    left: np.ndarray

    @classmethod
    def of(cls, problem: HistoryProblem, base: HypothesisFit, basis: np.ndarray) -> "Remaining":
        """What a basis leaves of a fit's residual and of its priors'."""
        z, states = base.theta.mean(axis=0)[: problem.parameters], base.theta[:, base.values :]
        whole = np.concatenate([base.residual.ravel(), z, states.ravel()])
        return cls(basis, whole - basis @ (basis.T @ whole))

    @property
    def square(self) -> float:
        """Of the residual."""
        return float(self.left @ self.left)

    def seen(self, h: Float[np.ndarray, "columns values"]) -> "Columns":
        """Products of columns, of which nothing is in the priors' rows."""
        values = h.shape[1]
        with np.errstate(over="ignore", invalid="ignore"):
            known = h @ self.basis[:values]
            whole = h @ h.T
            return Columns(np.diag(whole), whole - known @ known.T, -(h @ self.left[:values]))


class Columns(NamedTuple):
    """Columns of suspects by their products; none is finite where the model broke down.

    Attributes
    ----------
    alone : (columns,) array
        Their squares with all that joints and states explain.
    products : (columns, columns) array
        What is left of their products.
    toward : (columns,) array
        Their products with the residual that they oppose.
    """

    alone: np.ndarray
    products: np.ndarray
    toward: np.ndarray

    def block(self) -> Block:
        """All of them at once, but for those that joints and states do as well."""
        square = np.diag(self.products)
        with np.errstate(invalid="ignore"):
            usable = np.isfinite(square) & (square > _ROUNDING * self.alone)
        root = np.sqrt(square[usable])
        strength, V = np.linalg.eigh(self.products[np.ix_(usable, usable)] / np.outer(root, root))
        there = strength > _ROUNDING * len(root)
        strength, V = strength[there], V[:, there]
        return Block(strength, (V.T @ (self.toward[usable] / root)) ** 2 / strength)


def free_columns(problem: HistoryProblem, base: HypothesisFit) -> tuple[np.ndarray, int]:
    """Columns of all that a fit has free, its priors below; those all recordings share first.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    base : HypothesisFit
        The fit.

    Returns
    -------
    (values + priors, free) array, int
        In deviations, for a prior deviation of each; and how many are shared.
    """
    (seen,) = linearise(problem, [(base.hypothesis, base.theta)], base.time_constant)
    shared = free_values(problem, base.hypothesis)
    slopes = np.moveaxis(np.asarray(seen.slopes), 1, 0)
    slopes = slopes.reshape(*slopes.shape[:2], -1)
    own = [*shared, *range(base.values, len(slopes))]
    return _explained(problem, slopes[own], len(shared)), len(shared)


def _explained(problem: HistoryProblem, made: np.ndarray, shared: int) -> np.ndarray:
    """Columns of what is fitted: shared values, then the state of each recording; and priors."""
    f, R, size = made.shape
    p, k = problem.parameters, f - shared
    found = np.zeros((R * size, shared + R * k))
    found[:, :shared] = made[:shared].reshape(shared, R * size).T
    for r in range(R):
        at = slice(shared + r * k, shared + (r + 1) * k)
        found[r * size : (r + 1) * size, at] = made[shared:, r].T
    prior = np.zeros((p + R * k, shared + R * k))
    prior[:p, :p] = np.eye(p)
    prior[p:, shared:] = np.eye(R * k)
    return np.vstack([found, prior])


def log_evidence(block: Block, unit: float, total: float) -> float:
    r"""How much more likely the residual is with these columns, :math:`\ln B`.

    Each column has a coefficient of prior :math:`N(0, \sigma^2/d)`, d its square: it is worth
    :math:`\sigma^2` units of squared residual. With the strengths :math:`\lambda` and takings u of
    the block's directions, in units s of the squared residual,

    .. math:: \ln B(\sigma) = \frac{1}{2}\sum_i \left[
              \frac{\sigma^2\lambda_i}{1 + \sigma^2\lambda_i}\frac{u_i}{s}
              - \ln(1 + \sigma^2\lambda_i)\right],

    the marginal likelihood of a linear model (MacKay, Neural Computation 4, 1992): directions that
    columns share cost once, those that are weaker than the noise nothing. B is averaged over
    :math:`\sigma^2 = 1, 2, 4, \ldots` up to what there is to explain, for how large an effect is
    is not known. With one column and :math:`\sigma^2 = N` this is the usual BIC.

    Parameters
    ----------
    block : Block
        Of the columns.
    unit : float
        Twice a unit of log evidence, in squared residual.
    total : float
        The squared residual.
    """
    most = max(0.0, math.log2(total / unit)) if total > 0.0 else 0.0
    prior = 2.0 ** np.arange(math.floor(most) + 1)[:, None] * block.strength
    each = prior / (1.0 + prior) * block.taken / unit - np.log1p(prior)
    return _mean(0.5 * each.sum(axis=1))


def _mean(values: Sequence[float] | np.ndarray) -> float:
    """Logarithm of the mean of what these are logarithms of."""
    return float(np.logaddexp.reduce(values)) - math.log(len(values))


def places_by_evidence(
    blocks: Mapping[str, Sequence[Block]],
    singles: Mapping[str, Sequence[float]],
    total: float,
    unit: float,
) -> tuple[PlaceEvidence, ...]:
    """Places with the probability that something acts there, the likeliest first.

    One place at most is taken to act, and as likely as any other; nothing is likelier before the
    data by :data:`~iwanjax.estimation.evidence.LEAST_GAIN`. What acts may be one law, or a mixture
    of all as a block has it: an effect of the catalogue that is weak need not pay for all others.

    Parameters
    ----------
    blocks : mapping of str to sequence of Block
        Of each place: its laws; a joint that drifts.
    singles : mapping of str to sequence of float
        Of each place what each suspect alone takes off the squared residual.
    total : float
        The squared residual.
    unit : float
        As for :func:`log_evidence`.
    """
    found = []
    for where in dict.fromkeys([*blocks, *singles]):
        alone, own = singles.get(where, ()), list(blocks.get(where, ()))
        ones = [Block(np.ones(1), np.array([taken])) for taken in alone]
        mixed = [log_evidence(each, unit, total) for each in own]
        if ones:
            mixed.append(_mean([log_evidence(each, unit, total) for each in ones]))
        best = max([*own, *ones], key=lambda each: each.reduction)
        found.append((where, best, _mean(mixed)))
    odds = shares(np.array([LEAST_GAIN, *(value for *_, value in found)]))[1:]
    places = [
        PlaceEvidence(where, float(odd), best.reduction / total, len(best.taken), value)
        for (where, best, value), odd in zip(found, odds, strict=True)
    ]
    return tuple(sorted(places, key=lambda each: -each.log_evidence))


def with_verdict(
    places: Sequence[PlaceEvidence],
    named: Sequence[tuple[Sequence[str], float]],
    something_else: float,
) -> tuple[PlaceEvidence, ...]:
    r"""Places by the verdict on refits, and by blocks as far as it names nothing.

    .. math:: P(w) = \sum_{i \ni w} P_i + P_{else}\,\frac{B_w}{\sum_v B_v}

    with the probabilities :math:`P_i` of hypotheses that have something at w, and the blocks' Bayes
    factors B. Of several effects at once each place has their probability.

    Parameters
    ----------
    places : sequence of PlaceEvidence
        As :func:`places_by_evidence` has them.
    named : sequence of (sequence of str, float)
        Places of each hypothesis, with its probability.
    something_else : float
        That the truth is none of them.
    """
    if not places:
        return ()
    of_blocks = something_else * shares(np.array([each.log_evidence for each in places]))
    found = []
    for each, unnamed in zip(places, of_blocks, strict=True):
        there = sum(probability for where, probability in named if each.where in where)
        found.append(each._replace(probability=min(1.0, float(unnamed) + there)))
    return tuple(sorted(found, key=lambda each: -each.probability))


def more_there(
    problem: HistoryProblem, base: HypothesisFit, place: Place, places: Sequence[Place]
) -> Block:
    r"""What laws of a place would take off what a fit leaves.

    The columns H of all laws there but mass, dashpot and spring, against the residual e, both less
    what is refitted anyhow and what errors of the linear model's mass, damping and stiffness, here
    or elsewhere and of any size, would do as well.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    base : HypothesisFit
        The model with what is suspected there.
    place : Place
        Where it is.
    places : sequence of Place
        Where the linear model may be wrong.

    Returns
    -------
    Block
        In squared deviations of the noise.
    """
    problem, base = _by_all_kinds(problem, base)
    others = [kind for kind in problem.predictor.kinds if not kind.linear]
    made = columns(problem, base, unit_effects(problem, base, others, [place]))
    made = made.reshape(len(made), base.residual.size)
    return beyond_linear(problem, base, places).seen(made).block()


def beyond_linear(
    problem: HistoryProblem, base: HypothesisFit, places: Sequence[Place]
) -> Remaining:
    """What no error of the linear model's mass, damping and stiffness takes off a fit, of any size.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    base : HypothesisFit
        The fit.
    places : sequence of Place
        Where the linear model may be wrong.
    """
    problem, base = _by_all_kinds(problem, base)
    linear = [kind for kind in problem.predictor.kinds if kind.linear]
    explained, _ = free_columns(problem, base)
    units = unit_effects(problem, base, linear, places)
    errors = columns(problem, base, units).reshape(len(units), base.residual.size).T
    errors = np.pad(errors, [(0, len(explained) - len(errors)), (0, 0)])
    explained = np.hstack([explained, errors[:, np.all(np.isfinite(errors), axis=0)]])
    size = np.linalg.norm(explained, axis=0)
    # An error at one place may do what another one does: only directions that there are.
    basis, strength, _ = np.linalg.svd(explained[:, size > 0.0] / size[size > 0.0], False)
    return Remaining.of(problem, base, basis[:, strength > _DEPENDENT * strength[0]])


def like_no_linear_error(
    problem: HistoryProblem, base: HypothesisFit, places: Sequence[Place], cost: float
) -> bool:
    """Whether what leaves a cost explains more of a fit's residual than errors of a linear model.

    By the evidence that something missing has to have; errors of any size and number cost nothing.
    """
    return cost < beyond_linear(problem, base, places).square - gain_in_squares(problem, base)


def gain_in_squares(problem: HistoryProblem, fitted: HypothesisFit) -> float:
    """Squared residual that stands for the evidence that something missing has to have."""
    return LEAST_GAIN * fitted.cost / evidence(problem, [fitted]).worth(fitted)


def _by_all_kinds(
    problem: HistoryProblem, base: HypothesisFit
) -> tuple[HistoryProblem, HypothesisFit]:
    """The same where all kinds of forces may be asked about."""
    known = problem.predictor.kinds
    more = [k for k in kinds_in_time() if isinstance(k, ForceKind) and k not in known]
    if not more:
        return problem, base
    suspects = base.hypothesis.suspects
    force = np.pad(np.asarray(suspects.force), [(0, 0), (0, len(more))])
    hypothesis = replace(base.hypothesis, suspects=suspects._replace(force=jax.device_put(force)))
    own = problem.of_kinds((*known, *more, *problem.predictor.faults))
    return own, replace(base, hypothesis=hypothesis)
