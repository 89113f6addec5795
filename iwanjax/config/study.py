"""What a study works on, checked: its model, its recordings, and what is asked of them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from iwanjax.config.cases import SimulationCase, simulation_cases
from iwanjax.config.entries import measured_entries, recording_entries
from iwanjax.config.faults import one_of
from iwanjax.config.modal import ModalMode, modal_modes
from iwanjax.config.modal_test import tested
from iwanjax.config.names import Names, known, once
from iwanjax.config.parameters import ParameterChange, modal_changes, structural_changes
from iwanjax.config.qsma import QsmaSettings
from iwanjax.config.recordings import Data, Measurement, RecordingEntry
from iwanjax.config.schema import SOURCES, Sections, StudySection, TrustSection
from iwanjax.config.settings import FitSettings, PosteriorSettings, RingdownSettings
from iwanjax.config.source import Place, Source
from iwanjax.config.structure import model_of
from iwanjax.errors import InputError
from iwanjax.modal_analysis import ModalTest
from iwanjax.structures import JointedStructure, LinearTrust
from iwanjax.structures.checks import finite_array
from iwanjax.structures.model_file import Model
from iwanjax.types import ArrayLike

if TYPE_CHECKING:
    from iwanjax.estimation import Parameter

S = TypeVar("S", FitSettings, PosteriorSettings)

# Sections that mean nothing without a structure.
_STRUCTURAL = ("qsma", "simulate", "modes", "bands")


@dataclass(frozen=True, eq=False)
class StudySetup:
    """What a study file, or a program, says; checked.

    Attributes
    ----------
    name : str
        What reports call it.
    label : str
        What messages begin with: the file, or the study's name.
    path : Path or None
        The file; paths in it are relative to its folder. None for a study made in Python.
    model : Model or None
        The structure without joints, its named rows, sensors and inputs; None for a study
        of single modes.
    structure : JointedStructure or None
        The structure with its joints at their starting values; None likewise.
    modal : tuple of ModalMode
        The modes of a study without structure.
    recordings : tuple of RecordingEntry
        What has been measured.
    modes : tuple of int or None
        Elastic modes of the structure that the curves are of; None where not said.
    bands : dict of int to (float, float)
        Where elastic modes lie, Hz.
    changes : mapping of str to ParameterChange
        What the study says of parameters, by mode or joint and parameter; see
        :meth:`parameters`.
    qsma : QsmaSettings or None
        The ``qsma:`` section.
    simulate : tuple of SimulationCase
        The cases of the ``simulate:`` section.
    ringdown : RingdownSettings
        How free decays become curves.
    fit : FitSettings
        How curves are fitted.
    posterior : PosteriorSettings
        How the posterior is sampled.
    noise : dict of str to float
        Standard deviation of a sensor's or an input's noise, in its unit.
    trust : LinearTrust or None
        How exact the linear model is; of a modal test its deviations where the study says nothing,
        else None leaves it to the diagnosis.
    test : ModalTest or None
        What ``model.test`` has come to.
    hypotheses : tuple of str
        What may be missing; empty for all that is known.
    budget : float
        Time that a diagnosis may take, s.
    seed : int
        Of all that is random, unless a section has its own.
    """

    name: str
    label: str
    path: Path | None
    model: Model | None
    structure: JointedStructure | None
    modal: tuple[ModalMode, ...]
    recordings: tuple[RecordingEntry, ...]
    modes: tuple[int, ...] | None
    bands: dict[int, tuple[float, float]]
    changes: Mapping[str, ParameterChange]
    qsma: QsmaSettings | None
    simulate: tuple[SimulationCase, ...]
    ringdown: RingdownSettings
    fit: FitSettings
    posterior: PosteriorSettings
    noise: dict[str, float]
    trust: LinearTrust | None
    hypotheses: tuple[str, ...]
    budget: float
    seed: int
    test: ModalTest | None = None

    def parameters(
        self, mode: str | None, defaults: Mapping[str, "Parameter"]
    ) -> dict[str, "Parameter"]:
        """The parameters of a fit with the study's bounds, priors and values.

        Parameters
        ----------
        mode : str or None
            Name of one of ``modal``; None for a structure.
        defaults : mapping of str to Parameter
            From :func:`iwanjax.updating.modal_parameters` or ``structural_parameters``.

        Returns
        -------
        dict of str to Parameter
            All of ``defaults``, under the same names.

        Raises
        ------
        InputError
            For an unknown mode, and with the file's line where the study's value lies
            outside bounds that come from the data.
        """
        names = [each.name for each in self.modal]
        if mode not in (names or [None]):
            raise InputError(f"{self.label}: no mode {mode!r}; {one_of(str(mode), names)}")
        prefix = "" if mode is None else f"{mode}."
        changes = {name: self.changes.get(f"{prefix}{name}") for name in defaults}
        return {
            name: default if (change := changes[name]) is None else change.applied(default)
            for name, default in defaults.items()
        }

    def with_structure(self, structure: JointedStructure) -> "StudySetup":
        """The same with other joints or matrices of the same size.

        Raises
        ------
        InputError
            For a study of single modes, another size or other joints.
        """
        if self.structure is None or self.model is None:
            raise InputError(f"{self.label}: has no structure to replace; it has single modes")
        got, expected = (
            f"{each.structure.size} coordinates with joints {', '.join(each.labels) or '(none)'}"
            for each in (structure, self.structure)
        )
        if got != expected:
            raise InputError(f"{self.label}: got a structure of {got}; expected {expected}")
        return replace(
            self,
            structure=structure,
            model=replace(self.model, structure=structure.structure),
            simulate=tuple(case.on(structure) for case in self.simulate),
        )


def read_study(path: str | Path) -> StudySetup:
    """Read a study file and the model it names; recordings are not opened.

    Parameters
    ----------
    path : str or Path
        A YAML file with ``name`` and ``model``: a ``file`` of ours, ``matrices`` of another
        program, a ``builder``, or a modal ``test`` of recordings, with ``joints`` and
        ``trust``, how exact it is (``{frequencies: 0.005, damping: 0.3}``); or ``modal``, single
        modes.
        Optional are ``recordings``, what is analysed (``modes``, ``bands``), what is known
        of parameters (``bounds``, ``priors``, ``values``, ``fixed``; those of a structure are
        called ``J1.chi`` or, of elastic mode 1, ``mode1.zeta_0``, and ``fixed: {J1.chi: -0.5}``
        holds one at a value), how it is done
        (``qsma``, ``simulate``, ``ringdown``, ``fit``, ``posterior``, ``seed``), and for a
        diagnosis ``noise``, ``hypotheses`` and ``budget``.

    Returns
    -------
    StudySetup

    Raises
    ------
    InputError
        ``file:line: key: what arrived; expected ...`` in one line, for the first fault.
    """
    source = Source.read(Path(path))
    section = source.validated(StudySection, source.content)
    modal = modal_modes(source, section.model.modal or ())
    _check_alone(source, section)
    asked = section.model.test
    test = None if asked is None else tested(source, asked, section.recordings)
    model, structure = (None, None) if modal else model_of(source, section.model, test)
    # Builders of a few masses name no sensors: theirs are called as recordings please.
    named = section.model.builder is None or (model is not None and bool(model.sensors))
    setup, names = _setup(source, section, modal, model, structure, named)
    trust = section.model.trust
    known = None if test is None else test.trust
    return replace(
        setup,
        recordings=recording_entries(source, section.recordings, names),
        trust=known if trust is None else trust.checked(),
        test=test,
    )


def _check_alone(source: Source, section: StudySection) -> None:
    """Refuse joints without a structure in a study of anything but their loops."""
    if any(getattr(section.model, key) is not None for key in SOURCES):
        return
    if not section.recordings:
        raise source.error(
            ("model",),
            "got neither file nor matrices, builder, test or modal; joints alone need recordings "
            "of kind loop",
        )
    for i, each in enumerate(section.recordings):
        if each.kind != "loop":
            raise source.error(
                ("recordings", i),
                f"is of kind {each.kind}; joints alone have loops only: give model.file, "
                "model.matrices or model.builder",
            )


def given_study(
    structure: JointedStructure | None,
    recordings: Sequence[Data | Measurement],
    *,
    rows: Mapping[str, ArrayLike],
    sensors: Mapping[str, ArrayLike],
    inputs: Mapping[str, ArrayLike],
    trust: LinearTrust | Mapping[str, Any] | None,
    content: Mapping[str, Any],
) -> StudySetup:
    """The same of what a program has in memory.

    Parameters
    ----------
    structure : JointedStructure or None
        With joints at their starting values; None for single modes.
    recordings : sequence
        What has been measured.
    rows, sensors, inputs : mapping of str to (n,) array
        As those of a model file; the joints' own rows need not be given.
    trust : LinearTrust or mapping, optional
        How exact the linear model is.
    content : mapping
        The other sections of a study file, and ``model: {modal: ...}`` for single modes.

    Raises
    ------
    InputError
        ``study 'name': key: what arrived; expected ...``, for the first fault.
    """
    source = Source.given(f"study {content['name']!r}", content)
    if structure is None:
        section = source.validated(StudySection, source.content)
        modal = modal_modes(source, section.model.modal or ())
        if not modal:
            raise source.error(("model",), "expected a JointedStructure, or modal: its modes")
        setup, names = _setup(source, section, modal, None, None, named=False)
    else:
        section = source.validated(Sections, source.content)
        joints = dict(zip(structure.labels, np.asarray(structure.rows), strict=True))
        model = Model(
            structure.structure,
            joints | _rows(source, "rows", rows, structure),
            _rows(source, "sensors", sensors, structure),
            _rows(source, "inputs", inputs, structure),
        )
        setup, names = _setup(source, section, (), model, structure, named=True)
    if trust is not None and structure is None:
        raise source.error(("trust",), "only a structure has a linear model; this study has modal")
    if trust is not None:
        raw = dict(trust) if isinstance(trust, Mapping) else asdict(trust)
        trust = source.validated(TrustSection, raw, ("trust",)).checked()
    return replace(setup, recordings=measured_entries(source, recordings, names), trust=trust)


def _rows(
    source: Source, kind: str, given: Mapping[str, ArrayLike], structure: JointedStructure
) -> dict[str, np.ndarray]:
    """Named rows that fit the structure."""
    n = structure.structure.size
    found = {}
    if not isinstance(given, Mapping):
        raise source.error(
            (kind,), f"got a {type(given).__name__}; expected a mapping of names to rows ({n},)"
        )
    for label, row in given.items():
        with source.blamed(kind, label):
            found[label] = finite_array(row, "the row")
        if found[label].shape != (n,):
            raise source.error(
                (kind, label), f"got shape {found[label].shape}; expected ({n},), as M has"
            )
    return found


def _setup(
    source: Source,
    section: Sections,
    modal: tuple[ModalMode, ...],
    model: Model | None,
    structure: JointedStructure | None,
    named: bool,
) -> tuple[StudySetup, Names]:
    """All but the recordings, and the names that these may use."""
    if model is None or structure is None:
        _refuse_structural(source, section)
        cases = ()
        names = Names(modal=tuple(mode.name for mode in modal))
        changes = modal_changes(source, section, modal)
    else:
        names = Names(
            elastic=structure.basis.omega2.shape[0],
            joints=structure.labels,
            sensors=tuple(model.sensors) if named else None,
            inputs=tuple(model.inputs) if named else None,
        )
        changes = structural_changes(source, section, structure)
        cases = simulation_cases(source, section.simulate, names, model, structure)
    names = replace(names, chosen=_modes(source, section, names))
    for label in section.noise:
        channels = None if names.sensors is None else (*names.sensors, *(names.inputs or ()))
        known(source, ("noise", label), label, channels, "sensor or input")
    once(source, ("hypotheses",), section.hypotheses)
    setup = StudySetup(
        name=section.name,
        label=source.label,
        path=source.path,
        model=model,
        structure=structure,
        modal=modal,
        recordings=(),
        modes=names.chosen,
        bands=_bands(source, section, names),
        changes=changes,
        qsma=section.qsma,
        simulate=cases,
        ringdown=section.ringdown,
        fit=_seeded(section.fit, section.seed),
        posterior=_seeded(section.posterior, section.seed),
        noise=dict(section.noise),
        trust=None,
        hypotheses=section.hypotheses,
        budget=section.budget,
        seed=section.seed,
    )
    return setup, names


def _refuse_structural(source: Source, section: Sections) -> None:
    """Refuse what needs a structure in a study without one."""
    given: list[Place] = [(key,) for key in _STRUCTURAL if key in section.model_fields_set]
    if "groups" in section.fit.model_fields_set:
        given.append(("fit", "groups"))
    for place in given:
        raise source.error(
            place,
            "needs a structure, model.file, matrices, builder or test; this study has modal",
        )


def _modes(source: Source, section: Sections, names: Names) -> tuple[int, ...] | None:
    """The elastic modes of the study; those of qsma are looked at too."""
    for i, mode in enumerate(section.qsma.modes if section.qsma else ()):
        names.index(source, ("qsma", "modes", i), mode)
    for i, mode in enumerate(section.modes or ()):
        names.index(source, ("modes", i), mode)
    once(source, ("modes",), section.modes or ())
    return section.modes


def _bands(source: Source, section: Sections, names: Names) -> dict[int, tuple[float, float]]:
    """The bands by index."""
    return {
        int(names.mode(source, ("bands", key), key)): band for key, band in section.bands.items()
    }


def _seeded(settings: S, seed: int) -> S:
    """The settings with the study's seed where they have none of their own."""
    own = "seed" in settings.model_fields_set
    return settings if own else settings.model_copy(update={"seed": seed})
