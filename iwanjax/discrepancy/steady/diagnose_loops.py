"""Is anything missing from one joint, by loops of it."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.steady.runs import LoopRun
from iwanjax.discrepancy.steady.trials import (
    Trials,
    channel_kinds,
    forces_of,
    kinds_named,
    late_laws,
)
from iwanjax.discrepancy.steady.verdict import concluded
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Parameter, drawn, replaced
from iwanjax.identification.steady.fit import best_of
from iwanjax.identification.steady.loops import (
    LoopFit,
    loops_alone,
    loops_beside,
    loops_by_channel,
    loops_from_within,
    loops_with_joint,
    loops_with_law,
)
from iwanjax.joints import AbstractJoint
from iwanjax.settings.stages import settings
from iwanjax.signals.force_loop import ForceLoop, common_channels
from iwanjax.signals.loop_histories import driven, noise_of
from iwanjax.types import require_double_precision
from iwanjax.updating.joint_groups import joint_parameters


def diagnose_loops(
    joint: AbstractJoint,
    recordings: ForceLoop | Sequence[ForceLoop],
    hold_out: ForceLoop | Sequence[ForceLoop] = (),
    parameters: Mapping[str, Parameter] | None = None,
    *,
    name: str = "joint",
    hypotheses: tuple[str, ...] = (),
    noise: float | None = None,
    starts: int = 32,
    seed: int = 0,
    budget: float = math.inf,
    progress: Callable[[str], None] = lambda line: None,
) -> Diagnosis:
    r"""Compare a joint with loops of force against deflection that were run through slowly.

    First the joint alone is fitted along the measured deflections by Masing's rules
    (:func:`iwanjax.hysteresis`), then every force of the catalogue beside it,

    .. math:: F(t) = F_J[d](t) + s\, u[d](t) + F_0,

    with an offset :math:`F_0` of each loop. What loops carry in further channels the joint may
    depend on: its slip force, its stiffness, or its whole force is
    :math:`1 + c\,(u - \bar u)` times what it is at the middle :math:`\bar u` of what a channel u of
    the fitted loops goes through. Loops that begin undeflected begin at rest, or on
    the outermost branch like the others, whichever the joint alone explains better. Then a whole
    joint more is tried and, where all that leaves more than noise, every other law of
    :mod:`iwanjax.joints` with all of its parameters. Where a loop has no time, nothing shows that
    depends on rate, which the verdict says. A force is known as well as it repeats from cycle to
    cycle.

    Evidences are those of a diagnosis by time histories. Errors are root mean squares of predicted
    less measured force over that of the measured one.

    Parameters
    ----------
    joint : joint
        What the model has, at its starting values.
    recordings, hold_out : ForceLoop or sequence of them
        Of this joint, all with the same further channels; only the first are fitted.
    parameters : mapping of str to Parameter, optional
        Replaces those of the joint, ``"joint.F_S"`` and so on, by name.
    name : str
        What the verdict calls the joint.
    hypotheses : tuple of str
        Kinds to try; all of the catalogue by default.
    noise : float, optional
        Standard deviation of the force; by the loops themselves where it is not known.
    starts, seed : int
        Of the searches.
    budget : float
        Time to spend, s.
    progress : function
        Receives a line at every stage.

    Returns
    -------
    Diagnosis
        Its ``runs`` are :class:`LoopRun`.

    Raises
    ------
    InputError
        Without loops, for a joint that depends on rate or does not fit at all, unknown
        parameters or hypotheses, a channel that not all loops have.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("diagnose_loops")
    trials = Trials[LoopFit](budget, progress, name)
    forces = [force for force in forces_of(hypotheses, variants=True) if force.law.tried]
    several, others = (
        (each,) if isinstance(each, ForceLoop) else tuple(each) for each in (recordings, hold_out)
    )
    if not several:
        raise InputError("diagnose_loops: no loops to fit; expected at least one ForceLoop")
    row = replaced(tuple(joint_parameters(name, joint).values()), parameters or {})
    together = (*several, *others)
    channels = common_channels(together)
    deviations = noise_of(together, noise)
    random = np.random.default_rng(seed)
    draws = drawn(row, random, starts)
    trials.say("fitting the joint alone")
    fits = {
        at_rest: loops_alone(joint, row, driven(together, deviations, len(several), at_rest), draws)
        for at_rest in {each.may_begin_at_rest for each in together} | {False}
    }
    more = kinds_named("iwan_joint", hypotheses)
    costs = {at_rest: fit.cost for at_rest, fit in fits.items()}
    at_rest = min(costs, key=costs.__getitem__)
    same = 1.0 + settings().steady.negligible
    if more and len(costs) > 1 and max(costs.values()) <= same * min(costs.values()):
        # A joint without memory cannot tell where a loop begins; one that it lacks may.
        with_it = {
            each: loops_with_joint(fit, more[0], ()).cost
            for each, fit in fits.items()
            if trials.seconds < budget
        }
        at_rest = min(with_it, key=with_it.__getitem__, default=at_rest)
    alone = fits[at_rest]
    if not math.isfinite(alone.cost):
        raise InputError(f"diagnose_loops: {name}: no start gave finite forces")
    trials.fit_forces(forces, lambda force: loops_beside(alone, force, draws, random))
    trials.none_worse(loops_from_within)
    trials.fit(
        more,
        lambda _: "with a joint left out",
        lambda more: loops_with_joint(alone, more, trials.contained(more)),
    )
    loops, constant = alone.problem.loops, []
    for channel in channels:
        middle, half = loops.middle(channel)
        if half <= settings().steady.negligible * abs(middle):
            constant.append(f"{channel} is {middle:.4g} throughout the fitted loops")
            continue
        trials.fit(
            [kind.of(channel, middle) for kind in channel_kinds(hypotheses, joint)],
            lambda kind: f"with {kind.usual}",
            lambda kind: loops_by_channel(alone, kind, draws, random),
        )
    # Not among them: a law without a name, which has no place to be sought at but the joint's own,
    # and static above kinetic friction, whose drops of force leave a search too many minima to end
    # in (of a simulated joint of 0.8 it found 0.79, twice the noise off, beside wrong parameters).
    hidden = trials.fit(
        late_laws(hypotheses, best_of([alone, *trials.found])),
        lambda kind: f"with {kind.name}, all of its parameters free",
        lambda kind: loops_with_law(alone, kind, draws),
    )
    trials.unseen += dict.fromkeys(kind.name for kind in hidden)
    whole = driven(together, deviations, len(several), at_rest, math.inf)

    def run(fit: LoopFit, chosen: LoopFit) -> LoopRun:
        predicted = []
        for forces, loop in zip(fit.predicted(whole), together, strict=True):
            force = forces[2 : loop.d.size + 2]
            predicted.append(force + np.mean(loop.force - force))
        return LoopRun(together, tuple(predicted), len(several), deviations)

    return concluded(
        trials,
        alone,
        name,
        run,
        row,
        warnings=lambda _: [
            *_unseen_by_loops(name, trials.unseen, loops.dt is not None),
            *(f"{told}, so nothing shows whether {name} depends on it" for told in constant),
        ],
    )


def _unseen_by_loops(name: str, unseen: Sequence[str], timed: bool) -> list[str]:
    """What loops say nothing of."""
    if not unseen:
        return []
    told = ", ".join(unseen)
    if timed:
        return [f"Loops cannot show {told} at {name}, which depend on acceleration"]
    return [f"Loops without time cannot show {told} at {name}, which depend on rate"]
