"""Tuned numbers of a diagnosis, one frozen object for each stage.

``settings().steady.shapes`` reads one; ``using`` replaces some for a while, as
``tests/concealed/sensitivity.py`` does to see what each of them decides. Where no source is named a
number was tuned on the concealed cases of development (``tests/concealed``). No compiled kernel
reads one but as an argument, so that a kernel never outlives a number that it was compiled with.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from iwanjax.discrepancy.history_settings import HistorySettings


@dataclass(frozen=True)
class JudgementSettings:
    """How evidence and misfits become a verdict, and what of it is worth words.

    Attributes
    ----------
    sure : float, deviations
        Deviations that a size has to differ from zero by, and that uncertain parameters may
        account for: one in twenty is farther off by chance.
    clear : float, deviations
        Deviations beyond which frequency or damping differs: one in 400 by chance.
    alike : float, natural logarithm
        Evidences closer than this cannot be told apart: odds of 20 to 1, from
        which on Kass & Raftery (1995) call evidence strong.
    likely, excluded : float, probability
        Probability from which on an explanation is mentioned, and below which it is excluded.
    notable : float, ratio
        Ratio of two errors from which on the difference is mentioned.
    neighbour : float, share
        Share of a misfit at which a law is as likely a neighbour of the truth as the truth itself.
        Over Gaussian motion the best v|v| leaves 0.31 of v^3, 0.16 with a damper beside it, and a
        damper alone 0.39 of v|v|; a cubic spring in a circuit whose damping is known to 3 % leaves
        0.09 (Silverbox: 0.10 of what is fitted, 0.06 of what is held out), drag for cubic damping
        0.12 (notebook 06). Half of it takes the spring for unknown, double of it drag for cubic
        damping.
    sharpness : float, power
        Power of that share in the odds: a choice that no data made.
    """

    sure: float = 2.0
    clear: float = 3.0
    alike: float = 3.0
    likely: float = 0.05
    excluded: float = 1e-3
    notable: float = 1.25
    neighbour: float = 0.1
    sharpness: float = 4.0


@dataclass(frozen=True)
class SteadySettings:
    """Fits of curves and loops with an effect beside the joints.

    Attributes
    ----------
    starts : int, starts
        Of one search beside a single joint; of a structure's joints half as many.
    started : int, starts
        One start of so many is run to its minimum; of a joint left out of a mode two.
    begin : tuple of float, factors
        Factors on what a measurement suggests, to begin with: on sizes, strengths and slips.
    spread : float, share
        Deviation of the sizes that searches start from, over the largest that is plausible.
    shapes : int, fits
        Shapes of a force that are tried at first.
    beyond : float, factor
        How far they go beyond those of the catalogue, as a factor.
    refinements : int, times
        Times that the best shape is bracketed, and that a parabola then says where it is.
    near : float, ratio
        Ratio of neighbouring shapes where one is nearly known.
    reshaped : float, natural logarithm
        Change of a shape's logarithm by which a residual's derivative is taken.
    at_once : float, share
        How near a joint is to the slider that it becomes where all of its sliders slip at once.
    negligible : float, share
        Share of the largest value below which a change, a force or a loss is rounding.
    ratios : int, half decades
        Deflections by another mode that are begun with, in half decades from a tenth of the
        mode's own.
    rough, fine : float, relative tolerance
        Of the search for that ratio from all of these, and from its best end: each step takes a
        motion of some thousand samples.
    deflections : int, amplitudes
        Amplitudes that a force at a place is worked out for.
    reach : float, factor
        How far these go beyond what the joints alone let happen, as a factor.
    largest : float, factor
        Factor by which a force may change damping, or divide a frequency's square, at first.
    decades, each : int, decades; sizes a decade
        Sizes of a score below that: so many decades, each so often.
    refits, joint_places : int, fits; places
        Forces at places that are refitted beside the best of each kind, and places where a whole
        joint is tried.
    cycle : int, steps
        Steps of a cycle that a force's first harmonic and loss are taken of.
    samples, averaged, sliders : int, per cycle; cycles; sliders
        Of two motions: samples per cycle of the faster mode, cycles of the slower one that are
        averaged over, and sliders of an Iwan joint.
    clear_share : float, share
        Of a curve's levels, that have to differ clearly for a mode to be mentioned.
    model_error : float, share
        Share of a mode's fall of frequency, and of its damping, by which an oscillator with one
        Iwan joint is off the mode of a structure with one: the joint works against the other
        modes' flexibility, and the shape changes. Quasi-statics of chains and a lapped beam say
        0.1 to 0.7 %.
    best_force : float, share
        Share of its root mean square to which no force of a loop is known better.
    values : int, values
        Of each loop that are fitted: its turns, and as many between them as draw it.
    """

    starts: int = 16
    started: int = 4
    begin: tuple[float, ...] = (1.0, 0.1, 10.0)
    spread: float = 0.5
    shapes: int = 8
    beyond: float = 4.0
    refinements: int = 2
    near: float = 1.3
    reshaped: float = 1e-2
    at_once: float = 0.03
    negligible: float = 1e-6
    ratios: int = 4
    rough: float = 1e-3
    fine: float = 1e-5
    deflections: int = 64
    reach: float = 3.0
    largest: float = 2.0
    decades: int = 4
    each: int = 3
    refits: int = 12
    joint_places: int = 4
    cycle: int = 256
    samples: int = 32
    averaged: int = 24
    sliders: int = 100
    clear_share: float = 0.05
    model_error: float = 0.005
    best_force: float = 1e-3
    values: int = 300


@dataclass(frozen=True)
class Settings:
    """Every stage's numbers.

    Attributes
    ----------
    judgement, steady
        Of the stage of this name.
    histories
        Of the stages of a diagnosis by time histories.
    """

    judgement: JudgementSettings = field(default_factory=JudgementSettings)
    steady: SteadySettings = field(default_factory=SteadySettings)
    histories: HistorySettings = field(default_factory=HistorySettings)


_USUAL = Settings()
_NOW = ContextVar("settings", default=_USUAL)


def settings() -> Settings:
    """Numbers that a diagnosis works with."""
    return _NOW.get()


@contextmanager
def using(other: Settings) -> Iterator[None]:
    """Work with other numbers within a ``with`` block.

    Threads that are started within it have the usual ones: what they need is read before.

    Parameters
    ----------
    other : Settings
        For instance ``Settings(steady=SteadySettings(shapes=16))``.
    """
    token = _NOW.set(other)
    try:
        yield
    finally:
        _NOW.reset(token)
