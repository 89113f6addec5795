"""What a fit compares: measured curves, a model's prediction of them, the residuals."""

import abc
import re
from collections.abc import Mapping, Sequence
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Parameter
from iwanjax.estimation.problem import AbstractLeastSquares
from iwanjax.types import real
from iwanjax.updating.microslip import IwanPlace

Reference = Literal["absolute", "shift"]
"""Whether frequencies are compared as they are, or up to one offset for each curve."""

_FEWEST_LEVELS = 3


class Measured(eqx.Module):
    """Measured levels of all curves, one after the other.

    Attributes
    ----------
    q : (N,) array
        Displacement amplitude of the model's coordinate.
    frequency, damping, frequency_std, damping_std : (N,) array
        Hz and 1.
    largest : (N,) array
        Largest amplitude that the mode had reached by then, as q: what the level's own curve says
        of it, or else its highest level.
    edges : tuple of int
        Where each curve begins, and N.
    """

    q: Float[Array, " N"]
    frequency: Float[Array, " N"]
    damping: Float[Array, " N"]
    frequency_std: Float[Array, " N"]
    damping_std: Float[Array, " N"]
    largest: Float[Array, " N"]
    edges: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls, curves: Sequence[ModalCurves], factors: Sequence[float] | None = None
    ) -> "Measured":
        """The levels of curves; ``factors`` turn each one's displacement into q.

        Raises
        ------
        InputError
            For curves without deviations, of too few levels, or not all finite and positive.
        """
        factors = [1.0] * len(curves) if factors is None else factors
        columns = [
            _columns(i, each, factor)
            for i, (each, factor) in enumerate(zip(curves, factors, strict=True))
        ]
        edges = np.concatenate([[0], np.cumsum([column.shape[1] for column in columns])])
        q, f, zeta, f_std, zeta_std, largest = (real(row) for row in np.hstack(columns))
        return cls(q, f, zeta, f_std, zeta_std, largest, tuple(int(e) for e in edges))

    @property
    def slices(self) -> tuple[slice, ...]:
        """The levels of each curve."""
        return tuple(slice(a, b) for a, b in zip(self.edges[:-1], self.edges[1:], strict=True))


def _columns(i: int, curves: ModalCurves, factor: float) -> np.ndarray:
    if not isinstance(curves, ModalCurves):
        raise InputError(f"curve {i}: expected ModalCurves, got {type(curves).__name__}")
    label = f"curve {i}" + (f" ({curves.name})" if curves.name else "")
    if curves.frequency_std is None or curves.damping_std is None:
        raise InputError(
            f"{label} has no standard deviations, which weigh frequency against damping; give "
            "frequency_std and damping_std, or model_error= to fit curves without noise"
        )
    if curves.amplitude.ndim != 1 or curves.amplitude.size < _FEWEST_LEVELS:
        raise InputError(
            f"{label} has shape {curves.amplitude.shape}; expected (levels,) with at least "
            f"{_FEWEST_LEVELS}"
        )
    seen = curves.as_quantity("displacement")
    displacement = np.asarray(seen.amplitude) * factor
    told = -np.inf if seen.largest is None else float(seen.largest) * factor
    rows = np.stack(
        [
            np.asarray(row)
            for row in (
                displacement,
                curves.frequency,
                curves.damping,
                curves.frequency_std,
                curves.damping_std,
                np.full(displacement.shape, max(told, float(np.max(displacement)))),
            )
        ]
    )
    for name, row in zip(
        ("amplitude", "frequency", "", "frequency_std", "damping_std", "largest"), rows, strict=True
    ):
        if not np.all(np.isfinite(row)):
            raise InputError(f"{label} holds NaN; take those levels out")
        if name and not np.all(row > 0):
            raise InputError(f"{label}: {name} holds {row.min():g}; expected positive numbers")
    return rows


