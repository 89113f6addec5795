"""A study: the model that a file describes, the measurements, and what to do with them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from iwanjax.config.cases import SimulationCase, simulation_cases
from iwanjax.config.entries import recording_entries
from iwanjax.config.faults import one_of
from iwanjax.config.modal import ModalMode, modal_modes
from iwanjax.config.names import Names, known, once
from iwanjax.config.parameters import ParameterChange, modal_changes, structural_changes
from iwanjax.config.qsma import QsmaSettings
from iwanjax.config.recordings import RecordingEntry
from iwanjax.config.schema import StudySection
from iwanjax.config.settings import FitSettings, PosteriorSettings, RingdownSettings
from iwanjax.config.source import Place, Source
from iwanjax.config.structure import model_of
from iwanjax.errors import InputError
from iwanjax.structures import JointedStructure
from iwanjax.structures.model_file import Model

if TYPE_CHECKING:
    from iwanjax.updating import Parameter

S = TypeVar("S", FitSettings, PosteriorSettings)

# Sections that mean nothing without a structure.
_STRUCTURAL = ("qsma", "simulate", "modes", "bands")


@dataclass(frozen=True, eq=False)
class Study:
    """A study file, read and checked.

    Attributes
    ----------
    name : str
        What reports call it.
    path : Path
        The file; paths in it are relative to its folder.
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
        Standard deviation of a sensor's noise, in its unit.
    hypotheses : tuple of str
        What may be missing; empty for all that is known.
    budget : float or None
        Time to spend, s.
    seed : int
        Of all that is random, unless a section has its own.
    """

    name: str
    path: Path
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
    hypotheses: tuple[str, ...]
    budget: float | None
    seed: int

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
            raise InputError(f"{self.path}: no mode {mode!r}; {one_of(str(mode), names)}")
        prefix = "" if mode is None else f"{mode}."
        changes = {name: self.changes.get(f"{prefix}{name}") for name in defaults}
        return {
            name: default if (change := changes[name]) is None else change.applied(default)
            for name, default in defaults.items()
        }


def load_study(path: str | Path) -> Study:
    """Read a study file and the model it names; recordings are not opened.

    Parameters
    ----------
    path : str or Path
        A YAML file with ``name`` and ``model``: a ``file`` of ours, ``matrices`` of another
        program or a ``builder``, with ``joints``; or ``modal``, single modes.
        Optional are ``recordings``, what is analysed (``modes``, ``bands``), what is known
        of parameters (``bounds``, ``priors``, ``values``, ``fixed``; those of a structure are
        called ``J1.chi`` or, of elastic mode 1, ``mode1.zeta_0``, and ``fixed: {J1.chi: -0.5}``
        holds one at a value), how it is done
        (``qsma``, ``simulate``, ``ringdown``, ``fit``, ``posterior``, ``seed``), and for a
        diagnosis ``noise``, ``hypotheses`` and ``budget``.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        ``file:line: key: what arrived; expected ...`` in one line, for the first fault.
    """
    source = Source.read(Path(path))
    section = source.validated(StudySection, source.content)
    modal = modal_modes(source, section.model.modal or ())
    if modal:
        _refuse_structural(source, section)
        model, structure, cases = None, None, ()
        names = Names(modal=tuple(mode.name for mode in modal))
        changes = modal_changes(source, section, modal)
    else:
        model, structure = model_of(source, section.model)
        # Builders of a few masses name no sensors: theirs are called as recordings please.
        named = section.model.builder is None or bool(model.sensors)
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
        known(source, ("noise", label), label, names.sensors, "sensor")
    once(source, ("hypotheses",), section.hypotheses)
    return Study(
        name=section.name,
        path=source.path,
        model=model,
        structure=structure,
        modal=modal,
        recordings=recording_entries(source, section.recordings, names),
        modes=names.chosen,
        bands=_bands(source, section, names),
        changes=changes,
        qsma=section.qsma,
        simulate=cases,
        ringdown=section.ringdown,
        fit=_seeded(section.fit, section.seed),
        posterior=_seeded(section.posterior, section.seed),
        noise=dict(section.noise),
        hypotheses=section.hypotheses,
        budget=section.budget,
        seed=section.seed,
    )


def _refuse_structural(source: Source, section: StudySection) -> None:
    """Refuse what needs a structure in a study without one."""
    given: list[Place] = [(key,) for key in _STRUCTURAL if key in section.model_fields_set]
    if "groups" in section.fit.model_fields_set:
        given.append(("fit", "groups"))
    for place in given:
        raise source.error(
            place,
            "needs a structure, model.file, model.matrices or model.builder; this study has modal",
        )


def _modes(source: Source, section: StudySection, names: Names) -> tuple[int, ...] | None:
    """The elastic modes of the study; those of qsma are looked at too."""
    for i, mode in enumerate(section.qsma.modes if section.qsma else ()):
        names.index(source, ("qsma", "modes", i), mode)
    for i, mode in enumerate(section.modes or ()):
        names.index(source, ("modes", i), mode)
    once(source, ("modes",), section.modes or ())
    return section.modes


def _bands(source: Source, section: StudySection, names: Names) -> dict[int, tuple[float, float]]:
    """The bands by index."""
    return {
        int(names.mode(source, ("bands", key), key)): band for key, band in section.bands.items()
    }


def _seeded(settings: S, seed: int) -> S:
    """The settings with the study's seed where they have none of their own."""
    own = "seed" in settings.model_fields_set
    return settings if own else settings.model_copy(update={"seed": seed})
