"""What the data say of the parameters: the chain of a posterior, its intervals and bands."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.tables import Block, Grid
from iwanjax.updating.problem import AbstractProblem
from iwanjax.updating.solution import FitSolution

if TYPE_CHECKING:
    import arviz  # pyright: ignore[reportMissingImports]

TRUSTED = 40.0
"""Autocorrelation times that a chain has to be long for the estimate of it to be trusted."""


@dataclass(frozen=True, eq=False)
class Band:
    """Range of a prediction at the levels of one measured curve.

    Attributes
    ----------
    amplitude : (levels,) array
        In the curve's own quantity.
    frequency, damping : (3, levels) array
        Lower end, median and upper end.
    """

    amplitude: np.ndarray
    frequency: np.ndarray
    damping: np.ndarray


@dataclass(frozen=True, eq=False)
class Posterior(AbstractResult):
    """Result of :func:`iwanjax.sample_posterior`.

    Attributes
    ----------
    names : tuple of str
        Free parameters, then the two noise scales.
    chain : (steps, walkers, names) array
        Values after what is thrown away at the beginning, as the walkers went.
    log_density : (steps, walkers) array
        In the variables that were sampled.
    autocorrelation : dict of str to float
        Steps after which a walker has forgotten where it was.
    effective : dict of str to float
        Independent samples that the chain is worth.
    wanted : int
        Effective samples that were asked for.
    enough : bool
        Whether every parameter has them, from a chain long enough to tell.
    acceptance : float
        Share of proposals that were taken.
    burnt : int
        Steps thrown away.
    solution : FitSolution
        The fit it started from.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> q, one = np.geomspace(5e-4, 2e-2, 20), np.ones(20)
    >>> mode = ij.ModalOscillator(10.0, 1e-3, ij.Jenkins(F_S=1.0, K_T=500.0))
    >>> f, zeta = mode.ringdown_frequency_and_damping(q)
    >>> curves = ij.ModalCurves(q, f, zeta, frequency_std=1e-3 * one, damping_std=1e-5 * one)
    >>> solution = ij.fit("jenkins", curves)
    >>> posterior = ij.sample_posterior(solution, effective=100, walkers=20, most_steps=300)
    >>> low, high = np.quantile(posterior.samples["F_S"], [0.025, 0.975])
    >>> bool(low < 1.0 < high)
    True
    """

    names: tuple[str, ...]
    chain: np.ndarray = field(repr=False)
    log_density: np.ndarray = field(repr=False)
    autocorrelation: dict[str, float]
    effective: dict[str, float]
    wanted: int
    enough: bool
    acceptance: float
    burnt: int
    solution: FitSolution = field(repr=False)

    @property
    def samples(self) -> dict[str, np.ndarray]:
        """All values of each parameter, (steps x walkers,)."""
        flat = self.chain.reshape(-1, len(self.names))
        return dict(zip(self.names, flat.T, strict=True))

    def draws(self, count: int, seed: int = 0) -> np.ndarray:
        """Full parameter vectors drawn from the chain, (count, parameters)."""
        flat = self.chain.reshape(-1, len(self.names))
        chosen = np.random.default_rng(seed).integers(0, len(flat), count)
        theta = np.tile([p.value for p in self.solution.parameters], (count, 1))
        theta[:, list(self.solution.problem.chart.free)] = flat[chosen, :-2]
        return theta

    def interval(self, name: str, probability: float = 0.9) -> tuple[float, float]:
        """Ends of the central interval of a parameter."""
        tail = 0.5 * (1.0 - probability)
        low, high = np.quantile(self.samples[name], [tail, 1.0 - tail])
        return float(low), float(high)

    def bands(self, probability: float = 0.9, count: int = 400) -> tuple[Band, ...]:
        """Ranges of frequency and damping at the measured amplitudes, parameters only.

        Parameters
        ----------
        probability : float
            Of the central range.
        count : int
            Draws from the chain.
        """
        tail = 0.5 * (1.0 - probability)
        problem = self.solution.problem
        f, zeta = (np.asarray(x) for x in _shown(problem, jnp.asarray(self.draws(count))))
        ends = [tail, 0.5, 1.0 - tail]
        return tuple(
            Band(
                np.asarray(curve.amplitude),
                np.quantile(f[:, part], ends, axis=0),
                np.quantile(zeta[:, part], ends, axis=0),
            )
            for curve, part in zip(self.solution.measured, problem.measured.slices, strict=True)
        )

    def _blocks(self) -> tuple[Block, ...]:
        least = min(self.effective, key=lambda name: self.effective[name])
        if self.enough:
            head = f"posterior of {len(self.names) - 2} parameters: "
            head += f"at least {self.effective[least]:.0f} effective samples of each"
        else:
            head = (
                f"posterior NOT LONG ENOUGH: after {len(self.chain)} steps it got to "
                f"{self.effective[least]:.0f} effective samples of {least} ({self.wanted} were "
                f"asked for, from at least {TRUSTED:.0f} autocorrelation times of "
                f"{max(self.autocorrelation.values()):.0f} steps); raise most_steps to go on"
            )
        rows = [(name, self._told(name), self._note(name)) for name in self.names]
        head = f"{head} (acceptance {self.acceptance:.2f})"
        return head, Grid((), tuple(rows)), "  median and central 90 %"

    def _told(self, name: str) -> str:
        """Median and central interval to three digits of the interval's width."""
        low, high = self.interval(name)
        digits = max(0, 2 - int(np.floor(np.log10(high - low)))) if high > low else 6
        median = np.median(self.samples[name])
        unit = {p.name: p.unit for p in self.solution.parameters}.get(name, "")
        told = f"{median:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}] {unit}"
        return told.rstrip()

    def _note(self, name: str) -> str:
        return "" if self.solution.determined.get(name, True) else "mostly the prior's"

    def to_arviz(self) -> "arviz.InferenceData":
        """The chain for arviz (extra ``bayes``).

        Raises
        ------
        InputError
            Where arviz is not installed.
        """
        try:
            import arviz  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise InputError(
                "to_arviz needs arviz: install iwanjax with the extra 'bayes'"
            ) from None
        walkers_first = np.swapaxes(self.chain, 0, 1)
        values = {name: walkers_first[..., i] for i, name in enumerate(self.names)}
        return arviz.from_dict({"posterior": values})


@eqx.filter_jit
def _shown(problem: AbstractProblem, theta: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Predictions of many parameter vectors, as they are compared with the data."""
    return jax.lax.map(problem.shown, theta)
