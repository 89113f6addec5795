"""Forces beside one joint, fitted and ordered by evidence."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.discrepancy.diagnosis import Suspect
from iwanjax.discrepancy.effects import ForceKind, ModeKind
from iwanjax.discrepancy.estimate import SURE, Estimate
from iwanjax.discrepancy.evidence import LEAST_GAIN, MODEL_ERROR_ALLOWANCE, log_evidence
from iwanjax.discrepancy.steady.left_out import AddedJoint, WithAddedJoint

# Shapes tried, how far they go beyond those of the catalogue, how often the best is bracketed, and
# how often a parabola then says where the best of all is.
_SHAPES, _BEYOND, _BRACKETS, _PARABOLAS = 8, 4.0, 2, 2
# Change of a shape's logarithm by which a residual's derivative is told.
_RESHAPED = 1e-2
# Ratio of neighbouring shapes where one is nearly known.
_NEAR = 1.3


class PlacedForce(NamedTuple):
    """A force with its shape, if any, and the place of a structure where it acts."""

    kind: ForceKind
    shape: float
    where: str = ""


class MovedJoint(NamedTuple):
    """What else moves a mode's joint: of one shape only, and at no other place."""

    kind: ModeKind
    shape: float = 1.0
    where: str = ""


class Deviations(NamedTuple):
    """Standard deviations of a force's size and shape; NaN without one.

    Attributes
    ----------
    size : float
        Of the size.
    log_shape : float
        Of the logarithm of the shape.
    at_shape : float
        Of the size, were the shape known: whether there is a force at all. A slider that slips
        from the first has a force, though neither its stiffness nor its slip is known.
    """

    size: float
    log_shape: float
    at_shape: float


class Explained(Protocol):
    """Measurements of one joint, explained by it and at most one force."""

    @property
    def force(self) -> PlacedForce | MovedJoint | AddedJoint | None:
        """None for the joint alone."""
        ...

    @property
    def theta(self) -> np.ndarray:
        """All parameters, the size of the force last."""
        ...

    @property
    def cost(self) -> float:
        """Sum of squared residuals over their deviations."""
        ...

    def deviations(self) -> "Deviations":
        """Of the force's size and shape."""
        ...

    @property
    def unknowns(self) -> int:
        """Values that were adjusted."""
        ...

    @property
    def count(self) -> int:
        """Values that were measured."""
        ...

    def correlation(self) -> float:
        """Correlation time of the residuals, in values."""
        ...


Fit = TypeVar("Fit", bound=Explained)


def to_size(variable: Array, scale: Array, positive: Array) -> Array:
    """A force's size from the variable that is searched: by its logarithm if it is positive."""
    return scale * jnp.where(positive > 0, jnp.exp(variable), variable)


def to_variable(size: Array, scale: Array, positive: Array) -> Array:
    """The inverse of :func:`to_size`."""
    share = size / scale
    return jnp.where(positive > 0, jnp.log(jnp.maximum(jnp.abs(share), 1e-6)), share)


def linearised(slopes: np.ndarray, cost: float, tau: float) -> np.ndarray:
    """Standard deviations of parameters, NaN where nothing depends on one.

    Times the misfit where that exceeds 1; residuals that are correlated over some values, as all
    misfit is along a curve, count as so many fewer.

    Parameters
    ----------
    slopes : (values, parameters) array
        Of the residuals.
    cost : float
        Sum of their squares.
    tau : float
        Correlation time of the residuals, in values.
    """
    sizes = np.linalg.norm(slopes, axis=0)
    used = sizes > 0
    inverse = np.linalg.pinv(slopes[:, used] / sizes[used], rcond=1e-10)
    std = np.full(len(sizes), math.nan)
    # Each parameter takes up one independent residual, and one at least is left.
    tau = max(1.0, tau)
    misfit = cost / max(tau, len(slopes) - tau * int(used.sum()))
    std[used] = np.linalg.norm(inverse, axis=1) / sizes[used]
    std[used] *= math.sqrt(max(1.0, misfit) * tau)
    return std


