"""Is anything missing from a structure, by measured curves of its modes."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.findings import Score
from iwanjax.discrepancy.steady.runs import CurveRun, ModesRun, clear_differences
from iwanjax.discrepancy.steady.trials import Trials, forces_of, kinds_named
from iwanjax.discrepancy.steady.verdict import concluded
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Parameter, drawn, fixed_at, replaced
from iwanjax.identification.steady.fit import PlacedEffect
from iwanjax.identification.steady.modes import (
    JointsAlone,
    ModesFit,
    modes_alone,
    modes_beside,
    modes_from_within,
    modes_with_joint,
    scored,
)
from iwanjax.settings.stages import settings
from iwanjax.structures import JointedStructure
from iwanjax.structures.checks import finite_array
from iwanjax.types import ArrayLike, require_double_precision
from iwanjax.updating.background import (
    background_name,
    background_parameters,
    viscous_ratios,
)
from iwanjax.updating.joint_groups import structural_parameters
from iwanjax.updating.problem import Reference
from iwanjax.updating.structural import structural_problem

_QUANTITY = "modal displacement"


def diagnose_modes(
    structure: JointedStructure,
    recordings: Mapping[int, ModalCurves],
    hold_out: Mapping[int, ModalCurves | Sequence[ModalCurves]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    *,
    rows: Mapping[str, ArrayLike],
    groups: Mapping[str, Sequence[str]] | None = None,
    reference: Reference = "absolute",
    hypotheses: tuple[str, ...] = (),
    starts: int = 64,
    seed: int = 0,
    budget: float = math.inf,
    progress: Callable[[str], None] = lambda line: None,
) -> Diagnosis:
    r"""Compare a structure with measured frequency and damping of its modes against amplitude.

    First the joints alone are fitted, through quasi-static modal analysis. Then every force of
    the catalogue acts at every place, by its first harmonic and its loss over a steady cycle of
    each mode on its own: at a glance first, of all shapes and sizes while the joints move
    linearly; the best of these are fitted again together with the joints, and a whole joint more
    where single forces promise most. Curves must be of
    one mode at a time, as free decays of a mode are that a modal filter or a shaker has singled
    out: where several modes move a joint at once, it is softer than curves can say.

    Evidences are those of a diagnosis by time histories, of levels whose residuals may be
    correlated along a curve. Errors are root mean squares of predicted less measured frequency,
    over its fall below each mode's highest, and damping, over itself.

    Parameters
    ----------
    structure : JointedStructure
        With the joints at their starting values.
    recordings : mapping of int to ModalCurves
        For each elastic mode, lowest 0, the curve to fit, against modal displacement, with
        deviations (several hits: :func:`iwanjax.merge_curves`).
    hold_out : mapping of int to ModalCurves or sequence of them, optional
        Curves of these modes that no fit sees.
    parameters : mapping of str to Parameter, optional
        Replaces those of :func:`modes_parameters` by name.
    rows : mapping of str to (n,) array_like
        Where a force may be missing.
    groups : mapping of str to sequence of str, optional
        Joints that share their parameters, under a common name.
    reference : {"absolute", "shift"}
        Compare frequencies themselves, or up to one offset a mode: then of linear springs and
        masses nothing is said.
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
        Its ``runs`` are :class:`ModesRun`.

    Raises
    ------
    InputError
        For curves that cannot be fitted, rows that do not fit the structure, unknown
        parameters or hypotheses.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("diagnose_modes")
    trials = Trials[ModesFit](budget, progress)
    forces = forces_of(hypotheses, variants=False)
    modes, others = _checked(recordings, hold_out or {})
    places = {label: _row(structure, label, row) for label, row in rows.items()}
    if not places:
        raise InputError("diagnose_modes: no rows; expected {label: row} for at least one place")
    several = [recordings[mode] for mode in modes]
    known = modes_parameters(structure, several, modes, groups)
    row = replaced(tuple(known.values()), parameters or {})
    base = structural_problem(structure, several, row, modes, None, groups, reference)
    random = np.random.default_rng(seed)
    least = settings().steady.mode_starts
    draws = drawn(row, random, max(starts, least)) if row else np.zeros((least, 0))
    trials.say(f"fitting the joints alone to {len(modes)} mode(s)")
    alone = modes_alone(base, draws)
    if not math.isfinite(alone.cost):
        raise InputError(
            "diagnose_modes: no start gave finite residuals; are the amplitudes in the unit that "
            "the model is in?"
        )
    joints = JointsAlone.of(alone)
    scores: list[ModesFit] = []
    for force in trials.in_time(
        forces, lambda force: f"looking for {force.name} at {len(places)} place(s)"
    ):
        each = [scored(joints, force, label, inside) for label, inside in places.items()]
        seen = [score for score in each if score is not None]
        scores += seen
        trials.unseen += [] if seen else [force.name]
    trials.fit(
        _worth_a_fit(scores),
        lambda score: f"with {_effect(score).kind.name} at {_effect(score).where}",
        lambda score: modes_beside(alone, score, draws),
    )
    trials.none_worse(modes_from_within)
    for more in kinds_named("iwan_joint", hypotheses):
        trials.fit(
            _joint_places(places, scores),
            lambda place: f"with a joint left out at {place[0]}",
            lambda place, more=more: modes_with_joint(
                alone, more, place, several, row, groups, trials.contained(more, place[0])
            ),
        )

    def run(fit: ModesFit, chosen: ModesFit) -> ModesRun:
        each = [
            CurveRun.of((fitted, *held), fit.predicted((fitted, *held), i), 1)
            for i, (fitted, held) in enumerate(zip(several, others, strict=True))
        ]
        return ModesRun(tuple(each), tuple(f"mode {mode}" for mode in modes))

    return concluded(
        trials,
        alone,
        "",
        run,
        row,
        observables=lambda before: tuple(
            each
            for mode, of_mode, called in zip(modes, before.modes, before.labels, strict=True)
            for each in clear_differences(of_mode, mode, called)
        ),
        scores=_drops(alone, scores),
        warnings=lambda _: _unseen(list(dict.fromkeys(trials.unseen))),
    )


