"""The sections that say how to analyse, fit and sample."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from iwanjax.config.faults import fault
from iwanjax.config.section import ConfigSection, Count, Index
from iwanjax.estimation.settings import Method
from iwanjax.signals.hilbert import Estimator


def _even(count: int) -> int:
    if count % 2:
        raise fault(f"got {count}; expected an even number, for instance {count + 1}")
    return count


class RingdownSettings(ConfigSection):
    """The ``ringdown:`` section: how free decays become curves.

    Attributes
    ----------
    precision : float
        Relative deviation of the damping that each interval is made long enough for.
    order : int
        Order of the band's filter.
    estimator : {"lines", "polynomial", "peaks", "short_time", "kalman"}
        As of :func:`iwanjax.ringdown`.
    """

    precision: Annotated[float, Field(gt=0, lt=1)] = 0.02
    order: Count = 3
    estimator: Estimator = "lines"


class ModelErrorSettings(ConfigSection):
    """The ``model_error:`` key: what the model's curves are wrong by themselves.

    Attributes
    ----------
    frequency, damping : float
        Relative standard deviations, 1.
    """

    frequency: Annotated[float, Field(ge=0, lt=1)]
    damping: Annotated[float, Field(ge=0, lt=1)]


class FitSettings(ConfigSection):
    """The ``fit:`` section; as keywords what :func:`iwanjax.updating.estimate` is asked for.

    Attributes
    ----------
    starts : int
        Starting points.
    seed : int
        Of their draws; the study's own unless given.
    reference : {"absolute", "shift"} or None
        Whether frequencies are compared as they are or up to one offset a curve; None
        leaves it to the model.
    groups : dict of str to tuple of str
        Joints that share their parameters, under a common name.
    coupled : bool
        Of a structure: whether what modes do to one another that move at the same time is taken
        off their curves.
    most_probable : bool
        Whether priors count as measurements do.
    model_error : ModelErrorSettings or None
        Error of the model to allow for; None leaves it to the curves.
    method : {"optimistix", "jaxopt", "host"}
        Who searches.
    """

    starts: Count = 64
    seed: Index = 0
    reference: Literal["absolute", "shift"] | None = None
    groups: dict[str, Annotated[tuple[str, ...], Field(min_length=1)]] = Field(default_factory=dict)
    coupled: bool = False
    most_probable: bool = False
    model_error: ModelErrorSettings | None = None
    method: Method = "optimistix"

    @property
    def error(self) -> tuple[float, float] | None:
        """``model_error`` as :func:`iwanjax.fit` takes it."""
        own = self.model_error
        return None if own is None else (own.frequency, own.damping)


class PosteriorSettings(ConfigSection):
    """The ``posterior:`` section; as keywords what the sampler is asked for.

    Attributes
    ----------
    effective : int
        Independent samples wanted of every parameter.
    walkers : int
        Even.
    most_steps : int
        Where to stop in any case.
    seed : int
        Of the walk; the study's own unless given.
    """

    effective: Count = 1000
    walkers: Annotated[int, Field(ge=2), AfterValidator(_even)] = 48
    most_steps: Count = 20_000
    seed: Index = 0
