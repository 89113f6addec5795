"""Is anything missing from one joint: by curves of the mode that it is in, or by loops of it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.steady.repeatability import (
    Disagreement,
    deviating_by_both,
    disagreements,
    offset_by,
)
from iwanjax.discrepancy.steady.runs import CurveRun, clear_differences
from iwanjax.discrepancy.steady.trials import Trials, forces_of, kinds_named
from iwanjax.discrepancy.steady.verdict import concluded
from iwanjax.effects.estimate import Estimate
from iwanjax.errors import InputError
from iwanjax.estimation.evidence import MODEL_ERROR_ALLOWANCE
from iwanjax.estimation.parameters import Parameter, drawn, replaced
from iwanjax.identification.steady.curves import (
    ModeFit,
    fit_alone,
    fit_beside,
    fit_coupled,
    fit_with_joint,
    gives_energy,
)
from iwanjax.identification.steady.cycle import InteractingMode
from iwanjax.identification.steady.extrapolation import spread, without_needless_macroslip
from iwanjax.identification.steady.joint_and_force import elastic_neighbours, fit_with_both
from iwanjax.joints import AbstractJoint, joint_type
from iwanjax.joints.iwan import AbstractIwan
from iwanjax.settings.stages import settings
from iwanjax.types import require_double_precision
from iwanjax.updating.modal import modal_parameters, modal_problem
from iwanjax.updating.problem import modal_unit


def diagnose_curves(
    joint: type[AbstractJoint] | str,
    recordings: ModalCurves | Sequence[ModalCurves],
    hold_out: ModalCurves | Sequence[ModalCurves] = (),
    parameters: Mapping[str, Parameter] | None = None,
    *,
    name: str = "mode",
    mode: int = 0,
    interacting_modes: Sequence[InteractingMode] = (),
    estimator_curves: Sequence[ModalCurves] = (),
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

    Evidences are those of a diagnosis by time histories, of levels whose residuals may be
    correlated along a curve. To the curves' deviations half a per cent of the frequency's fall
    and of the damping is added: so much a mode of a structure differs from an oscillator with a
    joint, and less is not held against the joint. Errors are root mean squares of predicted
    less measured frequency, over its fall below the highest, and damping, over itself; the
    noise floor is of the deviations alone.

    Parameters
    ----------
    joint : str or joint class
        What the model has, for instance ``"iwan4"``.
    recordings, hold_out : ModalCurves or sequence of them
        Of one mode, with deviations, against one quantity; only the first are fitted.
    parameters : mapping of str to Parameter, optional
        Replaces those of :func:`iwanjax.modal_parameters` by name.
    name, mode : str, int
        What the verdict calls the mode, and its index.
    interacting_modes : sequence of InteractingMode
        Other modes that moved at the same time, and perhaps the same joint.
    estimator_curves : sequence of ModalCurves
        All curves again, those held out last, with the estimator's deviations alone: where those
        of ``recordings`` hold the hits' repeatability, which another mode may explain.
    hypotheses : tuple of str
        Kinds to try; all of the catalogue by default.
    starts, seed : int
        Of the searches.
    budget : float
        Time to spend, s.
    progress : function
        Receives a line at every stage.

    Returns
    -------
    Diagnosis
        Its ``runs`` are :class:`CurveRun`.

    Raises
    ------
    InputError
        For curves that cannot be fitted, interacting modes of other levels, unknown parameters or
        hypotheses.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("diagnose_curves")
    trials = Trials[ModeFit](budget, progress, name)
    forces = forces_of(hypotheses, variants=False)
    kind = joint_type(joint) if isinstance(joint, str) else joint
    several, others = (
        (each,) if isinstance(each, ModalCurves) else tuple(each) for each in (recordings, hold_out)
    )
    if not several:
        raise InputError("diagnose_curves: no curves to fit; expected at least one ModalCurves")
    if len({each.quantity for each in (*several, *others)}) > 1:
        raise InputError("diagnose_curves: the curves are against different quantities")
    _check_levels((*several, *others), interacting_modes, estimator_curves)
    highest = max(float(np.max(each.frequency)) for each in several)
    doubted, others_doubted, estimator_doubted = (
        tuple(_doubted(each, highest) for each in given)
        for given in (several, others, estimator_curves)
    )
    row = replaced(tuple(modal_parameters(kind, several).values()), parameters or {})
    base = modal_problem(kind, doubted, row, "absolute")
    random = np.random.default_rng(seed)
    draws = base.spread(drawn(row, random, starts))
    trials.say("fitting the joint alone")
    alone = fit_alone(base, draws)
    if not math.isfinite(alone.cost):
        raise InputError(f"diagnose_curves: {name}: no start gave finite residuals")
    trials.fit_forces(forces, lambda force: fit_beside(alone, force, draws, random))
    # Beside what can be there: a law of the joint's that is of another shape.
    active = [fit for fit in trials.found if gives_energy(fit)]
    trials.found = [fit for fit in trials.found if fit not in active]
    trials.fit(
        kinds_named("iwan_joint", hypotheses),
        lambda _: "with a joint left out",
        lambda more: fit_with_joint(alone, more, doubted, trials.contained(more), random),
    )
    by_itself = base
    if estimator_curves:
        by_itself = modal_problem(kind, estimator_doubted[: len(several)], row, "absolute")
    if not issubclass(kind, AbstractIwan) and (joined := trials.joined):
        # A law without microslip has none to harden beside.
        trials.fit(
            elastic_neighbours(trials.found, alone.count - joined.unknowns),
            lambda force: f"with a joint left out and {force.kind.name}",
            lambda force: fit_with_both(joined, force.kind, force.size, random),
        )
    alone, *trials.found = map(without_needless_macroslip, (alone, *trials.found))
    coupled = kinds_named("modal_coupling", hypotheses)
    trials.fit(
        interacting_modes if coupled else (),
        lambda other: f"with {other.name} on the same joint",
        lambda other: fit_coupled(base, by_itself, alone.theta[:-1], draws, coupled[0], other),
    )

    def against(fit: ModeFit) -> tuple[tuple[ModalCurves, ...], tuple[ModalCurves, ...]]:
        """Curves, and with the oscillator's own error, that a fit is held against."""
        # What another mode explains is no scatter of the hits any more.
        if estimator_curves and fit.effect is not None and fit.effect.kind in coupled:
            return tuple(estimator_curves), estimator_doubted
        return (*several, *others), (*doubted, *others_doubted)

    def run(fit: ModeFit, chosen: ModeFit) -> CurveRun:
        measured, _ = against(chosen)
        return CurveRun.of(measured, fit.predicted(measured), len(several))

    def opened(fit: ModeFit) -> tuple[ModalCurves, ...]:
        """By how much predictions move within what the fitted levels leave open."""
        return spread(fit, (*several, *others))

    def apart(fit: ModeFit) -> dict[int, Disagreement]:
        """Curves that no law of amplitude explains together with those that were fitted."""
        # Another mode makes hits differ at equal amplitude; that is tried as a hypothesis.
        if interacting_modes:
            return {}
        _, known = against(fit)
        together = tuple(map(deviating_by_both, known, opened(fit)))
        return disagreements(CurveRun.of(known, fit.predicted(known), len(several)), together)

    def foreseen(fit: ModeFit, after: CurveRun) -> Mapping[str, float]:
        """Errors of a right model that is not told how the recordings differ."""
        known, found = list(against(fit)[1]), apart(fit)
        for i, each in found.items():
            known[i] = offset_by(known[i], each)
        return CurveRun.of(tuple(known), after.predicted, len(several)).floors()

    return concluded(
        trials,
        alone,
        name,
        run,
        row,
        estimates=lambda fit: _per_modal_mass(fit.estimates(), several[0]),
        expected=foreseen,
        spread=lambda fit: CurveRun.of((*several, *others), opened(fit), len(several)).deviations(),
        observables=lambda before: clear_differences(before, mode, name),
        warnings=lambda fit: (
            *map(str, apart(fit).values()),
            *_sticking(fit, name),
            *_active(active, fit),
            *_unseen_by_curves(name, trials.unseen),
        ),
    )


