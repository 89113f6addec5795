"""A fit put into plain words and numbers."""

import math

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.estimation.parameters import Parameter
from iwanjax.estimation.priors import AbstractPrior, LogUniform, Uniform
from iwanjax.plotting.columns import offset
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.report.page import Callout
from iwanjax.updating.solution import FitSolution

EXPLAINED, POOR = 1.3, 2.0
"""Misfits up to which a model explains its curves, and beyond which it does not."""

_PRIOR_DRAWS = 20_000
# A combination with such a component is that parameter.
_SINGLE = 0.97
# Powers of ten that are written out.
_PLAIN = (-3, 6)
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float, digits: int = 3) -> str:
    """A value to some significant digits, for instance ``1.19×10⁻⁴``.

    Parameters
    ----------
    value : float
        What to tell.
    digits : int
        How many.

    Returns
    -------
    str
    """
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    power = _power(float(f"{value:.{digits - 1}e}"))
    shown = value / 10.0**power
    decimals = digits - 1 - math.floor(math.log10(abs(float(f"{shown:.{digits - 1}e}"))))
    return f"{round(shown, decimals):.{max(0, decimals)}f}{_times(power)}"


def with_deviation(value: float, std: float) -> tuple[str, str]:
    """A value to the digits that its deviation leaves, and the deviation in the same form.

    Parameters
    ----------
    value, std : float
        A deviation that is zero or not finite is left out; one without end determines nothing.

    Returns
    -------
    (str, str)
    """
    v, s, power = _pair(value, std)
    if std == math.inf:
        return f"{v}{_times(power)}", "not determined"
    return f"{v}{_times(power)}", f"{s}{_times(power)}" if s else "–"


def told(name: str, value: float, std: float, unit: str = "") -> str:
    """For instance ``f_0 = 118.0012 ± 0.0021 Hz``, with spaces that do not break."""
    v, s, power = _pair(value, std)
    text = f"{v} ± {s}" if s else v
    text = f"({text}){_times(power)}" if power and s else f"{text}{_times(power)}"
    text = f"{name} = {text}" if name else text
    return f"{text} {unit}".strip().replace(" ", "\N{NO-BREAK SPACE}")


def _pair(value: float, std: float) -> tuple[str, str, int]:
    """Value and deviation over a common power of ten, and that."""
    if not (math.isfinite(std) and std > 0 and math.isfinite(value)):
        return number(value, 6), "", 0
    power = _power(max(abs(value), std))
    v, s = value / 10.0**power, std / 10.0**power
    decimals = 1 - math.floor(math.log10(float(f"{s:.1e}")))
    return (
        f"{round(v, decimals):.{max(0, decimals)}f}",
        f"{round(s, decimals):.{max(0, decimals)}f}",
        power,
    )


def _power(value: float) -> int:
    """The power of ten that a number is told with; zero for those of usual size."""
    power = math.floor(math.log10(abs(value)))
    return 0 if _PLAIN[0] <= power < _PLAIN[1] else power


def _times(power: int) -> str:
    return f"×10{str(power).translate(_RAISED)}" if power else ""


def listed(items: list[str]) -> str:
    """Items with commas, and "and" before the last."""
    return " and ".join(filter(None, [", ".join(items[:-1]), *items[-1:]]))


def prior_range(prior: AbstractPrior) -> str:
    """Ends of a uniform prior, or its central 90 per cent."""
    if isinstance(prior, Uniform | LogUniform):
        low, high = float(prior.low), float(prior.high)
    else:
        draws = prior.draw(np.random.default_rng(0), _PRIOR_DRAWS)
        low, high = (float(x) for x in np.quantile(draws, [0.05, 0.95]))
    # As many digits as show how far apart the ends are.
    apart = abs(high - low)
    digits = 3 + max(0, math.floor(math.log10(max(abs(low), abs(high)) / apart)))
    return f"{number(low, digits)} to {number(high, digits)}"


def explanation(solution: FitSolution) -> str:
    """How well the model explains the curves, in their own units and against their noise."""
    curves = solution.measured
    f, zeta = _errors(solution)
    over = f"{sum(curve.amplitude.size for curve in curves)} levels"
    if len(curves) > 1:
        what = "hits" if isinstance(solution.model, ModalOscillator) else "modes"
        over += f" of {len(curves)} {what}"
    kinds = {(curve.quantity, curve.unit) for curve in curves}
    if len(kinds) == 1:
        reach = np.concatenate([np.asarray(curve.amplitude) for curve in curves])
        ((quantity, unit),) = kinds
        over += f", {quantity} amplitude {number(reach.min(), 2)} to "
        over += f"{number(reach.max(), 2)} {unit}".rstrip()
    sentence = (
        f"{model_name(solution)} follows the measured frequency to {number(f, 2)} Hz and the "
        f"damping to {number(100 * zeta, 2)} % (root mean square over {over})"
    )
    own = solution.model_error
    ratio = f"{number(solution.misfit, 2)} times the stated deviations"
    if own is not None:
        ratio += (
            f" with {number(100 * own.frequency, 2)} % of the frequency and "
            f"{number(100 * own.damping, 2)} % of the damping for the model's own error"
        )
    if solution.misfit <= EXPLAINED:
        return f"{sentence}: {ratio}, so that it explains the curves to their noise."
    if solution.misfit <= POOR:
        return f"{sentence}: {ratio}, so that it explains the curves nearly to their noise."
    return (
        f"{sentence}: {ratio} (frequency {number(solution.misfit_frequency, 2)}, damping "
        f"{number(solution.misfit_damping, 2)}). It leaves out something that the curves show."
    )


