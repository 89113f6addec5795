"""Parameters that a fit moves: value, unit, bounds, transform, prior."""

import math
import numbers
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.estimation.priors import AbstractPrior
from iwanjax.estimation.transforms import Transform, to_value, to_variable
from iwanjax.files import nearest
from iwanjax.types import real

# Beyond it the logistic function is 0 or 1 to the last digit of a double.
_SATURATED = -math.log(sys.float_info.epsilon)


@dataclass(frozen=True)
class Parameter:
    """One quantity to be found.

    Parameters
    ----------
    name : str
        For instance ``"J1.F_S"``; results are keyed by it.
    value : float
        Where the search starts, and the estimate in a solution.
    unit : str
        Label for reports, never converted.
    meaning : str
        A few words for reports.
    lower, upper : float
        Bounds; the estimate may lie on them.
    transform : {"log", "logit", "identity"}
        The variable that is moved: the logarithm for what is positive, the logit between
        two finite bounds, or the parameter itself.
    prior : AbstractPrior
        What a posterior starts from, and what starting values are drawn from.
    fixed : bool
        Whether it stays at ``value``.

    Raises
    ------
    InputError
        For bounds that cross, a transform that does not suit them, a value outside them.

    Examples
    --------
    >>> import iwanjax as ij
    >>> k = ij.Parameter("k", 2.0, ij.LogUniform(0.1, 10.0), lower=0.1, upper=10.0, transform="log")
    >>> k.name, k.value
    ('k', 2.0)
    """

    name: str
    value: float
    prior: AbstractPrior = field(repr=False)
    unit: str = ""
    meaning: str = ""
    lower: float = -math.inf
    upper: float = math.inf
    transform: Transform = "identity"
    fixed: bool = False

    def __post_init__(self) -> None:
        """Hold the bounds, the transform and the value against each other."""
        if not self.lower < self.upper:
            raise InputError(
                f"parameter {self.name}: bounds [{self.lower:g}, {self.upper:g}] cross; expected "
                "lower < upper"
            )
        if self.transform == "log" and self.lower < 0:
            raise InputError(f"parameter {self.name}: a log transform needs lower >= 0")
        if self.transform == "logit" and not math.isfinite(self.upper - self.lower):
            raise InputError(f"parameter {self.name}: a logit transform needs two finite bounds")
        if not self.lower <= self.value <= self.upper:
            raise InputError(
                f"parameter {self.name}: value {self.value:g} lies outside its bounds "
                f"[{self.lower:g}, {self.upper:g}]"
            )
        one_sided = math.isfinite(self.lower) != math.isfinite(self.upper)
        if one_sided and self.transform != "log":
            raise InputError(
                f"parameter {self.name}: bounds [{self.lower:g}, {self.upper:g}] are one-sided, "
                "which only a log transform keeps; give both bounds"
            )


class Chart(eqx.Module):
    """The unbounded variables z behind the free ones of a row of parameters theta.

    Attributes
    ----------
    transforms : tuple of str
        For each parameter, fixed ones included.
    free : tuple of int
        Positions of the parameters that move.
    lower, upper, value : (parameters,) array
        Bounds and starting values.
    """

    transforms: tuple[Transform, ...] = eqx.field(static=True)
    free: tuple[int, ...] = eqx.field(static=True)
    lower: Float[Array, " parameters"]
    upper: Float[Array, " parameters"]
    value: Float[Array, " parameters"]

    def __init__(self, parameters: Sequence[Parameter]):
        # Between two bounds a variable keeps them whatever transform was asked for.
        self.transforms = tuple(
            "logit" if math.isfinite(p.upper - p.lower) else p.transform for p in parameters
        )
        self.free = tuple(i for i, p in enumerate(parameters) if not p.fixed)
        self.lower = real([p.lower for p in parameters])
        self.upper = real([p.upper for p in parameters])
        self.value = real([p.value for p in parameters])

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """Parameter values of the free variables."""
        values = list(self.value)
        for i, each in zip(self.free, z, strict=True):
            if self.transforms[i] == "logit":
                # On a bound itself, as chi = -1, a law may mean nothing.
                each = jnp.clip(each, -_SATURATED, _SATURATED)
            values[i] = to_value(self.transforms[i], each, self.lower[i], self.upper[i])
        return jnp.stack(values) if values else self.value

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """Free variables of parameter values, those on a bound pulled a hair inside."""
        z = [
            to_variable(self.transforms[i], theta[i], self.lower[i], self.upper[i])
            for i in self.free
        ]
        return jnp.stack(z) if z else jnp.zeros(0)


def replaced(
    parameters: Sequence[Parameter], others: Mapping[str, Parameter]
) -> tuple[Parameter, ...]:
    """The parameters with some of them exchanged by name.

    Raises
    ------
    InputError
        For a name that is not among them.
    """
    names = [p.name for p in parameters]
    if not isinstance(others, Mapping):
        raise InputError(
            f"parameters: expected a mapping of names to Parameter, got {type(others).__name__}"
        )
    for name, other in others.items():
        if name not in names:
            raise InputError(
                f"no parameter is called {name!r}; there are {', '.join(names)}"
                f"{nearest(str(name), names)}"
            )
        if not isinstance(other, Parameter) or other.name != name:
            raise InputError(
                f"parameters[{name!r}]: expected the Parameter of that name, changed by "
                f"dataclasses.replace; got {other!r}"
            )
    return tuple(others.get(p.name, p) for p in parameters)


def fixed_at(
    parameters: Sequence[Parameter], fixed: Mapping[str, float] | Sequence[str]
) -> tuple[Parameter, ...]:
    """The parameters with some of them held.

    Parameters
    ----------
    parameters : sequence of Parameter
    fixed : mapping of str to float, or sequence of str
        Values by name; or names alone, which stay at the value they have.

    Raises
    ------
    InputError
        For a name that is not among them, what is no number, a value outside the bounds.
    """
    if isinstance(fixed, str) or not isinstance(fixed, Mapping | Sequence):
        raise InputError(
            f"fixed: expected values by name, for instance {{{parameters[0].name!r}: "
            f"{parameters[0].value:g}}}, or a list of names; got {fixed!r}"
        )
    names = [p.name for p in parameters]
    for name in fixed:
        if name not in names:
            raise InputError(
                f"fixed: no parameter is called {name!r}; there are {', '.join(names)}"
                f"{nearest(str(name), names)}"
            )
    values = fixed if isinstance(fixed, Mapping) else {}
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise InputError(f"fixed[{name!r}]: expected a number, got {value!r}")
    return tuple(
        replace(p, value=float(values.get(p.name, p.value)), fixed=True) if p.name in fixed else p
        for p in parameters
    )


def with_values(parameters: Sequence[Parameter], theta: np.ndarray) -> tuple[Parameter, ...]:
    """The parameters at other values, (parameters,)."""
    return tuple(replace(p, value=float(v)) for p, v in zip(parameters, theta, strict=True))


def drawn(parameters: Sequence[Parameter], random: np.random.Generator, count: int) -> np.ndarray:
    """Starts (count, parameters): the values, then draws from the priors within the bounds."""
    return np.stack([_draws(p, random, count) for p in parameters], axis=1)


def _draws(p: Parameter, random: np.random.Generator, count: int) -> np.ndarray:
    if p.fixed:
        return np.full(count, p.value)
    draws = p.prior.draw(random, count)
    draws = np.where((draws >= p.lower) & (draws <= p.upper), draws, p.value)
    draws[0] = p.value
    return draws
