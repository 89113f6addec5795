"""Tuned numbers of a diagnosis by time histories, one frozen object for each of its stages.

They travel with the problem (:class:`~iwanjax.identification.problem.HistoryProblem`), so
that a script can replace one. Where a source is not named a number was tuned on the concealed cases
of development (``tests/concealed``); ``tests/concealed/sensitivity.py`` says what halving and
doubling each of them does.
"""

from dataclasses import dataclass

from iwanjax.settings.conditioning import CONDITIONING, ConditioningSettings
from iwanjax.settings.memory import MEMORY, MemorySettings


@dataclass(frozen=True)
class SelectionSettings:
    """Which hypotheses are tried, from where, and which of them go on.

    Attributes
    ----------
    searched : float
        Share of the time that the search may take: polishing to the free run and predicting what
        is held out need the rest. Chosen, not measured; it matters where the time runs out.
    moving : int
        Forces that are judged about the motion itself, those that promise most at rest.
    cut : float
        Share of the largest value a sensor showed, where it may have been cut: noise lies above.
    least_promise : float, log evidence
        Evidence that a score test has to promise before a suspect is refitted.
    clear : float
        Share of the squared residual that all laws of the likeliest place take off from which on no
        other score test is needed.
    hopeless : float
        Share of the best one's drop from which on a suspect is worth a refit.
    first, second : int
        Hypotheses that are refitted with a time constant of two and of eight cycles; the first ones
        of each score test, at places where something acts: the missing effect ranked fifth or
        better in one of them.
    field : int
        Of the first how many go on after a few steps: in 25 of 27 cases the later winner led by
        then, in the others it was second or third.
    smaller : tuple of float
        Shares of the size foreseen that are begun with, until the model withstands one.
    finalists, best_fits : int
        Entries that are fitted to the free run, by evidence with and without what nested laws are
        granted.
    give_up : float
        Times the best cost from which on a search is given up.
    misfit : float
        Squared residual over the noise's from which on a suspect is not all there is: the general
        law is tried at its place.
    as_much : float
        Share of a cost by which kinds may differ that explain as much.
    hope : float, log evidence
        Evidence by which a finalist may be behind without that grant: a longer memory finds errors
        of the model's own, not other evidence of that size.
    rough : float
        Relative gain that is worth another step while many suspects are compared.
    fine : float
        The same in a polish, with a longer memory than eight cycles.
    polish : int
        Steps of a polish.
    polish_give_up : float
        Times the best cost from which on a refit with another memory is given up: what is left
        needs no last digit.
    repeats : int
        Times that a search may take its steps again.
    long_time_constant : float, cycles
        Of the observer on the way to the free run.
    nested_shares : tuple of float
        Shares of a law's own doing with which it is begun where it does what a simpler one does.
    nothing_shares : tuple of float
        Further ones where it does nothing: its own size may have been a blind guess.
    nested_give_up : float
        Times the best cost from which on simpler kinds, or those that contain them, are given up.
    """

    searched: float = 0.7
    moving: int = 32
    cut: float = 0.98
    least_promise: float = 3.0
    clear: float = 0.8
    hopeless: float = 0.15
    first: int = 6
    second: int = 6
    field: int = 8
    smaller: tuple[float, ...] = (1.0, 0.1, 0.01)
    finalists: int = 3
    best_fits: int = 2
    give_up: float = 10.0
    misfit: float = 1.2
    as_much: float = 0.02
    hope: float = 100.0
    rough: float = 1e-2
    fine: float = 1e-4
    polish: int = 15
    polish_give_up: float = 30.0
    repeats: int = 3
    long_time_constant: float = 40.0
    nested_shares: tuple[float, ...] = (1e-1, 1e-2, 1e-3, 1e-4)
    nothing_shares: tuple[float, ...] = (1e-8, 1e-12)
    nested_give_up: float = 1.5


@dataclass(frozen=True)
class PairSettings:
    """When a second suspect is looked for beside the first, and when it is kept.

    Attributes
    ----------
    seconds, partners : int
        Suspects that are tried beside the first, and pairs that are fitted with a longer memory.
    fall : float
        How many times a second suspect has to lessen what is more than noise leaves.
    second_gain : float, log evidence
        Evidence that it needs.
    rounds : int
        Times that a second is looked for.
    far : float
        Squared residual over the noise's from which on a suspect, or a pair, explains too little.
    as_good : float
        Times the best suspect's cost until which another is worth a second beside it then.
    """

    seconds: int = 6
    partners: int = 3
    fall: float = 3.0
    second_gain: float = 15.0
    rounds: int = 2
    far: float = 3.0
    as_good: float = 2.0


