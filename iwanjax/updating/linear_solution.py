"""What low-amplitude updating has found, and what the modes could not tell."""

from dataclasses import dataclass, field

import numpy as np

from iwanjax.estimation.parameters import Parameter
from iwanjax.results import AbstractResult, with_std
from iwanjax.structures.affine import AffineStructure
from iwanjax.structures.linear import LinearStructure
from iwanjax.tables import Block, Grid
from iwanjax.updating.solution import Direction, ambiguities

# Shapes less alike than this may be of another mode.
_ALIKE = 0.8


@dataclass(frozen=True)
class LinearSolution(AbstractResult):
    r"""Result of :func:`iwanjax.update_linear`.

    Attributes
    ----------
    parameters, started : tuple of Parameter
        With the estimates as values, and as they were given.
    covariance : (parameters, parameters) array
        Of the estimates, linearised; combinations that the data leave open are closed by the
        priors. Zero for fixed parameters and those on a bound.
    undetermined : tuple of Direction
        Combinations that the data narrow to no less than a third of the prior.
    determined : dict of str to bool
        For each free parameter, whether the data narrow it to less than a third.
    rivals : dict of str to (float, float)
        Range of each parameter over minima that noise may have made the worse ones, where that
        is more than a third of its prior; such are not determined.
    active_bounds : dict of str to float
        Parameters that the data would move beyond a bound, and the bound.
    measured_frequency, frequency_std : (k,) array
        Hz.
    frequency_before, frequency : (k,) array
        Of the model at the starting values and at the estimates, Hz.
    mode : (k,) array of int
        The mode of the model that each measured one is matched with, rigid ones counted.
    assurance : (k,) array
        Modal assurance of the two.
    misfit_frequency, misfit_shapes : float
        Root mean square of the differences over their deviations; None without shapes.
    converged : bool
        Whether the best run ended by its tolerance.
    agreeing, runs : int
        Runs that ended at the same cost as the best, and runs in all.
    structure : AffineStructure
        What was updated.
    """

    parameters: tuple[Parameter, ...]
    started: tuple[Parameter, ...]
    covariance: np.ndarray = field(repr=False)
    undetermined: tuple[Direction, ...]
    determined: dict[str, bool]
    rivals: dict[str, tuple[float, float]]
    active_bounds: dict[str, float]
    measured_frequency: np.ndarray
    frequency_std: np.ndarray
    frequency_before: np.ndarray
    frequency: np.ndarray
    mode: np.ndarray
    assurance: np.ndarray
    misfit_frequency: float
    misfit_shapes: float | None
    converged: bool
    agreeing: int
    runs: int
    structure: AffineStructure = field(repr=False)

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name."""
        return {p.name: p.value for p in self.parameters}

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations by name; zero for fixed ones and those on a bound."""
        deviations = np.sqrt(np.diag(self.covariance))
        return {p.name: float(s) for p, s in zip(self.parameters, deviations, strict=True)}

    @property
    def error(self) -> np.ndarray:
        """Of the model's frequencies relative to the measured ones, (k,)."""
        return self.frequency / self.measured_frequency - 1.0

    @property
    def updated(self) -> LinearStructure:
        """The structure with the estimates, undamped."""
        return self.structure.at(self.values)

    def _blocks(self) -> tuple[Block, ...]:
        state = "" if self.converged else " NOT CONVERGED: raise starts or look at the data."
        shapes = "" if self.misfit_shapes is None else f", shapes {self.misfit_shapes:.2f}"
        modes = zip(
            self.measured_frequency,
            self.frequency_before,
            self.frequency,
            self.error,
            self.assurance,
            strict=True,
        )
        return (
            f"Frequencies are {self.misfit_frequency:.2f} times their deviations off{shapes}; "
            f"{self.agreeing} of {self.runs} runs agree.{state}",
            Grid(
                ("measured Hz", "before", "after", "error", "MAC"),
                tuple(
                    (f"{f:.6g}", f"{before:.6g}", f"{after:.6g}", f"{100 * e:+.3f} %", f"{mac:.4f}")
                    for f, before, after, e, mac in modes
                ),
            ),
            Grid((), tuple((p.name, self._told(p), p.meaning) for p in self.parameters)),
            *ambiguities(self.rivals, self.undetermined, "modes"),
            "\n".join(f"  {warning}" for warning in self.warnings()),
        )

    def warnings(self) -> list[str]:
        """What to look at before the estimates are believed."""
        found = [
            f"BOUND: {name} rests on its bound {bound:g}; the data ask for a value beyond it"
            for name, bound in self.active_bounds.items()
        ]
        found += [
            f"The mode at {f:.6g} Hz is like none of the model's (MAC {mac:.2f})"
            for f, mac in zip(self.measured_frequency, self.assurance, strict=True)
            if mac < _ALIKE
        ]
        if len(set(self.mode.tolist())) < self.mode.size:
            found.append("Two measured modes are matched with one of the model's")
        return found

    def _told(self, p: Parameter) -> str:
        unit = f" {p.unit}" if p.unit else ""
        if p.fixed:
            return f"{p.value:.6g}{unit} (fixed)"
        if p.name in self.active_bounds:
            return f"{p.value:.6g}{unit} (on its bound)"
        if not self.determined[p.name]:
            return f"{p.value:.3g}{unit} (undetermined)"
        return with_std(p.value, self.std[p.name]) + unit