def modes_parameters(
    structure: JointedStructure,
    curves: Sequence[ModalCurves],
    modes: Sequence[int],
    groups: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, Parameter]:
    """Parameters of a diagnosis by curves: those of a fit, damping that is given held.

    A mode that the structure's C damps keeps that: were it free it would take the place of a
    missing dashpot. Without any the curves say it.

    Parameters
    ----------
    structure, curves, modes, groups
        As for :func:`iwanjax.structural_parameters`.
    """
    if structure.labels:
        known = structural_parameters(structure, groups, curves, modes)
    else:
        known = background_parameters(structure, curves, modes)
    given = viscous_ratios(structure, modes) > 0.0
    held = [background_name(mode) for mode, damped in zip(modes, given, strict=True) if damped]
    return {p.name: p for p in fixed_at(tuple(known.values()), held)}


def _checked(
    recordings: Mapping[int, ModalCurves],
    hold_out: Mapping[int, ModalCurves | Sequence[ModalCurves]],
) -> tuple[list[int], list[tuple[ModalCurves, ...]]]:
    """Modes in order, and the curves of each that are held out."""
    if not recordings:
        raise InputError("diagnose_modes: no curves; expected {mode: curves} for at least one mode")
    modes = sorted(recordings)
    stray = [mode for mode in hold_out if mode not in recordings]
    if stray:
        raise InputError(
            f"diagnose_modes: mode {stray[0]} is held out only; expected one of those to fit, "
            f"{', '.join(map(str, modes))}"
        )
    others = []
    for mode in modes:
        given = hold_out.get(mode, ())
        others.append((given,) if isinstance(given, ModalCurves) else tuple(given))
        for each in (recordings[mode], *others[-1]):
            if each.quantity != _QUANTITY:
                raise InputError(
                    f"diagnose_modes: mode {mode} has a curve against {each.quantity}; expected "
                    f"{_QUANTITY} (see ModalCurves.as_quantity and ModalCurves.scaled)"
                )
    return modes, others


def _row(structure: JointedStructure, label: str, given: ArrayLike) -> np.ndarray:
    row = finite_array(given, f"rows[{label!r}]")
    if row.shape != (structure.structure.size,):
        raise InputError(
            f"rows[{label!r}] has shape {row.shape}; expected ({structure.structure.size},) like M"
        )
    return row


def _effect(score: ModesFit) -> PlacedEffect:
    assert score.effect is not None
    return score.effect


def _worth_a_fit(scores: Sequence[ModesFit]) -> list[ModesFit]:
    """The best of all, and the best of each kind, in the order that they were looked for."""
    ranked = sorted(scores, key=lambda each: each.cost)
    first: dict[str, ModesFit] = {}
    for score in ranked:
        first.setdefault(_effect(score).kind.name, score)
    chosen = [*ranked[: settings().steady.refits], *first.values()]
    return [score for score in scores if any(score is each for each in chosen)]


def _joint_places(
    rows: Mapping[str, np.ndarray], scores: Sequence[ModesFit]
) -> list[tuple[str, np.ndarray]]:
    """Where a joint left out is tried: where single forces promise most."""
    ranked = sorted(scores, key=lambda each: each.cost)
    labels = dict.fromkeys(_effect(each).where for each in ranked)
    chosen = [*labels, *(label for label in rows if label not in labels)]
    return [(label, rows[label]) for label in chosen[: settings().steady.joint_places]]


def _drops(alone: ModesFit, scores: Sequence[ModesFit]) -> tuple[Score, ...]:
    """What each force would explain of what the joints alone leave, the most first."""
    drops = []
    for score in scores:
        kind, _, where, _ = _effect(score)
        drops.append(Score(kind.name, where, max(0.0, 1.0 - score.cost / alone.cost)))
    return tuple(sorted(drops, key=lambda score: -score.drop))


def _unseen(unseen: Sequence[str]) -> list[str]:
    """What curves say nothing of."""
    if not unseen:
        return []
    return [f"Curves of single modes cannot show {', '.join(unseen)}: no first harmonic, no loss"]
