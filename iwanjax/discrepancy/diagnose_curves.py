"""Is anything missing from a mode's joint, by measured frequency and damping against amplitude."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.backbone import CurveFit, fit_alone, fit_beside
from iwanjax.discrepancy.catalogue import ForceKind, kinds_of
from iwanjax.discrepancy.curve_run import CurveRun
from iwanjax.discrepancy.evidence import log_evidence, shares, untried
from iwanjax.discrepancy.observables import Observable
from iwanjax.discrepancy.ranking import LEAST_GAIN
from iwanjax.discrepancy.rounds import INDULGENCE
from iwanjax.discrepancy.suspicion import Estimate
from iwanjax.discrepancy.verdict import Diagnosis, Errors, Suspect, alike
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint, joint_type
from iwanjax.types import require_double_precision
from iwanjax.updating.modal import modal_parameters, modal_problem
from iwanjax.updating.parameters import Parameter, drawn, replaced
from iwanjax.updating.problem import modal_unit

# Evidences closer than this cannot be told apart.
_ALIKE = 3.0
# Deviations from which on a level's difference is clear, and share of the levels that have to be.
_CLEAR, _ENOUGH = 3.0, 0.05
# Error over the noise's from which on something is left unexplained.
_UNEXPLAINED = 1.25


class _Entry(NamedTuple):
    fit: CurveFit
    value: float


def diagnose_curves(
    joint: type[AbstractJoint] | str,
    curves: ModalCurves | Sequence[ModalCurves],
    held_out: ModalCurves | Sequence[ModalCurves] = (),
    parameters: Mapping[str, Parameter] | None = None,
    *,
    name: str = "mode",
    mode: int = 0,
    hypotheses: tuple[str, ...] = (),
    starts: int = 64,
    seed: int = 0,
    budget: float = math.inf,
    progress: Callable[[str], None] = lambda line: None,
) -> Diagnosis:
    r"""Compare one mode's joint with measured frequency and damping against amplitude.

    First the oscillator with its joint alone is fitted (:func:`iwanjax.fit`). Then every force
    of the catalogue acts beside the joint, by its first harmonic and its loss over a steady
    cycle, and everything is fitted again. What changes stiffness or damping alike at every
    amplitude (a spring, a mass, a dashpot, a Maxwell element) is part of the mode's own f_0
    and zeta_0, and a force without a first harmonic (a quadratic spring) does not show: of
    these curves say nothing, which the verdict states.

    Evidences are those of :func:`iwanjax.diagnose`, of levels whose residuals may be
    correlated along a curve. Errors are root mean squares of predicted less measured
    frequency, over its fall below the highest, and damping, over itself.

    Parameters
    ----------
    joint : str or joint class
        What the model has, for instance ``"iwan4"``.
    curves, held_out : ModalCurves or sequence of them
        Of one mode, with deviations, against one quantity; only the first are fitted.
    parameters : mapping of str to Parameter, optional
        Replaces those of :func:`iwanjax.modal_parameters` by name.
    name, mode : str, int
        What the verdict calls the mode, and its index.
    hypotheses : tuple of str
        Kinds to try; all of the catalogue by default.
    starts, seed : int
        Of the searches.
    budget : float
        Time to spend, s.
    progress : function
        Told of every stage.

    Returns
    -------
    Diagnosis
        Its ``runs`` are :class:`CurveRun`.

    Raises
    ------
    InputError
        For curves that cannot be fitted, unknown parameters or hypotheses.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("diagnose_curves")
    started = time.perf_counter()
    # A one-sided variant has the two-sided one's curves at half the size.
    forces = [
        each for each in kinds_of(hypotheses) if isinstance(each, ForceKind) and not each.variant
    ]
    kind = joint_type(joint) if isinstance(joint, str) else joint
    several, others = (
        (each,) if isinstance(each, ModalCurves) else tuple(each) for each in (curves, held_out)
    )
    if not several:
        raise InputError("diagnose_curves: no curves to fit; expected at least one ModalCurves")
    if len({each.quantity for each in (*several, *others)}) > 1:
        raise InputError("diagnose_curves: the curves are against different quantities")
    row = replaced(tuple(modal_parameters(kind, several).values()), parameters or {})
    base = modal_problem(kind, several, row, "absolute")
    random = np.random.default_rng(seed)
    draws = base.spread(drawn(row, random, starts))
    progress(f"{name}: fitting the joint alone")
    alone = fit_alone(base, draws)
    if not math.isfinite(alone.cost):
        raise InputError(f"diagnose_curves: {name}: no start gave finite residuals")
    found, unseen, complete = [], [], True
    for force in forces:
        complete = complete and time.perf_counter() - started < budget
        if complete:
            progress(f"{name}: with {force.name}")
            fit = fit_beside(alone, force, draws, random)
            if fit is None:
                unseen.append(force.name)
            elif math.isfinite(fit.cost):
                found.append(fit)
    # Beside what can be there: a law of the joint's that is of another shape.
    active = [fit for fit in found if fit.gives_energy]
    entries = _placed(alone, [fit for fit in found if fit not in active])
    best = entries[0]
    gain = best.value - next(each.value for each in entries if each.fit is alone)
    detected = gain > LEAST_GAIN
    chosen = best.fit if detected else alone
    before, after = (_run(fit, several, others) for fit in (alone, chosen))
    errors = [_errors(run, run.by_recording()) for run in (before, after)]
    floor = _errors(after, after.floors())
    unknown = untried(errors[1].fit / floor.fit)
    odds = [each.value + LEAST_GAIN * (each.fit is alone) for each in entries]
    probabilities = shares(np.array(odds)) * (1.0 - unknown)
    what = (
        [
            Suspect(
                each.fit.force.kind,
                name,
                float(probability),
                each.value - best.value,
                _estimates(each.fit, several[0]),
            )
            for each, probability in zip(entries, probabilities, strict=True)
            if each.fit.force is not None
        ]
        if detected
        else []
    )
    nothing = next(i for i, each in enumerate(entries) if each.fit is alone)
    return Diagnosis(
        detected=detected,
        probability_nothing_missing=float(probabilities[nothing]),
        probability_something_else=unknown,
        what=tuple(what),
        before=errors[0],
        after=errors[1],
        noise_floor=floor,
        noise_floor_95=Errors(math.nan, math.nan),
        parameter_spread=Errors(math.nan, math.nan),
        indistinguishable=alike(what, _ALIKE) if what else (),
        observables=_observables(before, mode) if detected else (),
        scores=(),
        runs=(before, after),
        sampling_rate=math.nan,
        restoring=None,
        warnings=(
            *_active(active, chosen),
            *_warnings(name, errors, floor, unknown, detected, unseen),
        ),
        complete=complete,
        seconds=time.perf_counter() - started,
    )


