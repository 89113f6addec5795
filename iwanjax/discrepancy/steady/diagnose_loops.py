"""Is anything missing from a joint, by loops of force against deflection of it on its own."""

import math
import time
from collections.abc import Callable, Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.effects import ForceKind, kinds_of
from iwanjax.discrepancy.steady.concluding import concluded, parameters_refitted
from iwanjax.discrepancy.steady.left_out import joint_estimates, joint_kind
from iwanjax.discrepancy.steady.loop_run import LoopRun
from iwanjax.discrepancy.steady.loops import (
    LoopFit,
    LoopHistories,
    driven,
    loops_alone,
    loops_beside,
    noise_of,
)
from iwanjax.discrepancy.steady.loops_with_joint import TwoJointsFit, loops_with_joint
from iwanjax.discrepancy.steady.one_joint import Ranking, estimates_of, tried
from iwanjax.discrepancy.steady.starts import slopes
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.signals.force_loop import ForceLoop
from iwanjax.types import require_double_precision
from iwanjax.updating.parameters import Parameter, drawn, replaced
from iwanjax.updating.structural import joint_parameters

# Relative difference of costs that is rounding.
_SAME = 1e-6


def diagnose_loops(
    joint: AbstractJoint,
    loops: ForceLoop | Sequence[ForceLoop],
    held_out: ForceLoop | Sequence[ForceLoop] = (),
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

    with an offset :math:`F_0` of each loop. Loops that begin undeflected begin at rest, or on
    the outermost branch like the others, whichever the joint alone explains better. Then a whole
    joint more is tried. Without
    time nothing shows that depends on rate, which the verdict says.

    Evidences are those of :func:`iwanjax.diagnose`. Errors are root mean squares of predicted
    less measured force over that of the measured one.

    Parameters
    ----------
    joint : joint
        What the model has, at its starting values.
    loops, held_out : ForceLoop or sequence of them
        Of this joint; only the first are fitted.
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
        Told of every stage.

    Returns
    -------
    Diagnosis
        Its ``runs`` are :class:`LoopRun`.

    Raises
    ------
    InputError
        Without loops, for a joint that depends on rate or does not fit at all, unknown
        parameters or hypotheses.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("diagnose_loops")
    started = time.perf_counter()
    forces = [each for each in kinds_of(hypotheses) if isinstance(each, ForceKind)]
    several, others = (
        (each,) if isinstance(each, ForceLoop) else tuple(each) for each in (loops, held_out)
    )
    if not several:
        raise InputError("diagnose_loops: no loops to fit; expected at least one ForceLoop")
    row = replaced(tuple(joint_parameters(name, joint).values()), parameters or {})
    together = (*several, *others)
    deviations = noise_of(together, noise)
    random = np.random.default_rng(seed)
    draws = drawn(row, random, starts)
    progress(f"{name}: fitting the joint alone")
    found_by = {
        at_rest: loops_alone(joint, row, driven(together, deviations, len(several), at_rest), draws)
        for at_rest in {each.may_begin_at_rest for each in together} | {False}
    }
    more = joint_kind(hypotheses)
    at_rest = min(found_by, key=lambda each: found_by[each].cost)
    if more is not None and _alike(found_by):
        # A joint without memory cannot tell where a loop begins; one that it lacks may.
        with_it = {
            each: loops_with_joint(fit, more, ()).cost
            for each, fit in found_by.items()
            if time.perf_counter() - started < budget
        }
        at_rest = min(with_it, key=with_it.__getitem__, default=at_rest)
    alone = found_by[at_rest]
    if not math.isfinite(alone.cost):
        raise InputError(f"diagnose_loops: {name}: no start gave finite forces")
    found, unseen, complete = tried(
        forces,
        lambda force: loops_beside(alone, force, draws, random),
        lambda: time.perf_counter() - started < budget,
        lambda line: progress(f"{name}: {line}"),
    )
    tried_all: list[LoopFit | TwoJointsFit] = list(found)
    if more is not None and time.perf_counter() - started < budget:
        progress(f"{name}: with a joint left out")
        fit = loops_with_joint(alone, more, found)
        tried_all += [fit] if math.isfinite(fit.cost) else []
    elif more is not None:
        complete = False
    standing = Ranking[LoopFit | TwoJointsFit].of(alone, tried_all)
    whole = driven(together, deviations, len(several), at_rest, math.inf)

    def run(fit: LoopFit | TwoJointsFit) -> LoopRun:
        return LoopRun(together, _along(fit, whole, together), len(several), deviations)

    before = run(alone)
    return concluded(
        standing,
        name,
        lambda fit: (before, run(fit)),
        len(several),
        lambda fit: joint_estimates(fit) if isinstance(fit, TwoJointsFit) else estimates_of(fit),
        joints=lambda fit: parameters_refitted(
            fit, np.asarray(slopes(fit.problem, jnp.asarray(fit.theta))), row, name
        ),
        warnings=lambda _: _unseen(name, unseen),
        complete=complete,
        seconds=time.perf_counter() - started,
    )


def _alike(found_by: Mapping[bool, LoopFit]) -> bool:
    """Whether fits say the same of loops that begin in two ways."""
    costs = [each.cost for each in found_by.values()]
    return len(costs) > 1 and max(costs) <= (1.0 + _SAME) * min(costs)


def _along(
    fit: LoopFit | TwoJointsFit, whole: LoopHistories, loops: Sequence[ForceLoop]
) -> tuple[np.ndarray, ...]:
    """Predicted forces of each loop, with the offset that suits it best."""
    found = []
    for row, loop in zip(fit.forces(whole), loops, strict=True):
        force = row[2 : loop.d.size + 2]
        found.append(force + np.mean(loop.force - force))
    return tuple(found)


def _unseen(name: str, unseen: Sequence[str]) -> list[str]:
    """What loops say nothing of."""
    if not unseen:
        return []
    return [f"Loops without time cannot show {', '.join(unseen)} at {name}, which depend on rate"]