class AbstractProblem(AbstractLeastSquares):
    """A model with free parameters, and the curves it is held against."""

    measured: eqx.AbstractVar[Measured]
    reference: eqx.AbstractVar[Reference]

    @abc.abstractmethod
    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """Frequency (Hz) and damping at the measured amplitudes, (N,) each."""

    def predict_sets(self, theta: Float[Array, "sets parameters"]) -> tuple[Array, Array]:
        """The same of many parameter sets, (sets, N) each."""
        return jax.vmap(self.predict)(theta)

    @abc.abstractmethod
    def model(self, theta: Float[Array, " parameters"]) -> eqx.Module:
        """The model with these parameters."""

    @property
    def most_runs(self) -> int:
        """How many starts, the best of each neighbourhood, are run to their minimum."""
        return 16

    def spread(self, draws: np.ndarray) -> np.ndarray:
        """Starts (starts, parameters) moved so that neighbouring valleys all get some, in order."""
        return draws

    def restarts(self, theta: np.ndarray, count: int) -> np.ndarray | None:
        """As many further starts about the best end, where valleys lie side by side; in order."""
        return None

    def remarks(self, values: Mapping[str, float], determined: Mapping[str, bool]) -> list[str]:
        """What else is to be said of an estimate, in sentences."""
        return []

    def iwan_places(self, theta: Float[Array, " parameters"]) -> tuple[IwanPlace, ...]:
        """The Iwan joints among the parameters, and how far the curves take each."""
        return ()

    def derived(self, theta: Float[Array, " parameters"]) -> Mapping[str, Array]:
        """What follows from the parameters and is worth reporting with its deviation."""
        return {}

    def differences(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """Predicted less measured frequency and damping, over their deviations, (N,) each."""
        return self.compared(*self.predict(theta))

    def compared(self, f: Array, zeta: Array) -> tuple[Array, Array]:
        """The same of a prediction."""
        f, zeta = self.shifted(f, zeta)
        measured = self.measured
        return (
            (f - measured.frequency) / measured.frequency_std,
            (zeta - measured.damping) / measured.damping_std,
        )

    def shown(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """The prediction as it is compared: without each curve's own offset for a shift."""
        return self.shifted(*self.predict(theta))

    def shifted(self, f: Array, zeta: Array) -> tuple[Array, Array]:
        """The same of a prediction."""
        if self.reference == "absolute":
            return f, zeta
        measured = self.measured
        difference = f - measured.frequency
        weight = 1.0 / measured.frequency_std**2
        # The offset that fits each curve best is its own: linear, so eliminated.
        offsets = [
            jnp.broadcast_to(
                jnp.sum(weight[part] * difference[part]) / jnp.sum(weight[part]),
                difference[part].shape,
            )
            for part in measured.slices
        ]
        return f - jnp.concatenate(offsets), zeta

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """All differences in one row, (2 N,)."""
        return jnp.concatenate(self.differences(theta))


_MODAL_UNITS = {
    "1": "",
    "length": "{0}",
    "force": "{0}/s^2",
    "force/length": "1/s^2",
    "force/length^2": "1/({0} s^2)",
    "force/length^3": "1/({0}^2 s^2)",
    "force*time/length": "1/s",
    "force*time^2/length^2": "1/{0}",
    "time": "s",
}


def modal_unit(dimension: str, curves: ModalCurves) -> str:
    """Unit of a joint's parameter per unit modal mass, from the curves' own unit.

    A velocity in mm/s, say, has the force in mm/s^2; without a known unit of length the
    dimension itself.
    """
    ending = {"velocity": r"/s", "acceleration": r"/s(\^2|²|2)"}.get(curves.quantity, "")
    length = re.fullmatch(rf"(\w+){ending}", curves.unit)
    if length is None or dimension not in _MODAL_UNITS:
        return unit_of(dimension)
    return _MODAL_UNITS[dimension].format(length.group(1))


def unit_of(dimension: str) -> str:
    """Label of a parameter in the units of the model, which are not known further."""
    return "" if dimension == "1" else dimension


def check_free(parameters: Sequence[Parameter], measured: Measured) -> None:
    """Refuse more free parameters than data.

    Raises
    ------
    InputError
    """
    free = sum(not p.fixed for p in parameters)
    if free == 0:
        raise InputError("all parameters are fixed; free at least one")
    if free > 2 * measured.q.size:
        raise InputError(
            f"{free} free parameters for {2 * measured.q.size} measured values; fix some"
        )