def _doubted(curves: ModalCurves, highest: float) -> ModalCurves:
    """Curves with what an oscillator may be off by in their deviations."""
    if curves.frequency_std is None or curves.damping_std is None:
        return curves
    share = settings().steady.model_error
    f_std = jnp.hypot(curves.frequency_std, share * (highest - curves.frequency))
    zeta_std = jnp.hypot(curves.damping_std, share * curves.damping)
    return eqx.tree_at(lambda c: (c.frequency_std, c.damping_std), curves, (f_std, zeta_std))


def _check_levels(
    measured: Sequence[ModalCurves],
    interacting_modes: Sequence[InteractingMode],
    estimator_curves: Sequence[ModalCurves],
) -> None:
    """Refuse what does not go level by level with the curves."""
    levels = [each.amplitude.size for each in measured]
    given = {
        f"interacting mode {each.name}": [len(x) for x in each.amplitude]
        for each in interacting_modes
    }
    if estimator_curves:
        given["estimator_curves"] = [each.amplitude.size for each in estimator_curves]
    for what, sizes in given.items():
        if sizes != levels:
            raise InputError(
                f"diagnose_curves: {what} has {sizes} levels; expected {levels}, as the curves "
                "have, those held out last"
            )


def _per_modal_mass(estimates: Sequence[Estimate], curves: ModalCurves) -> tuple[Estimate, ...]:
    """Estimates with the units that the curves' own unit implies."""
    return tuple(
        each._replace(info=replace(each.info, dimension=modal_unit(each.info.dimension, curves)))
        for each in estimates
    )


def _sticking(fit: ModeFit, name: str) -> list[str]:
    """What levels below macroslip leave open of a joint."""
    if not fit.idle:
        return []
    return [
        f"The fitted levels do not show that {name} comes to macroslip: F_S and beta are not "
        "known, and beyond these levels microslip is taken to go on"
    ]


def _active(active: Sequence[ModeFit], chosen: ModeFit) -> list[str]:
    """What explains more than the verdict, but cannot be."""
    warnings = []
    for fit in active:
        assert fit.effect is not None
        if fit.cost < (1.0 - MODEL_ERROR_ALLOWANCE) * chosen.cost:
            warnings.append(
                f"A {fit.effect.kind.name} of negative size would explain more, but gives energy "
                "to the mode: the joint's own damping changes with amplitude in another way than "
                "its law can"
            )
    return warnings


def _unseen_by_curves(name: str, unseen: Sequence[str]) -> list[str]:
    """What curves say nothing of."""
    if not unseen:
        return []
    return [
        f"Curves of one mode cannot show {', '.join(unseen)}: {name} has them "
        "in its f_0 and zeta_0, or they have no first harmonic"
    ]