def deviations_of(
    force: PlacedForce | None,
    slopes: Callable[[], np.ndarray],
    reshaped: Callable[[float], np.ndarray],
    cost: float,
    tau: float,
) -> Deviations:
    """Of a force's size and shape; NaN without one.

    Parameters
    ----------
    force : PlacedForce or None
        With its shape.
    slopes : function
        Of the residuals in all parameters, the last of which is the size.
    reshaped : function
        Residuals with the shape so many times as large.
    cost : float
        Sum of the residuals' squares.
    tau : float
        Their correlation time, in values.
    """
    if force is None:
        return Deviations(math.nan, math.nan, math.nan)
    found = slopes()
    size = found.shape[1] - 1
    alone = float(linearised(found, cost, tau)[size])
    if force.kind.shape is None:
        return Deviations(alone, math.nan, alone)
    up, down = (reshaped(math.exp(step)) for step in (_RESHAPED, -_RESHAPED))
    std = linearised(np.column_stack([found, (up - down) / (2.0 * _RESHAPED)]), cost, tau)
    return Deviations(float(std[size]), float(std[size + 1]), alone)


def estimates_of(fit: Explained) -> tuple[Estimate, ...]:
    """Size and shape of a fit's force, with their deviations."""
    assert fit.force is not None
    kind, shape, _ = fit.force
    assert isinstance(kind, ForceKind | ModeKind)
    std, std_shape, _ = fit.deviations()
    size = Estimate(kind.size, float(fit.theta[-1]), std)
    if kind.shape is None:
        return (size,)
    return size, Estimate(kind.shape, shape, shape * std_shape)


def determined(fit: Explained) -> bool:
    """Whether a force's size is known to be other than zero, by two deviations.

    Of a joint left out either strength or stiffness: the one is not known where it only sticks,
    the other where it only slips.
    """
    if isinstance(fit.force, AddedJoint):
        values, std = cast(WithAddedJoint, fit).added()
        return bool(np.any(values[:2] > SURE * std[:2]))
    return abs(float(fit.theta[-1])) > SURE * fit.deviations().at_shape


class Tried(NamedTuple, Generic[Fit]):
    """Forces beside a joint.

    Attributes
    ----------
    found : list of Fit
        Of those that can be fitted.
    unseen : list of str
        Kinds that the measurements cannot show.
    complete : bool
        Whether there was time for all.
    """

    found: list[Fit]
    unseen: list[str]
    complete: bool


def tried(
    forces: Sequence[ForceKind],
    beside: Callable[[ForceKind], Fit | None],
    in_time: Callable[[], bool],
    progress: Callable[[str], None],
) -> Tried[Fit]:
    """Each force beside the joint, as far as there is time."""
    found: list[Fit] = []
    unseen: list[str] = []
    for force in forces:
        if not in_time():
            return Tried(found, unseen, False)
        progress(f"with {force.name}")
        fit = beside(force)
        if fit is None:
            unseen.append(force.name)
        elif math.isfinite(fit.cost):
            found.append(fit)
    return Tried(found, list(dict.fromkeys(unseen)), True)


def best_of(fits: Sequence[Fit]) -> Fit:
    """Of least cost."""
    return min(fits, key=lambda each: each.cost)


def over_shapes(begin: Sequence[float], at: Callable[[float], Fit | None]) -> list[Fit]:
    """Fits with shapes on a grid about those to begin with, then nearer to the best.

    Parameters
    ----------
    begin : sequence of float
        Shapes of the catalogue.
    at : function
        The fit with one shape; None where that does not show.
    """
    first, last = min(begin) / _BEYOND, max(begin) * _BEYOND
    grid = np.geomspace(first, last, _SHAPES).tolist()
    found = [each for each in map(at, grid) if each is not None]
    for i in range(_BRACKETS if found else 0):
        best = best_of(found).force
        assert best is not None
        factor = (last / first) ** (0.5 ** (i + 1) / (_SHAPES - 1))
        near = (at(best.shape * factor), at(best.shape / factor))
        found += [each for each in near if each is not None]
    return _lowest(found, at)


def shapes_near(fit: Fit, at: Callable[[float], Fit | None]) -> list[Fit]:
    """A fit and others with shapes near to its own."""
    assert fit.force is not None
    shape = fit.force.shape
    near = (at(shape * _NEAR), at(shape / _NEAR))
    return _lowest([fit, *(each for each in near if each is not None)], at)