@dataclass(frozen=True)
class JointFaultSettings:
    """How joints left out, joints that stick, and other macroslip are tried.

    Attributes
    ----------
    thetas : tuple of float
        Ratios of kinetic to static friction to begin with: near one what it does is nearly linear.
    tried : int
        Starts of a hypothesis that are fitted, those that promise most.
    places, guesses : int
        Places where a whole joint is tried, and how many starts.
    slips, slipped : tuple of float
        Slips to begin with, over the largest deflection, and over a slider's own.
    near : int
        Starts of a whole law of which it is seen what a step promises.
    elsewhere : int
        Places where the joint found is tried again, scaled to what they do.
    pairs : int
        Pairs of suspects in which a joint may stand for one.
    ahead : float
        Times the best cost with a short memory from which on a joint's fault is fitted no further.
    loose_theta : float
        Prior deviation of theta over a given joint's.
    loose_joint : tuple of float
        The same of the parameters of a joint left out.
    macroslip_step : float
        Step of the logarithm of the deflection at which macroslip may begin, over that of the fit.
    macroslip_before, macroslip_beyond : int
        How many of them before and beyond the fit.
    macroslip_difference : float
        Step of that logarithm by which derivatives are taken.
    """

    thetas: tuple[float, ...] = (0.7, 0.4, 0.9)
    tried: int = 2
    places: int = 2
    guesses: int = 6
    slips: tuple[float, ...] = (0.1, 1.0)
    slipped: tuple[float, ...] = (1.0, 4.0)
    near: int = 12
    elsewhere: int = 4
    pairs: int = 2
    ahead: float = 1.3
    loose_theta: float = 3.0
    loose_joint: tuple[float, ...] = (4.0, 8.0, 1.5, 2.0)
    macroslip_step: float = 0.4
    macroslip_before: int = 2
    macroslip_beyond: int = 3
    macroslip_difference: float = 1e-3


@dataclass(frozen=True)
class ProbingSettings:
    """How forces of any size are tried where a score at size zero says little.

    Attributes
    ----------
    places : int
        Places that are probed.
    shares : tuple of float
        Largest forces, as shares of what would hold the place there.
    refitted, kept : int
        Suspects that are refitted, and those of them with a longer memory.
    """

    places: int = 2
    shares: tuple[float, ...] = (0.03, 0.3, 3.0, 30.0)
    refitted: int = 4
    kept: int = 2


@dataclass(frozen=True)
class SlowEffectSettings:
    """When something new is looked for with a longer memory.

    Attributes
    ----------
    left : float
        Times what noise leaves from which on something new is looked for.
    new_share : float
        Share of what is new that a suspect has to take: a free run adds up the model's own errors,
        too.
    known, refitted : int
        Suspects that are refitted: the best so far, and the most promising now.
    field : int
        How many of them go on after a few steps.
    """

    left: float = 1.25
    new_share: float = 0.5
    known: int = 2
    refitted: int = 4
    field: int = 3


@dataclass(frozen=True)
class StepSettings:
    """How many steps a sampling interval takes.

    Attributes
    ----------
    fewest, most : int
        Steps between samples that are taken.
    order : float
        Power of the step that errors fall with at least: 1.4 to 2.6 on concealed cases and a joint
        that slips, whose stiffness jumps at each turn; 3 where forces are smooth.
    compared, same, same_free : float
        Difference by finer steps that is none beside the noise: while suspects are compared, where
        its square may look like something more that is missing; with the same memory in the end;
        and in the free run, where errors add up.
    more_than_noise : float
        Squared residual over the noise's from which on a fit may want for steps.
    other_units : float
        Measured over predicted amplitude from which on units are in doubt: nothing of the catalogue
        is worth that much.
    """

    fewest: int = 2
    most: int = 8
    order: float = 1.4
    compared: float = 0.4
    same: float = 0.3
    same_free: float = 0.7
    more_than_noise: float = 1.1
    other_units: float = 100.0


@dataclass(frozen=True)
class IllustrationSettings:
    """What is shown of a verdict, which does not rest on it.

    Attributes
    ----------
    band : float
        Half width of a mode's band over its frequency, at most.
    band_share : float
        Share of the distance to the next mode that it may take.
    highest : float
        The highest mode that is looked at, over the sampling rate.
    levels : int
        Amplitudes that frequency and damping are compared at.
    bins, fewest : int
        Of the recovered force along the deflection, and the fewest samples of one.
    longest : int, samples
        That a force is recovered from, the first ones: each keeps covariances of the whole state.
    """

    band: float = 0.2
    band_share: float = 0.4
    highest: float = 0.3
    levels: int = 9
    bins: int = 25
    fewest: int = 4
    longest: int = 10_000


@dataclass(frozen=True)
class HistorySettings:
    """All stages of a diagnosis by time histories."""

    conditioning: ConditioningSettings = CONDITIONING
    selection: SelectionSettings = SelectionSettings()
    pairs: PairSettings = PairSettings()
    joint_faults: JointFaultSettings = JointFaultSettings()
    probing: ProbingSettings = ProbingSettings()
    slow_effects: SlowEffectSettings = SlowEffectSettings()
    steps: StepSettings = StepSettings()
    illustration: IllustrationSettings = IllustrationSettings()
    memory: MemorySettings = MEMORY


HISTORIES = HistorySettings()
"""As diagnoses are made."""
