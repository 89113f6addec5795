"""Is anything missing from a mode's joint, by measured frequency and damping against amplitude."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.effects import ForceKind, ModeKind, kinds_of
from iwanjax.discrepancy.estimate import Estimate
from iwanjax.discrepancy.evidence import MODEL_ERROR_ALLOWANCE
from iwanjax.discrepancy.steady.concluding import concluded, parameters_refitted
from iwanjax.discrepancy.steady.curve_run import CurveRun
from iwanjax.discrepancy.steady.curves import CurveFit, fit_alone, fit_beside
from iwanjax.discrepancy.steady.curves_with_joint import JointFit, fit_with_joint
from iwanjax.discrepancy.steady.differences import clear_differences
from iwanjax.discrepancy.steady.interacting_modes import CoupledFit, InteractingMode, fit_coupled
from iwanjax.discrepancy.steady.left_out import joint_estimates, joint_kind
from iwanjax.discrepancy.steady.one_joint import Ranking, estimates_of, tried
from iwanjax.discrepancy.steady.starts import slopes
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint, joint_type
from iwanjax.types import require_double_precision
from iwanjax.updating.modal import modal_parameters, modal_problem
from iwanjax.updating.parameters import Parameter, drawn, replaced
from iwanjax.updating.problem import modal_unit

# Share of a mode's fall of frequency, and of its damping, by which an oscillator with one Iwan
# joint is off the mode of a structure with one: the joint works against the other modes'
# flexibility, and the shape changes. Quasi-statics of chains and a lapped beam say 0.1 to 0.7 %.
_MODEL_ERROR = 0.005


def diagnose_curves(
    joint: type[AbstractJoint] | str,
    curves: ModalCurves | Sequence[ModalCurves],
    held_out: ModalCurves | Sequence[ModalCurves] = (),
    parameters: Mapping[str, Parameter] | None = None,
    *,
    name: str = "mode",
    mode: int = 0,
    interacting_modes: Sequence[InteractingMode] = (),
    own: Sequence[ModalCurves] = (),
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
    these curves say nothing, which the verdict states. Then a whole joint more is tried: a mode
    that was taken for linear may have one. Where other modes moved at the same time
    the joint may be theirs too: then what they do to it differs from hit to hit.

    Evidences are those of :func:`iwanjax.diagnose`, of levels whose residuals may be
    correlated along a curve. To the curves' deviations half a per cent of the frequency's fall
    and of the damping is added: so much a mode of a structure differs from an oscillator with a
    joint, and less is not held against the joint. Errors are root mean squares of predicted
    less measured frequency, over its fall below the highest, and damping, over itself; the
    noise floor is of the deviations alone.

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
    companions : sequence of InteractingMode
        Other modes that moved at the same time, and perhaps the same joint.
    own : sequence of ModalCurves
        All curves again, those held out last, with the estimator's deviations alone: where those
        of ``curves`` hold the hits' repeatability, which another mode may explain.
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
        For curves that cannot be fitted, companions of other levels, unknown parameters or
        hypotheses.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("diagnose_curves")
    started = time.perf_counter()
    # A one-sided variant has the two-sided one's curves at half the size.
    forces = [
        each for each in kinds_of(hypotheses) if isinstance(each, ForceKind) and not each.variant
    ]
    modal = [each for each in kinds_of(hypotheses) if isinstance(each, ModeKind)]
    kind = joint_type(joint) if isinstance(joint, str) else joint
    several, others = (
        (each,) if isinstance(each, ModalCurves) else tuple(each) for each in (curves, held_out)
    )
    if not several:
        raise InputError("diagnose_curves: no curves to fit; expected at least one ModalCurves")
    if len({each.quantity for each in (*several, *others)}) > 1:
        raise InputError("diagnose_curves: the curves are against different quantities")
    _check_levels((*several, *others), interacting_modes, own)
    highest = max(float(np.max(each.frequency)) for each in several)
    doubted, others_doubted, own_doubted = (
        tuple(_doubted(each, highest) for each in given) for given in (several, others, own)
    )
    row = replaced(tuple(modal_parameters(kind, several).values()), parameters or {})
    base = modal_problem(kind, doubted, row, "absolute")
    random = np.random.default_rng(seed)
    draws = base.spread(drawn(row, random, starts))
    progress(f"{name}: fitting the joint alone")
    alone = fit_alone(base, draws)
    if not math.isfinite(alone.cost):
        raise InputError(f"diagnose_curves: {name}: no start gave finite residuals")
    found, unseen, complete = tried(
        forces,
        lambda force: fit_beside(alone, force, draws, random),
        lambda: time.perf_counter() - started < budget,
        lambda line: progress(f"{name}: {line}"),
    )
    together: list[CoupledFit] = []
    by_itself = modal_problem(kind, own_doubted[: len(several)], row, "absolute") if own else base
    # Beside what can be there: a law of the joint's that is of another shape.
    active = [fit for fit in found if fit.gives_energy]
    for other in interacting_modes if modal else ():
        if time.perf_counter() - started >= budget:
            complete = False
            break
        progress(f"{name}: with {other.name} on the same joint")
        fit = fit_coupled(base, by_itself, alone.theta[:-1], draws, modal[0], other)
        if fit is not None and math.isfinite(fit.cost):
            together.append(fit)
    passive: list[CurveFit | CoupledFit | JointFit] = [fit for fit in found if fit not in active]
    more = joint_kind(hypotheses)
    if more is not None and time.perf_counter() - started < budget:
        progress(f"{name}: with a joint left out")
        fit = fit_with_joint(alone, more, doubted, found, random)
        passive += [fit] if math.isfinite(fit.cost) else []
    elif more is not None:
        complete = False
    standing = Ranking[CurveFit | CoupledFit | JointFit].of(alone, [*passive, *together])

    def seen(
        fit: CurveFit | CoupledFit | JointFit,
    ) -> tuple[tuple[ModalCurves, ...], tuple[ModalCurves, ...]]:
        """Curves, and with the oscillator's own error, that a fit is held against."""
        # What another mode explains is no scatter of the hits any more.
        if isinstance(fit, CoupledFit) and own:
            return tuple(own), own_doubted
        return (*several, *others), (*doubted, *others_doubted)

    return concluded(
        standing,
        name,
        lambda fit: (
            _run(alone, seen(fit)[0], len(several)),
            _run(fit, seen(fit)[0], len(several)),
        ),
        len(several),
        lambda fit: _estimates(fit, several[0]),
        expected=lambda fit, run: CurveRun.of(seen(fit)[1], run.predicted, len(several)).floors(),
        observables=lambda before: clear_differences(before, mode, name),
        joints=lambda fit: parameters_refitted(
            fit, np.asarray(slopes(fit.problem, jnp.asarray(fit.theta))), row, name
        ),
        warnings=lambda fit: (*_active(active, fit), *_unseen(name, unseen)),
        complete=complete,
        seconds=time.perf_counter() - started,
    )


