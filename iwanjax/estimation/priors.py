"""What is believed of a parameter before the data."""

import abc
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtri

from iwanjax.errors import InputError
from iwanjax.types import is_traced, real

_LOG_ROOT_TAU = 0.5 * math.log(2.0 * math.pi)


class AbstractPrior(eqx.Module):
    """A proper distribution of one parameter."""

    @abc.abstractmethod
    def log_density(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Logarithm of the density at values; minus infinity outside the support."""

    @abc.abstractmethod
    def score(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Deviations from the middle, as a residual; zero where all values are as likely."""

    @abc.abstractmethod
    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Values drawn from the distribution, (count,)."""

    @abc.abstractmethod
    def quantile(self, share: np.ndarray) -> np.ndarray:
        """The value below which so large a share of the distribution lies, 0 < share < 1."""


class Uniform(AbstractPrior):
    """Equal density between two ends.

    Parameters
    ----------
    low, high : float
        Ends, in the parameter's unit.

    Examples
    --------
    >>> import iwanjax as ij
    >>> prior = ij.Uniform(low=0.0, high=4.0)
    >>> round(float(prior.log_density(1.0)), 4)  # -log 4
    -1.3863
    """

    low: Array = eqx.field(converter=real)
    high: Array = eqx.field(converter=real)

    def __check_init__(self) -> None:
        """Hold the ends against each other."""
        _check_order("Uniform", self.low, self.high)

    def log_density(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Constant inside."""
        inside = (value >= self.low) & (value <= self.high)
        return jnp.where(inside, -jnp.log(self.high - self.low), -jnp.inf)

    def score(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """None: bounds keep what is outside away."""
        return jnp.zeros_like(value)

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Values between the ends."""
        return random.uniform(self.low, self.high, count)

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Linear in the share."""
        return np.asarray(self.low + share * (self.high - self.low))


class LogUniform(AbstractPrior):
    """Equal density of the logarithm between two positive ends.

    Parameters
    ----------
    low, high : float
        Ends, in the parameter's unit.

    Examples
    --------
    >>> import iwanjax as ij
    >>> prior = ij.LogUniform(low=1.0, high=100.0)
    >>> round(float(prior.log_density(10.0)), 4)  # -log(10 log 100)
    -3.8298
    """

    low: Array = eqx.field(converter=real)
    high: Array = eqx.field(converter=real)

    def __check_init__(self) -> None:
        """Hold the ends against each other and zero."""
        _check_order("LogUniform", self.low, self.high)
        _check_positive("LogUniform", "low", self.low)

    def log_density(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """One over the value inside."""
        inside = (value >= self.low) & (value <= self.high)
        safe = jnp.where(inside, value, 1.0)
        return jnp.where(inside, -jnp.log(safe) - jnp.log(jnp.log(self.high / self.low)), -jnp.inf)

    def score(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """None: bounds keep what is outside away."""
        return jnp.zeros_like(value)

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Values between the ends."""
        return np.exp(random.uniform(np.log(self.low), np.log(self.high), count))

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Its logarithm is linear in the share."""
        return np.asarray(self.low * (self.high / self.low) ** share)


class Normal(AbstractPrior):
    """Gauss's distribution.

    Parameters
    ----------
    mean, std : float
        In the parameter's unit.

    Examples
    --------
    >>> import iwanjax as ij
    >>> prior = ij.Normal(mean=0.0, std=1.0)
    >>> round(float(prior.log_density(0.0)), 4)  # -log(2 pi) / 2
    -0.9189
    """

    mean: Array = eqx.field(converter=real)
    std: Array = eqx.field(converter=real)

    def __check_init__(self) -> None:
        """Hold the mean against infinity and the deviation against zero."""
        if not is_traced(self.mean) and not np.isfinite(float(self.mean)):
            raise InputError(f"Normal: mean = {self.mean:g}; expected a number")
        _check_positive("Normal", "std", self.std)

    def log_density(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Quadratic in the value."""
        z = (value - self.mean) / self.std
        return -0.5 * z**2 - jnp.log(self.std) - _LOG_ROOT_TAU

    def score(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Linear in the value."""
        return (value - self.mean) / self.std

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Values about the mean."""
        return random.normal(self.mean, self.std, count)

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Of Gauss's distribution."""
        return np.asarray(self.mean + self.std * ndtri(share))


class LogNormal(AbstractPrior):
    """Gauss's distribution of the logarithm.

    Parameters
    ----------
    median : float
        In the parameter's unit.
    sigma : float
        Deviation of the natural logarithm, 1.

    Examples
    --------
    >>> import iwanjax as ij
    >>> prior = ij.LogNormal(median=2.0, sigma=0.5)
    >>> round(float(prior.log_density(2.0)), 4)
    -0.9189
    """

    median: Array = eqx.field(converter=real)
    sigma: Array = eqx.field(converter=real)

    def __check_init__(self) -> None:
        """Hold both against zero."""
        _check_positive("LogNormal", "median", self.median)
        _check_positive("LogNormal", "sigma", self.sigma)

    def log_density(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Quadratic in the logarithm, over the value."""
        positive = value > 0
        log = jnp.log(jnp.where(positive, value, 1.0))
        z = (log - jnp.log(self.median)) / self.sigma
        density = -0.5 * z**2 - log - jnp.log(self.sigma) - _LOG_ROOT_TAU
        return jnp.where(positive, density, -jnp.inf)

    def score(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Linear in the logarithm."""
        return jnp.log(value / self.median) / self.sigma

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Values about the median."""
        return float(self.median) * np.exp(random.normal(0.0, self.sigma, count))

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Of Gauss's distribution of the logarithm."""
        return np.asarray(self.median * np.exp(self.sigma * ndtri(share)))


PRIORS: dict[str, type[AbstractPrior]] = {
    "uniform": Uniform,
    "log_uniform": LogUniform,
    "normal": Normal,
    "log_normal": LogNormal,
}
"""Names that study files use."""


def _check_order(name: str, low: Array, high: Array) -> None:
    if not is_traced(low, high) and not -np.inf < float(low) < float(high) < np.inf:
        raise InputError(f"{name}(low={low:g}, high={high:g}): expected low < high, both finite")


def _check_positive(name: str, what: str, value: Array) -> None:
    if not is_traced(value) and not 0.0 < float(value) < np.inf:
        raise InputError(f"{name}: {what} = {value:g}; expected a positive number")