def _lowest(found: list[Fit], at: Callable[[float], Fit | None]) -> list[Fit]:
    """Fits, and those with the shapes that parabolas through them tell."""
    for _ in range(_PARABOLAS if found else 0):
        shape = _vertex(found)
        nearer = at(shape) if shape is not None else None
        found = [*found, *([nearer] if nearer is not None else [])]
    return found


def _vertex(fits: Sequence[Explained]) -> float | None:
    """Shape at which a parabola of the cost through the best and its neighbours is lowest."""
    costs = {fit.force.shape: fit.cost for fit in fits if fit.force is not None}
    shapes = sorted(costs)
    i = min(range(len(shapes)), key=lambda k: costs[shapes[k]])
    if not 0 < i < len(shapes) - 1:
        return None
    three = shapes[i - 1 : i + 2]
    x = np.log(three) - math.log(shapes[i])
    bend, slope, _ = np.polyfit(x, [costs[each] for each in three], 2)
    return shapes[i] * math.exp(-0.5 * slope / bend) if bend > 0 else None


class Weighed(NamedTuple, Generic[Fit]):
    """A fit and its log evidence."""

    fit: Fit
    value: float


class Ranking(NamedTuple, Generic[Fit]):
    """Fits by evidence.

    Attributes
    ----------
    alone : Fit
        The joint on its own.
    nothing : float
        Its log evidence, and how much likelier it is before the data.
    entries : tuple of Weighed
        What may act beside it, the best first.
    """

    alone: Fit
    nothing: float
    entries: tuple[Weighed[Fit], ...]

    @classmethod
    def of(cls, alone: Fit, found: Sequence[Fit]) -> "Ranking[Fit]":
        """By evidence, the best of every kind at a place only.

        A force whose size is not determined is none, where one would be the verdict. Rivals are
        told apart by what the best of them leaves; that nothing is missing is held
        against the deviations as they are stated: a poor fit asks for no more evidence.

        Parameters
        ----------
        alone : Fit
            The joint on its own.
        found : sequence of Fit
            What may act beside it.
        """
        best: dict[tuple[str, str], Fit] = {}
        for fit in found:
            assert fit.force is not None
            what = (fit.force.kind.name, fit.force.where)
            best[what] = best_of([best.get(what, fit), fit])
        fits = [alone, *best.values()]
        first = best_of(fits)
        temperature, tau = max(1.0, first.cost / alone.count), first.correlation()
        costs, unknowns = zip(*((each.cost, each.unknowns) for each in fits), strict=True)

        def values(temperature: float) -> np.ndarray:
            known = log_evidence(costs, unknowns, alone.count, temperature, tau)
            known[0] += MODEL_ERROR_ALLOWANCE * alone.cost / (2.0 * temperature * tau)
            return known

        strict, own = values(1.0), values(temperature)[1:]
        gain = float(strict[1:].max() - strict[0]) if own.size else 0.0
        nothing = (float(own.max()) if own.size else 0.0) - gain + LEAST_GAIN
        entries = [Weighed(fit, float(v)) for fit, v in zip(best.values(), own, strict=True)]
        # Of those that are alike to rounding the one that was tried first, the simplest, leads:
        # the others are as good, not better.
        entries.sort(key=lambda each: -round(each.value, 1))
        ordered = np.minimum.accumulate([each.value for each in entries]).tolist()
        if entries and ordered[0] > nothing:
            known = [each.fit for each in entries if determined(each.fit)]
            if len(known) < len(entries):
                return cls.of(alone, known)
        led = (each._replace(value=v) for each, v in zip(entries, ordered, strict=True))
        return cls(alone, nothing, tuple(led))

    @property
    def detected(self) -> bool:
        """Whether the first is likelier than nothing."""
        return bool(self.entries) and self.entries[0].value > self.nothing

    @property
    def chosen(self) -> Fit:
        """The model to go on with."""
        return self.entries[0].fit if self.detected else self.alone

    def suspects(
        self,
        where: str,
        probabilities: Sequence[float],
        estimates: Callable[[Fit], tuple[Estimate, ...]],
    ) -> Iterator[Suspect]:
        """What may act beside the joint, each with its probability."""
        for each, probability in zip(self.entries, probabilities, strict=True):
            force, behind = each.fit.force, each.value - self.entries[0].value
            assert force is not None
            place = force.where or where
            yield Suspect(force.kind, place, probability, behind, estimates(each.fit))