def _placed(alone: CurveFit, found: Sequence[CurveFit]) -> list[_Entry]:
    """By evidence, the best of every kind only."""
    best: dict[str, CurveFit] = {}
    for fit in found:
        assert fit.force is not None
        known = best.setdefault(fit.force.kind.name, fit)
        if fit.cost < known.cost:
            best[fit.force.kind.name] = fit
    fits = [alone, *best.values()]
    first = min(fits, key=lambda each: each.cost)
    count = 2 * alone.problem.measured.q.size
    # No curve is trusted to be better known than its deviations say.
    temperature, tau = max(1.0, first.cost / count), first.correlation()
    values = log_evidence(
        [fit.cost for fit in fits], [fit.unknowns for fit in fits], count, temperature, tau
    )
    values[0] += INDULGENCE * alone.cost / (2.0 * temperature * tau)
    entries = [_Entry(fit, float(value)) for fit, value in zip(fits, values, strict=True)]
    return sorted(entries, key=lambda each: -each.value)


def _run(fit: CurveFit, several: Sequence[ModalCurves], others: Sequence[ModalCurves]) -> CurveRun:
    measured = (*several, *others)
    f, zeta = (
        np.concatenate([np.asarray(getattr(each, name)) for each in several])
        for name in ("frequency", "damping")
    )
    rest = float(f.max())
    scales = (float(np.sqrt(np.mean((f - rest) ** 2))), float(np.sqrt(np.mean(zeta**2))))
    predicted = tuple(fit.predicted(each) for each in measured)
    return CurveRun(measured, predicted, len(several), rest, scales)


