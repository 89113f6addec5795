"""The best shape of a force: a grid, nearer ones, and parabolas of the cost through them."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from iwanjax.effects.kinds import ForceKind, JointKind, NamedKind
from iwanjax.identification.steady.fit import AnyFit, Fit, best_of
from iwanjax.joints import Scales
from iwanjax.joints.force_law import Values
from iwanjax.settings.stages import settings


def best_shape(
    kind: ForceKind, begin: Sequence[float], at: Callable[[float], Fit | None]
) -> Fit | None:
    """The best of a force's fits with shapes on a grid, then nearer to the best.

    Parameters
    ----------
    kind : ForceKind
        The force; without a shape there is one fit.
    begin : sequence of float
        Shapes of the catalogue.
    at : function
        The fit with one shape; None where that does not show.
    """
    if kind.shape is None:
        return at(begin[0])
    known = settings().steady
    first, last = min(begin) / known.beyond, max(begin) * known.beyond
    grid = np.geomspace(first, last, known.shapes).tolist()
    found = [each for each in map(at, grid) if each is not None]
    for i in range(known.brackets if found else 0):
        factor = (last / first) ** (0.5 ** (i + 1) / (known.shapes - 1))
        found += _neighbours(best_of(found), factor, at)
    return best_of(_lowest(found, at)) if found else None


def best_shape_near(fit: Fit, at: Callable[[float], Fit | None]) -> Fit:
    """The best of a fit and others with shapes near to its own."""
    return best_of(_lowest([fit, *_neighbours(fit, settings().steady.near, at)], at))


def from_within(
    simpler: Fit, kind: ForceKind, largest: float, at: Callable[[float, np.ndarray], Fit | None]
) -> Fit | None:
    """A force from where it does what a simpler one does; None where it does not contain that.

    Parameters
    ----------
    simpler : SteadyFit
        Of the force that it contains.
    kind : ForceKind
        The force.
    largest : float
        Deflection.
    at : function
        Shape, starting values -> the fit; None where that does not show.
    """
    known, found = settings().steady, []
    for share in (known.at_once, known.negligible):
        values = at_a_limit(kind, simpler, largest, share)
        if values is not None:
            size, shape = values
            found.append(at(shape, np.append(simpler.theta[:-1], size)))
    seen = [each for each in found if each is not None]
    if not seen:
        return None
    best = best_of(seen)
    return best_shape_near(best, lambda shape: at(shape, best.theta))


def at_a_limit(kind: NamedKind, simpler: AnyFit, largest: float, share: float) -> Values | None:
    """Values at which a kind does what a fit's force does, but for a share; None if it cannot.

    Parameters
    ----------
    kind : NamedKind
        Another one.
    simpler : SteadyFit
        Of a force.
    largest : float
        Deflection.
    share : float
        Of the kind's range that is left to its end.
    """
    effect = simpler.effect
    if effect is None or effect.force is not None:
        return None
    size = float(simpler.values[0])
    values = (size,) if effect.shape_info is None else (size, effect.shape)
    for nested in getattr(kind, "limits", ()):
        if nested.means(effect.kind):
            there = nested.widened(values, Scales(largest, 1.0), share)
            # A joint, and most forces, cannot be of negative size.
            positive = isinstance(kind, JointKind) or getattr(kind, "positive", False)
            return there if there[0] > 0.0 or not positive else None
    return None


def as_joint(kind: NamedKind, simpler: AnyFit, largest: float) -> np.ndarray:
    """Parameters of a joint that does nearly what a fit's force does, which it has for a limit."""
    values = at_a_limit(kind, simpler, largest, settings().steady.at_once)
    assert values is not None
    return np.array(values)


def _neighbours(fit: Fit, factor: float, at: Callable[[float], Fit | None]) -> list[Fit]:
    assert fit.effect is not None
    near = (at(fit.effect.shape * factor), at(fit.effect.shape / factor))
    return [each for each in near if each is not None]


def _lowest(found: list[Fit], at: Callable[[float], Fit | None]) -> list[Fit]:
    """Fits, and those with the shapes that parabolas through them tell."""
    for _ in range(settings().steady.parabolas):
        shape = _vertex(found)
        nearer = at(shape) if shape is not None else None
        found = [*found, *([nearer] if nearer is not None else [])]
    return found


def _vertex(fits: Sequence[AnyFit]) -> float | None:
    """Shape at which a parabola of the cost through the best and its neighbours is lowest."""
    costs = {fit.effect.shape: fit.cost for fit in fits if fit.effect is not None}
    shapes = sorted(costs)
    i = min(range(len(shapes)), key=lambda k: costs[shapes[k]])
    if not 0 < i < len(shapes) - 1:
        return None
    three = shapes[i - 1 : i + 2]
    x = np.log(three) - math.log(shapes[i])
    bend, slope, _ = np.polyfit(x, [costs[each] for each in three], 2)
    return shapes[i] * math.exp(-0.5 * slope / bend) if bend > 0 else None
