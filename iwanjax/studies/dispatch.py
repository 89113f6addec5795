"""One call for all that can be diagnosed: a study, a structure, a mode, a joint on its own."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias, TypeVar, overload

from iwanjax.config import Measurement
from iwanjax.curves import ModalCurves
from iwanjax.discrepancy import Diagnosis
from iwanjax.discrepancy.steady.diagnose_joint import diagnose_curves
from iwanjax.discrepancy.steady.diagnose_loops import diagnose_loops
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.signals import ForceLoop, Recording
from iwanjax.structures import JointedStructure, LinearTrust
from iwanjax.studies.results import StudyResults
from iwanjax.studies.study import Study, silent
from iwanjax.types import ArrayLike

Measured: TypeAlias = Recording | ModalCurves | ForceLoop | Measurement
Recordings: TypeAlias = (
    Measured | Sequence[Measured] | Mapping[int, ModalCurves | Sequence[ModalCurves]]
)
"""One recording, several, or curves by the index of their mode."""

D = TypeVar("D", ModalCurves, ForceLoop)


@overload
def diagnose(
    what: Study, *, budget: float | None = None, progress: Callable[[str], None] = silent
) -> StudyResults[Diagnosis]: ...


@overload
def diagnose(
    what: JointedStructure | AbstractJoint | type[AbstractJoint] | str,
    recordings: Recordings,
    hold_out: Recordings = (),
    *,
    rows: Mapping[str, ArrayLike] | None = None,
    sensors: Mapping[str, ArrayLike] | None = None,
    inputs: Mapping[str, ArrayLike] | None = None,
    hypotheses: Sequence[str] = (),
    noise: Mapping[str, float] | float | None = None,
    trust: LinearTrust | Mapping[str, Any] | None = None,
    budget: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = silent,
) -> Diagnosis: ...


def diagnose(
    what: Study | JointedStructure | AbstractJoint | type[AbstractJoint] | str,
    recordings: Recordings = (),
    hold_out: Recordings = (),
    *,
    rows: Mapping[str, ArrayLike] | None = None,
    sensors: Mapping[str, ArrayLike] | None = None,
    inputs: Mapping[str, ArrayLike] | None = None,
    hypotheses: Sequence[str] = (),
    noise: Mapping[str, float] | float | None = None,
    trust: LinearTrust | Mapping[str, Any] | None = None,
    budget: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = silent,
) -> Diagnosis | StudyResults[Diagnosis]:
    r"""Is anything missing from a model, where, of which kind, and how much better it is with it.

    The model's own parameters are refitted first; then each effect (a law at a place, a fault of
    a sensor or of a joint) is added and everything is refitted. Evidence compares them, and
    recordings held out decide whether the correction predicts better.

    ===================  =======================================  ==================================
    ``what``             ``recordings``                           compared
    ===================  =======================================  ==================================
    Study                its own                                  everything that it holds
    JointedStructure     Recordings with forces, or free decays   responses in time
    JointedStructure     ModalCurves by mode, ``{0: curves}``     frequency and damping of modes
    joint class or name  ModalCurves of one mode                  the same of one oscillator
    joint                ForceLoops of this joint                 its force against deflection
    ===================  =======================================  ==================================

    Parameters
    ----------
    what : Study, JointedStructure, joint, or joint class or name
        The model, its joints at their starting values.
    recordings, hold_out : recording, sequence of them, or mapping of int to ModalCurves
        What was measured: what fits see, and what only the final comparison sees. An
        :class:`iwanjax.Measurement` says more of one.
    rows, sensors, inputs : mapping of str to (n,) array_like
        Of a structure, as for :class:`iwanjax.Study`: where an effect may act (joints are known),
        what sensors see, where measured forces act.
    hypotheses : sequence of str
        Kinds of effects to try; all of the catalogue by default.
    noise : mapping of str to float, or float, optional
        Standard deviation of each sensor's noise, in its unit, or of the loops' force; estimated
        from the recordings where it is not given. Curves carry their deviations.
    trust : LinearTrust or mapping, optional
        How exact the linear model of a structure is, as for :class:`iwanjax.Study`: its
        frequencies and damping are fitted within that.
    budget : float, optional
        Time to spend, s: for a structure half an hour by default, for a joint or a mode no end.
    seed : int
        Of the searches.
    progress : function
        Receives a line at every stage.

    Returns
    -------
    Diagnosis
        For a study :class:`~iwanjax.studies.StudyResults`, a Diagnosis for each of its models.

    Raises
    ------
    InputError
        For recordings that do not belong to the model or cannot be fitted, arguments that mean
        nothing for it, unknown hypotheses.
    PrecisionError
        When JAX computes in float32.

    Examples
    --------
    A joint with a cubic spring beside it, of which the model knows nothing:

    >>> import numpy as np
    >>> import iwanjax as ij
    >>> d = np.concatenate([np.linspace(0, 2, 40), np.linspace(2, -2, 80), np.linspace(-2, 2, 80)])
    >>> force = ij.hysteresis(ij.Jenkins(F_S=1.0, K_T=1.0), d) + 0.3 * d**3
    >>> noise = 1e-3 * np.random.default_rng(0).standard_normal(d.size)
    >>> tried = ["cubic_stiffness", "stiffness_error"]
    >>> model = ij.Jenkins(F_S=1.2, K_T=0.9)
    >>> verdict = ij.diagnose(model, ij.ForceLoop(d, force + noise), hypotheses=tried)
    >>> verdict.verdict.name, verdict.what[0].label
    ('something_missing', 'cubic_stiffness@joint')
    """
    asked: dict[str, Any] = {
        "recordings": recordings,
        "hold_out": hold_out,
        "rows": rows,
        "sensors": sensors,
        "inputs": inputs,
        "hypotheses": hypotheses,
        "noise": noise,
        "trust": trust,
        "seed": seed,
    }
    if isinstance(what, Study):
        _refuse("a study", asked, tuple(asked))
        return what.diagnose(budget=budget, progress=progress)
    if isinstance(what, JointedStructure):
        return _of_structure(what, asked, budget, progress)
    options = {
        "hypotheses": tuple(hypotheses),
        "budget": math.inf if budget is None else budget,
        "seed": seed,
        "progress": progress,
    }
    of_structures = ("rows", "sensors", "inputs", "trust")
    if isinstance(what, AbstractJoint):
        _refuse("a joint", asked, of_structures)
        if isinstance(noise, Mapping):
            raise InputError("diagnose: noise is a mapping; expected one number, the force's")
        loops, others = (_all_of(ForceLoop, x, "a joint") for x in (recordings, hold_out))
        return diagnose_loops(what, loops, others, noise=noise, **options)
    if isinstance(what, str) or (isinstance(what, type) and issubclass(what, AbstractJoint)):
        _refuse("a joint's class or name", asked, (*of_structures, "noise"))
        curves, others = (
            _all_of(ModalCurves, x, "a joint's class or name") for x in (recordings, hold_out)
        )
        return diagnose_curves(what, curves, others, **options)
    raise InputError(
        f"diagnose: got a {type(what).__name__}; expected a Study, a JointedStructure, a joint, or "
        "a joint's class or name"
    )


def _refuse(what: str, asked: Mapping[str, Any], names: tuple[str, ...]) -> None:
    """Refuse arguments that mean nothing for a model."""
    for name in names:
        value = asked[name]
        default = value is None or (isinstance(value, int | Sequence | Mapping) and not value)
        if not default:
            hint = "; the study holds its own" if what == "a study" else ""
            raise InputError(f"diagnose: {name} does not belong to {what}{hint}")


def _all_of(kind: type[D], given: Any, what: str) -> list[D]:
    """Recordings of one type, in a list."""
    single = isinstance(given, Recording | ModalCurves | ForceLoop)
    several: list[Any] = [given] if single else list(given)
    for each in several:
        if not isinstance(each, kind):
            raise InputError(
                f"diagnose: got a {type(each).__name__} for {what}; expected {kind.__name__}s"
            )
    return several


def _of_structure(
    structure: JointedStructure,
    asked: Mapping[str, Any],
    budget: float | None,
    progress: Callable[[str], None],
) -> Diagnosis:
    """The study of a structure with recordings of one kind."""
    measurements = _measurements(asked["recordings"]) + [
        replace(each, use="hold_out") for each in _measurements(asked["hold_out"])
    ]
    kinds = dict.fromkeys(type(each.data) for each in measurements)
    if len(kinds) != 1 or ForceLoop in kinds:
        names = " and ".join(kind.__name__ for kind in kinds) or "no recordings"
        raise InputError(
            f"diagnose: got {names} for a structure; expected Recordings or ModalCurves. A joint "
            "takes its ForceLoops, and a Study recordings of all kinds"
        )
    if not (asked["noise"] is None or isinstance(asked["noise"], Mapping)):
        raise InputError("diagnose: noise is one number; expected {sensor: standard deviation}")
    study = Study(
        structure,
        measurements,
        name="structure",
        **{name: asked[name] for name in ("rows", "sensors", "inputs", "trust", "seed")},
        hypotheses=list(asked["hypotheses"]),
        noise=dict(asked["noise"] or {}),
    )
    return study.diagnose(budget=budget, progress=progress).only


def _measurements(given: Any) -> list[Measurement]:
    """Recordings as a study takes them."""
    if isinstance(given, Mapping):
        return [
            Measurement(each, mode=mode)
            for mode, curves in given.items()
            for each in ([curves] if isinstance(curves, ModalCurves) else curves)
        ]
    single = isinstance(given, Recording | ModalCurves | ForceLoop | Measurement)
    return [
        each if isinstance(each, Measurement) else Measurement(each)
        for each in ([given] if single else given)
    ]
