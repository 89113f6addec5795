"""A study: a model, recordings of it, and what can be done with the two."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from iwanjax.config import Data, Measurement, StudySetup, given_study
from iwanjax.errors import InputError
from iwanjax.structures import JointedStructure, LinearTrust
from iwanjax.studies.measured import MeasuredMode, measured_modes
from iwanjax.studies.results import StudyResults
from iwanjax.types import ArrayLike

if TYPE_CHECKING:
    from iwanjax.discrepancy import Diagnosis
    from iwanjax.dynamics import SimulatedResponse
    from iwanjax.modal_analysis import ModalTest
    from iwanjax.planning import Detectability
    from iwanjax.quasistatic import QsmaSolution
    from iwanjax.studies.fits import StudyFit
    from iwanjax.studies.predicted import PredictedRecording
    from iwanjax.studies.simulations import DrivenJoint
    from iwanjax.trial import TrialResult
    from iwanjax.updating import Posterior

_A_STRUCTURE = "needs a structure, model.file, matrices, builder or test; this study has modal"
_TEST = (
    "there is no modal test; add for instance model: {test: {recordings: [low_level.mat], "
    "band: [2, 15], driving_points: {F: a1}}}, or call modal_test with recordings"
)
_QSMA = (
    "there is no qsma section; add for instance "
    "qsma: {modes: [0], alpha: {from: 1e-2, to: 1e+2, count: 50}}"
)


def silent(line: str) -> None:
    """Progress that nobody asked for."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Study:
    """A model, recordings of it, and what is asked of them; :func:`iwanjax.load_study` reads one.

    No method changes the study or writes a file, unless it is given one. Results come by name;
    ``.only`` is the one of a study that has one.

    Parameters
    ----------
    structure : JointedStructure, optional
        With its joints at their starting values. Without it ``modal`` says which modes there are.
    recordings : sequence, or a single one
        What was measured: each a :class:`iwanjax.Recording` (:func:`iwanjax.as_recording` makes
        one of arrays and tables), :class:`iwanjax.ModalCurves` or a :class:`iwanjax.ForceLoop`;
        or an :class:`iwanjax.Measurement` of one, which says more, such as that it is held out.
    rows, sensors, inputs : mapping of str to (n,) array_like
        For each name the row ``row @ u``: where a force may be missing (joints are known), what
        a sensor sees, where a measured force acts. Channels of recordings bear these names.
    trust : LinearTrust or mapping, optional
        How exact the structure's linear model is, relative standard deviations:
        ``{"frequencies": 0.005, "damping": 0.3}``, or for each mode ``[0.002, 0.01]``.
    modal : sequence of mapping, or a single one
        Modes where no structure is known, as in a study file:
        ``{"name": "mode1", "band": (90, 150), "joint": {"type": "iwan4"}}``.
    name : str
        What results and messages call it.
    **sections
        What a study file may say besides, by the same keys and with the same checks: ``modes``,
        ``bands``, ``bounds``, ``priors``, ``values``, ``fixed``, ``qsma``, ``simulate``,
        ``ringdown``, ``fit``, ``posterior``, ``noise``, ``hypotheses``, ``budget``, ``seed``.

    Attributes
    ----------
    setup : StudySetup
        All of it, checked.

    Raises
    ------
    InputError
        ``study 'name': key: what arrived; expected ...``, for the first fault.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(4096) / 2048
    >>> decay = np.exp(-3 * t) * np.cos(2 * np.pi * 118 * t)
    >>> hit = ij.as_recording(decay, sampling_rate=2048, quantity="velocity", sensors="tip")
    >>> mode = {"name": "mode1", "band": (90, 150), "joint": {"type": "iwan4"}}
    >>> study = ij.Study(recordings=[hit], modal=[mode])
    >>> curves = study.curves().only.curves
    >>> print(f"{float(curves.frequency[0]):.1f} Hz")
    118.0 Hz
    """

    setup: StudySetup

    def __init__(
        self,
        structure: JointedStructure | None = None,
        recordings: Sequence[Data | Measurement] | Data | Measurement = (),
        *,
        rows: Mapping[str, ArrayLike] | None = None,
        sensors: Mapping[str, ArrayLike] | None = None,
        inputs: Mapping[str, ArrayLike] | None = None,
        trust: LinearTrust | Mapping[str, Any] | None = None,
        modal: Sequence[Mapping[str, Any]] | Mapping[str, Any] = (),
        name: str = "study",
        **sections: Any,
    ) -> None:
        if structure is not None and modal:
            raise InputError(f"study {name!r}: got a structure and modal; expected one of them")
        content: dict[str, Any] = {"name": name, **sections}
        if structure is None:
            modes = [modal] if isinstance(modal, Mapping) else list(modal)
            content["model"] = {"modal": modes or None}
        elif not isinstance(structure, JointedStructure):
            raise InputError(
                f"study {name!r}: structure is a {type(structure).__name__}; expected a "
                "JointedStructure, or modal=[...] where no structure is known"
            )
        setup = given_study(
            structure,
            [recordings] if isinstance(recordings, Data | Measurement) else recordings,
            rows={} if rows is None else rows,
            sensors={} if sensors is None else sensors,
            inputs={} if inputs is None else inputs,
            trust=trust,
            content=content,
        )
        self._set(setup)

    def _set(self, setup: StudySetup) -> None:
        object.__setattr__(self, "setup", setup)

    @classmethod
    def of(cls, setup: StudySetup) -> Self:
        """The study of what has been checked already."""
        study = cls.__new__(cls)
        study._set(setup)
        return study

    @property
    def name(self) -> str:
        """What results call it."""
        return self.setup.name

    @property
    def structure(self) -> JointedStructure | None:
        """The structure with its joints at their starting values; None for single modes."""
        return self.setup.structure

    def __repr__(self) -> str:
        setup = self.setup
        if setup.structure is None:
            model = f"modes {', '.join(mode.name for mode in setup.modal)}"
        else:
            joints = ", ".join(setup.structure.labels) or "no joints"
            model = f"{setup.structure.structure.size} coordinates with {joints}"
        return f"Study({setup.name!r}: {model}; {len(setup.recordings)} recording(s))"

    def with_structure(self, structure: JointedStructure) -> Self:
        """The same study of a structure with other joints or matrices, for instance fitted ones.

        Raises
        ------
        InputError
            For a study of single modes, another size or joints of other names.
        """
        return self.of(self.setup.with_structure(structure))

    def modal_test(self) -> "ModalTest":
        """Modes by the low-level recordings of ``model.test``, with deviations.

        Raises
        ------
        InputError
            For a study whose model comes from elsewhere.
        """
        if self.setup.test is None:
            raise InputError(f"{self.setup.label}: {_TEST}")
        return self.setup.test

    def curves(self) -> StudyResults[MeasuredMode]:
        """Frequency and damping of each mode against amplitude, as the recordings have them.

        Returns
        -------
        StudyResults of MeasuredMode
            ``curves["mode1"].curves`` is a mode's one curve, ``.hits`` are those behind it.

        Raises
        ------
        InputError
            With the recording's place, for what cannot be read or analysed; if nothing is left.
        """
        return StudyResults({mode.name: mode for mode in measured_modes(self.setup)})

    def fit(self, curves: StudyResults[MeasuredMode] | None = None) -> StudyResults["StudyFit"]:
        """Joints and damping by the curves, with deviations; recordings held out are predicted.

        Parameters
        ----------
        curves : StudyResults of MeasuredMode, optional
            Of :meth:`curves`, where they are at hand.

        Returns
        -------
        StudyResults of StudyFit
            By the name of each single mode, or of the study for its structure.

        Raises
        ------
        InputError
            As :meth:`curves` and :func:`iwanjax.fit`.
        """
        from iwanjax.studies.fits import fits_of

        modes = tuple((self.curves() if curves is None else curves).values())
        return StudyResults({fit.name: fit for fit in fits_of(self.setup, modes)})

    def posterior(
        self,
        fits: StudyResults["StudyFit"] | None = None,
        *,
        chains: Mapping[str, Path] | None = None,
        progress: bool = False,
    ) -> StudyResults["Posterior"]:
        """What the recordings say of the parameters, sampled from the fits on.

        Parameters
        ----------
        fits : StudyResults of StudyFit, optional
            Of :meth:`fit`, where they are at hand.
        chains : mapping of str to Path, optional
            For the name of a fit a file that its chain is kept in while it grows: called again
            with the same file, an interrupted walk goes on.
        progress : bool
            Whether to show a bar on stderr.

        Raises
        ------
        InputError
            As :meth:`fit` and :func:`iwanjax.sample_posterior`.
        """
        from iwanjax.studies.fits import posteriors_of

        return posteriors_of(self.setup, self.fit() if fits is None else fits, chains, progress)

    def predict(
        self,
        fits: StudyResults["StudyFit"] | None = None,
        posteriors: StudyResults["Posterior"] | None = None,
        *,
        draws: int = 100,
        probability: float = 0.9,
        progress: Callable[[str], None] = silent,
    ) -> StudyResults["PredictedRecording"]:
        """The fitted structure under forces that it was not fitted to (thesis Sec. 3.4.4).

        Held against recordings in time, by mode, by frequency and damping, with bands; noise apart.

        Parameters
        ----------
        fits, posteriors : StudyResults of StudyFit, of Posterior, optional
            Where they are at hand; with a posterior bands are by it, not by the fit's covariance.
        draws, probability, progress : int, float, function
            Sets that bands are made of, their share in a band, and who receives lines.

        Raises
        ------
        InputError
            Without structure or forces held out, and for a start in motion; as :meth:`fit`.
        """
        from iwanjax.studies.predictions import held_out, predictions

        entries = held_out(self.setup, draws, probability, progress)
        given = self.fit() if fits is None else fits
        return predictions(self.setup, entries, given, posteriors, draws, probability, progress)

    def simulate(self, *names: str) -> StudyResults["SimulatedResponse | DrivenJoint"]:
        """The cases of the ``simulate`` section in time.

        Parameters
        ----------
        *names : str
            Cases; all of them by default.

        Raises
        ------
        InputError
            Without a structure or cases, for an unknown name, and as :func:`iwanjax.simulate`.
        """
        from iwanjax.studies.simulations import simulations

        self._structure("simulate")
        return simulations(self.setup, names)

    def qsma(self) -> "QsmaSolution":
        """Frequency and damping of each mode of the ``qsma`` section, from the model.

        Raises
        ------
        InputError
            Without a structure or that section, and as :func:`iwanjax.qsma`.
        """
        from iwanjax.quasistatic import qsma

        structure, settings = self._structure("qsma"), self.setup.qsma
        if settings is None:
            raise InputError(f"{self.setup.label}: {_QSMA}")
        return qsma(
            structure,
            list(settings.modes),
            settings.levels,
            settings.damping,
            frequency=settings.frequency,
            shape=settings.shape,
        )

    def diagnose(
        self, *, budget: float | None = None, progress: Callable[[str], None] = silent
    ) -> StudyResults["Diagnosis"]:
        """What the model is missing, by all that was measured.

        The kind of data decides how: time histories judge the structure in time, curves its
        modes, loops a joint on its own; without structure each mode is judged by its curves.

        Parameters
        ----------
        budget : float, optional
            Time to spend, s; the study's own by default, half an hour where it says nothing.
        progress : function
            Receives a line at every stage.

        Returns
        -------
        StudyResults of Diagnosis
            By the name of the study for its structure, of each joint, or of each single mode.

        Raises
        ------
        InputError
            As :func:`iwanjax.diagnose`.
        """
        from iwanjax.studies.diagnoses import diagnosed

        return StudyResults(diagnosed(self.setup, budget, progress))

    def detectability(self, *, progress: Callable[[str], None] = silent) -> "Detectability":
        """What these recordings would show of each effect at each place, and what to add to them.

        Of a plan that is not measured yet give recordings of :meth:`simulate`, with noise.

        Parameters
        ----------
        progress : function
            Receives a line at every stage.

        Returns
        -------
        Detectability
            The smallest size of each that is found, and told from all others, in nine of ten
            repetitions; pairs that are not told apart; hits and sensors to add.

        Raises
        ------
        InputError
            For a study without time histories of a structure, and as :func:`iwanjax.diagnose`.
        """
        from iwanjax.studies.plans import detectability_of

        return detectability_of(self.setup, progress)

    def trial(
        self, folder: str | Path, *, progress: Callable[[str], None] = silent, **asked: Any
    ) -> "TrialResult":
        """Effects concealed in these recordings and diagnosed blind: how often that is right.

        Parameters
        ----------
        folder : str or Path
            Keeps studies, sealed truths and verdicts; a trial that was interrupted goes on there.
        progress, **asked
            As for :func:`iwanjax.studies.trials.trials_of`.

        Raises
        ------
        InputError
            Without a structure of Iwan joints, its time histories and their forces.
        """
        from iwanjax.studies.trials import trials_of

        return trials_of(self.setup, Path(folder), progress, **asked)

    def _structure(self, verb: str) -> JointedStructure:
        if self.setup.structure is None:
            raise InputError(f"{self.setup.label}: {verb} {_A_STRUCTURE}")
        return self.setup.structure