def _errors(run: CurveRun, by_recording: Mapping[str, float]) -> Errors:
    """Root mean square over those that were fitted, and over the others."""
    square = np.square(list(by_recording.values()))
    parts = (square[: run.fitted], square[run.fitted :])
    return Errors(*(math.sqrt(float(x.mean())) if x.size else math.nan for x in parts))


def _estimates(fit: CurveFit, curves: ModalCurves) -> tuple[Estimate, ...]:
    """Size and shape of the force, per unit modal mass."""
    assert fit.force is not None
    kind, shape = fit.force
    std, std_shape = fit.deviations()

    def told(info, value: float, deviation: float) -> Estimate:
        unit = replace(info, dimension=modal_unit(info.dimension, curves))
        return Estimate(unit, value, deviation)

    size = told(kind.size, float(fit.theta[-1]), std)
    if kind.shape is None:
        return (size,)
    return size, told(kind.shape, shape, shape * std_shape)


def _observables(run: CurveRun, mode: int) -> tuple[Observable, ...]:
    """Where the model is clearly off, the largest difference first."""
    found = []
    for name, model, seen in zip(run.names, run.predicted, run.measured, strict=True):
        x = np.asarray(seen.amplitude)
        for quantity in ("frequency", "damping"):
            y, std = (np.asarray(getattr(seen, quantity + end)) for end in ("", "_std"))
            off = np.asarray(getattr(model, quantity)) - y
            clear = np.abs(off) > _CLEAR * std
            if clear.mean() > _ENOUGH:
                span = (float(x[clear].min()), float(x[clear].max()))
                percent = 100.0 * float(np.median(off[clear] / y[clear]))
                found.append(Observable(name, mode, quantity, span, percent))
    return tuple(sorted(found, key=lambda each: -abs(each.difference_percent)))


def _active(active: Sequence[CurveFit], chosen: CurveFit) -> list[str]:
    """What explains more than the verdict, but cannot be."""
    told = []
    for fit in active:
        assert fit.force is not None
        if fit.cost < (1.0 - INDULGENCE) * chosen.cost:
            told.append(
                f"A {fit.force.kind.name} of negative size would explain more, but gives energy to "
                "the mode: the joint's own damping changes with amplitude in another way than its "
                "law can"
            )
    return told


def _warnings(
    name: str,
    errors: Sequence[Errors],
    floor: Errors,
    unknown: float,
    detected: bool,
    unseen: Sequence[str],
) -> list[str]:
    """What to think of the verdict."""
    told = []
    if math.isnan(errors[0].hold_out):
        told.append("No recording was held out, so nothing shows that the verdict holds")
    elif detected and errors[1].hold_out >= errors[0].hold_out:
        told.append(
            "What was added does not predict the held-out recordings better: take it as a hint"
        )
    ratio = errors[1].fit / floor.fit
    if ratio > _UNEXPLAINED:
        rest = "also with it" if detected else "and nothing that was tried explains it"
        told.append(
            f"The fitted curves are {ratio:.2g} times their deviations off, {rest} (probability "
            f"{unknown:.2f} that something else is missing)"
        )
    if unseen:
        told.append(
            f"Curves of one mode cannot show {', '.join(dict.fromkeys(unseen))}: {name} has them "
            "in its f_0 and zeta_0, or they have no first harmonic"
        )
    return told