def model_name(solution: FitSolution) -> str:
    """What was fitted."""
    if isinstance(solution.model, ModalOscillator):
        return f"An oscillator with one {type(solution.model.joint).__name__} joint"
    free = sum(not p.fixed for p in solution.parameters)
    return f"The structure with {free} free parameters"


def findings(solution: FitSolution) -> str:
    """The parameters that the curves determine."""
    found = [
        told(p.name, p.value, solution.std[p.name], p.unit)
        for p in solution.parameters
        if solution.determined.get(p.name, False)
    ]
    if not found:
        return "The curves determine none of the parameters on its own."
    text = f"The curves determine {listed(found)}"
    if solution.misfit > 1.0:
        text += f"; these deviations are widened by the misfit, {number(solution.misfit, 2)}"
    return f"{text}."


def macroslip(solution: FitSolution) -> str:
    """Whether the curves reach the displacement at which all sliders slip; may be empty."""
    if "phi_max" not in solution.derived or not isinstance(solution.model, ModalOscillator):
        return ""
    if not solution.follows("phi_max"):
        least = solution.least("phi_max")
        beyond = "" if least is None else f", but beyond the largest measured, {number(least)}"
        return f"From which displacement on the joint slips altogether is not determined{beyond}."
    value, std = solution.derived["phi_max"]
    largest = float(np.max(np.asarray(solution.problem.measured.q)))
    unit = length_unit(solution.measured[0])
    reach, where = f"{number(largest)} {unit}".rstrip(), told("", value, std, unit)
    if value < largest:
        return (
            f"The joint slips altogether from a displacement of {where} on, which the curves "
            f"reach: they go up to {reach}."
        )
    return (
        f"The curves go up to a displacement of {reach}; the joint slips altogether only from "
        f"{where} on, so that its strength is an extrapolation."
    )


def open_questions(solution: FitSolution) -> str:
    """What the curves leave undetermined; may be empty."""
    names = [name for name, known in solution.determined.items() if not known]
    if not names and not solution.undetermined:
        return ""
    text = f"They do not determine {listed(names)} on " if names else ""
    text += ("its own" if len(names) == 1 else "their own") if names else ""
    directions = listed(
        [
            f"{direction} (known to {100 * direction.narrowing:.0f} % of what the prior leaves "
            "open)"
            for direction in solution.undetermined
            # One that is a single parameter has been named already.
            if max(map(abs, direction.components.values())) < _SINGLE or not names
        ]
    )
    if directions:
        opening = "; open is" if names else "They leave open"
        text += f"{opening} the combination {directions}"
    return f"{text}. Such values are mostly the priors'."


def rivals(solution: FitSolution) -> str:
    """How far other minima that are as good lie apart; may be empty."""
    ranges = [
        f"{name} from {number(low)} to {number(high)}"
        for name, (low, high) in solution.rivals.items()
    ]
    if not ranges:
        return ""
    return f"Other minima explain the curves as well, with {listed(ranges)}."


def bounds(solution: FitSolution) -> str:
    """What rests on a bound; may be empty."""
    if not solution.active_bounds:
        return ""
    rests = [f"{name} rests on its bound {at:g}" for name, at in solution.active_bounds.items()]
    return f"{listed(rests)}: the curves ask for a value beyond."


def cautions(solution: FitSolution) -> list[Callout]:
    """What a reader must not overlook."""
    found = [
        Callout(
            f"{name} rests on its bound {at:g}. The curves ask for a value beyond it, the other "
            "parameters pay for that, and their deviations do not say so.",
            "bound",
        )
        for name, at in solution.active_bounds.items()
    ]
    if not solution.converged:
        found.append(
            Callout("The fit has not converged; raise the number of starts or look at the curves.")
        )
    if solution.runs > 1 and solution.agreeing < 2:
        found.append(
            Callout(
                f"Only one of {solution.runs} runs ended at this minimum; with more starts a lower "
                "one may be found."
            )
        )
    if solution.misfit > POOR:
        found.append(
            Callout(
                f"The residuals are {number(solution.misfit, 2)} times the stated deviations. "
                "Where the model does not explain the curves its parameters depend on which "
                "amplitudes were measured."
            )
        )
    return found


def parameter_row(p: Parameter, solution: FitSolution) -> tuple[str, ...]:
    """Name, value, deviation, unit, prior and meaning of a parameter."""
    value, deviation = with_deviation(p.value, solution.std[p.name])
    if p.fixed:
        deviation = "fixed"
    elif p.name in solution.active_bounds:
        deviation = "on its bound"
    elif not solution.determined[p.name]:
        value, deviation = number(p.value), "not determined"
    prior = "–" if p.fixed else prior_range(p.prior)
    return p.name, value, deviation, p.unit, prior, p.meaning


def _errors(solution: FitSolution) -> tuple[float, float]:
    """Root mean square of frequency errors in Hz, of damping errors relative to the measured."""
    f, zeta = [], []
    for measured, predicted in zip(solution.measured, solution.predicted, strict=True):
        difference = np.asarray(predicted.frequency) - np.asarray(measured.frequency)
        if solution.problem.reference == "shift":
            difference = difference - offset(measured, predicted.frequency)
        f.append(difference)
        zeta.append(np.asarray(predicted.damping) / np.asarray(measured.damping) - 1.0)
    return _rms(np.concatenate(f)), _rms(np.concatenate(zeta))


def _rms(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan


def length_unit(curves: ModalCurves) -> str:
    """Unit of displacement behind that of an amplitude, for instance m for m/s; may be empty."""
    endings = {"velocity": ("/s",), "acceleration": ("/s^2", "/s²")}
    for ending in endings.get(curves.quantity, ("",)):
        if curves.unit.endswith(ending):
            return curves.unit.removesuffix(ending)
    return ""