def _doubted(curves: ModalCurves, highest: float) -> ModalCurves:
    """Curves with what an oscillator may be off by in their deviations."""
    if curves.frequency_std is None or curves.damping_std is None:
        return curves
    f_std = jnp.hypot(curves.frequency_std, _MODEL_ERROR * (highest - curves.frequency))
    zeta_std = jnp.hypot(curves.damping_std, _MODEL_ERROR * curves.damping)
    return eqx.tree_at(lambda c: (c.frequency_std, c.damping_std), curves, (f_std, zeta_std))


def _check_levels(
    measured: Sequence[ModalCurves],
    interacting_modes: Sequence[InteractingMode],
    own: Sequence[ModalCurves],
) -> None:
    """Refuse what does not go level by level with the curves."""
    levels = [each.amplitude.size for each in measured]
    given = {
        f"companion {each.name}": [len(x) for x in each.amplitude] for each in interacting_modes
    }
    if own:
        given["own"] = [each.amplitude.size for each in own]
    for what, sizes in given.items():
        if sizes != levels:
            raise InputError(
                f"diagnose_curves: {what} has {sizes} levels; expected {levels}, as the curves "
                "have, those held out last"
            )


def _run(
    fit: CurveFit | CoupledFit | JointFit, measured: tuple[ModalCurves, ...], fitted: int
) -> CurveRun:
    predicted = tuple(fit.predicted(each, i) for i, each in enumerate(measured))
    return CurveRun.of(measured, predicted, fitted)


def _estimates(fit: CurveFit | CoupledFit | JointFit, curves: ModalCurves) -> tuple[Estimate, ...]:
    """Size and shape of the force, per unit modal mass."""

    def told(each: Estimate) -> Estimate:
        unit = modal_unit(each.info.dimension, curves)
        return each._replace(info=replace(each.info, dimension=unit))

    found = joint_estimates(fit) if isinstance(fit, JointFit) else estimates_of(fit)
    return tuple(map(told, found))


def _active(active: Sequence[CurveFit], chosen: CurveFit | CoupledFit | JointFit) -> list[str]:
    """What explains more than the verdict, but cannot be."""
    told = []
    for fit in active:
        assert fit.force is not None
        if fit.cost < (1.0 - MODEL_ERROR_ALLOWANCE) * chosen.cost:
            told.append(
                f"A {fit.force.kind.name} of negative size would explain more, but gives energy to "
                "the mode: the joint's own damping changes with amplitude in another way than its "
                "law can"
            )
    return told


def _unseen(name: str, unseen: Sequence[str]) -> list[str]:
    """What curves say nothing of."""
    if not unseen:
        return []
    return [
        f"Curves of one mode cannot show {', '.join(unseen)}: {name} has them "
        "in its f_0 and zeta_0, or they have no first harmonic"
    ]
