"""What a study file may hold."""

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from iwanjax.config.faults import fault
from iwanjax.config.matrices import MatricesSection
from iwanjax.config.prior import Prior
from iwanjax.config.qsma import QsmaSettings
from iwanjax.config.recordings import RecordingSection
from iwanjax.config.section import Band, ConfigSection, Count, Index, OneOrMore, Pair, Positive
from iwanjax.config.settings import FitSettings, PosteriorSettings, RingdownSettings
from iwanjax.config.simulate import SimulateSections
from iwanjax.structures import LinearTrust

Shares = Annotated[tuple[Annotated[float, Field(ge=0, lt=1)], ...], Field(min_length=1), OneOrMore]
"""Relative deviations: half, not 50."""

SOURCES = ("file", "matrices", "builder", "test", "modal")

_Tested = Annotated[
    RecordingSection, BeforeValidator(lambda raw: {"file": raw} if isinstance(raw, str) else raw)
]


class JointSection(ConfigSection):
    """An entry of ``joints:``: an element with its parameters, or a law saved in a file."""

    name: str
    row: str | None = None
    type: str
    parameters: dict[str, float] = Field(default_factory=dict)
    file: str | None = None

    @property
    def place(self) -> str:
        """The row the joint sits on; its name unless the file says otherwise."""
        return self.row or self.name


class ModalJointSection(ConfigSection):
    """The ``joint:`` of a mode: what is not given is estimated from the data."""

    type: str
    parameters: dict[str, float] = Field(default_factory=dict)


class ModalSection(ConfigSection):
    """An entry of ``modal:``."""

    name: str
    band: Band
    joint: ModalJointSection


class TrustSection(ConfigSection):
    """The ``trust:`` of a model: relative standard deviations, for all modes or one by one."""

    frequencies: Shares | None = None
    damping: Shares | None = None
    shapes: Annotated[float, Field(ge=0, lt=1)] | None = None

    def checked(self) -> LinearTrust:
        """The same as the library takes it."""
        return LinearTrust(**self.model_dump(exclude_none=True))


class ModalTestSection(ConfigSection):
    """The ``test:`` of a model: recordings that its modes come from."""

    recordings: Annotated[tuple[_Tested, ...], Field(min_length=1), OneOrMore]
    band: Band | None = None
    order: Literal["auto"] | Count = "auto"
    driving_points: dict[str, str] = Field(default_factory=dict)
    estimator: Literal["H1", "H2", "Hv"] = "H1"
    excitation: Literal["auto", "transient", "periodic", "random", "decay"] = "auto"
    period: Positive | None = None
    block: Positive | None = None
    window: Annotated[float, Field(ge=0)] | None = None


class ModelSection(ConfigSection):
    """The ``model:`` section: a structure from files, a builder or a test; or single modes."""

    file: str | None = None
    matrices: MatricesSection | None = None
    builder: str | None = None
    test: ModalTestSection | None = None
    modal: Annotated[tuple[ModalSection, ...], Field(min_length=1)] | None = None
    options: dict[str, Any] | None = None
    joints: tuple[JointSection, ...] = ()
    trust: TrustSection | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        given = [name for name in SOURCES if getattr(self, name) is not None]
        if not given and self.joints:
            return self  # joints on their own, for their loops
        if len(given) != 1:
            got = f"both {' and '.join(given)}" if given else "neither"
            raise fault(
                f"got {got}; expected one of file, matrices, builder, test and modal, or joints "
                "alone for their loops"
            )
        if self.options is not None and self.builder is None:
            raise fault(f"got options for a {given[0]}; only a builder takes options", "options")
        if self.modal is not None and self.joints:
            raise fault("got joints beside modal; expected joint: in each entry of modal", "joints")
        if self.modal is not None and self.trust is not None:
            raise fault("got trust beside modal; only a structure has a linear model", "trust")
        return self


class Sections(ConfigSection):
    """What a study may say besides its model and its recordings."""

    name: str
    qsma: QsmaSettings | None = None
    simulate: SimulateSections = ()
    modes: Annotated[tuple[Index, ...], Field(min_length=1)] | None = None
    bands: dict[str, Band] = Field(default_factory=dict)
    bounds: dict[str, Pair] = Field(default_factory=dict)
    priors: dict[str, Prior] = Field(default_factory=dict)
    values: dict[str, float] = Field(default_factory=dict)
    fixed: dict[str, float] = Field(default_factory=dict)
    ringdown: RingdownSettings = RingdownSettings()
    fit: FitSettings = FitSettings()
    posterior: PosteriorSettings = PosteriorSettings()
    noise: dict[str, Positive] = Field(default_factory=dict)
    hypotheses: tuple[str, ...] = ()
    # s; a beam of five joints with one law that nothing explains took more than an hour without.
    budget: Positive = 1800.0
    seed: Index = 0


class StudySection(Sections):
    """The whole file."""

    model: ModelSection
    recordings: tuple[RecordingSection, ...] = ()
