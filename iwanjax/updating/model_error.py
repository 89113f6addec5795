"""What a model's curves are wrong by themselves, for data that have no noise."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError


class ModelError(NamedTuple):
    r"""Relative standard deviations of a model's frequency and damping, 1.

    Joined with the curves' own deviations,
    :math:`\sigma_f^2 + (\epsilon_f f)^2` and :math:`\sigma_\zeta^2 + (\epsilon_\zeta\zeta)^2`.
    """

    frequency: float
    damping: float


WITHOUT_NOISE = ModelError(2e-4, 1.5e-2)
"""What is taken for curves without noise, decays that were simulated.

Relative, 1. Source: quasi-static curves of the thesis's three masses against the Hilbert
transform of simulated decays, mode 2 in microslip (Sec. 2.3.1; 0.01 % and 1.2 %, met within
0.02 % and 1.5 % by tests/reference/test_three_mass.py). Between microslip and macroslip they
are ten times as wrong, over a few levels. Ten times this, or twice the damping's share with
half the frequency's, moves the fitted parameters of Table 2.3 by less than half a per cent
(mode 1, whose damping is mostly viscous: chi by 3 %); the stated deviations go in proportion.
"""

# Share of the model's error below which noise adds nothing to it: half a per cent in quadrature.
_NEGLIGIBLE = 0.1


def model_error_of(
    curves: Sequence[ModalCurves], asked: tuple[float, float] | None
) -> ModelError | None:
    """The model's error that a fit has to allow for; None for none.

    ``asked`` itself where it is given. Else that of curves without noise, where the medians of
    both kinds of stated deviations are a tenth of it or less: no measurement is that good, and
    a fit to such deviations would be ruled by what the model cannot follow.

    Raises
    ------
    InputError
        For what is no pair of numbers, or negative ones.
    """
    if asked is not None:
        numbers = np.asarray(asked, dtype=object)
        if numbers.shape != (2,) or not all(
            isinstance(x, int | float) and math.isfinite(x) and x >= 0 for x in numbers
        ):
            raise InputError(
                f"fit: model_error = {asked!r}; expected relative deviations of frequency and "
                f"damping, for instance {tuple(WITHOUT_NOISE)}"
            )
        own = ModelError(*(float(x) for x in numbers))
        return own if any(own) else None
    silent = all(
        _median_share(curves, kind) <= _NEGLIGIBLE * getattr(WITHOUT_NOISE, kind)
        for kind in ModelError._fields
    )
    return WITHOUT_NOISE if silent else None


def _median_share(curves: Sequence[ModalCurves], kind: str) -> float:
    """Median over all levels of a stated deviation over its value; infinite where one is missing.

    A deviation of zero is no deviation, and refused later.
    """
    stds = [getattr(each, f"{kind}_std") for each in curves]
    if not stds or any(std is None for std in stds):
        return math.inf
    values = [np.ravel(np.abs(np.asarray(getattr(each, kind)))) for each in curves]
    known = np.concatenate([np.ravel(np.asarray(std)) for std in stds])
    if not np.all(known > 0.0):
        return math.inf
    return float(np.median(known / np.concatenate(values)))


def with_model_error(
    curves: Sequence[ModalCurves], error: ModelError | None
) -> tuple[ModalCurves, ...]:
    """The curves with a model's error in their deviations; curves without any get it alone."""
    if error is None:
        return tuple(curves)
    return tuple(
        ModalCurves(
            each.amplitude,
            each.frequency,
            each.damping,
            amplitude_std=each.amplitude_std,
            frequency_std=_joined(each.frequency_std, error.frequency, each.frequency),
            damping_std=_joined(each.damping_std, error.damping, each.damping),
            quantity=each.quantity,
            unit=each.unit,
            name=each.name,
            largest=each.largest,
        )
        for each in curves
    )


def _joined(std: object, share: float, value: object) -> np.ndarray:
    own = 0.0 if std is None else np.asarray(std)
    return np.hypot(own, share * np.abs(np.asarray(value)))
