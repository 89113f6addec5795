"""Tuned numbers of a diagnosis by curves and loops."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SteadySettings:
    """Fits of curves and loops with an effect beside the joints.

    Attributes
    ----------
    starts, mode_starts : int, starts
        Of one search beside a single joint, and of a structure's joints: all searches share one
        compiled kernel.
    runs, joint_runs : int, starts
        Of these how many are run to their minimum in a fit of curves: beside a force, and with a
        joint left out.
    loop_runs, loop_joint_runs : int, starts
        The same in a fit of loops.
    mode_runs : int, starts
        The same in a fit of a structure's modes.
    strengths : tuple of float, factors
        Strengths of a joint left out of curves to begin with, over what the curves' fall of
        frequency alone would ask for.
    loop_shares, loop_slips : tuple of float, factors
        Shares of the largest force, and deflections over the largest, at which a joint left out of
        loops slips to begin with.
    both : (float, float), factors
        Strengths of a joint left out that a search with a force beside it begins with, over the one
        that it has without: a force that hardens hides how much a joint softens.
    sizes : tuple of float, factors
        Sizes of a force on modes that a refit begins with, over the one of the best score.
    stiffnesses, slips : tuple of float, factors
        Stiffnesses of a joint left out of modes to begin with, over that by which a spring would
        change the modes as much as amplitude does; and deflections at which all slips, over the
        largest there.
    again : tuple of pairs, factors
        Strengths and betas of a second search over what the first one found: far below macroslip
        they lie in a long valley, along which a search ends anywhere.
    spread : float, share
        Deviation of the sizes that searches start from, over the largest that is plausible.
    shapes : int, fits
        Shapes of a force that are tried at first.
    beyond : float, factor
        How far they go beyond those of the catalogue, as a factor.
    brackets, parabolas : int, times
        Times that the best shape is bracketed, and that a parabola then says where it is.
    near : float, ratio
        Ratio of neighbouring shapes where one is nearly known.
    reshaped : float, natural logarithm
        Change of a shape's logarithm by which a residual's derivative is taken.
    at_once : float, share
        How near a joint is to the slider that it becomes where all of its sliders slip at once.
    negligible : float, share
        Share of the largest value below which a change is rounding: of stiffness and loss with
        amplitude, of a force with rate, of costs.
    wide : float, natural logarithm
        Deviation of a variable before the data, as of the priors of a joint's strength: a factor
        of four and a half either way.
    lossless : float, share
        Loss over the energy that a force turns over, below which it is rounding.
    ratios : tuple of float, factors
        Deflections by another mode that are begun with, over the mode's own.
    every : int, starts
        One of so many of the joints that the fit of the joint alone began with begins there.
    nearer : tuple of float, factors
        Ratios that a second search begins with, over what the first one ends at.
    rough, fine : float, relative tolerance
        Of these two searches: each step takes a motion of some thousand samples.
    deflections : int, amplitudes
        Amplitudes that a force at a place is worked out for.
    reach : float, factor
        How far these go beyond what the joints alone let happen, as a factor.
    softest, damped : float, factors
        Largest change that a force may make at first: of a frequency's square, and of damping over
        the largest measured.
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
    mode_starts: int = 8
    runs: int = 4
    joint_runs: int = 8
    loop_runs: int = 8
    loop_joint_runs: int = 4
    mode_runs: int = 2
    strengths: tuple[float, ...] = (1.0, 0.1)
    loop_shares: tuple[float, ...] = (0.5, 0.1)
    loop_slips: tuple[float, ...] = (1.0, 0.1, 0.3, 3.0)
    both: tuple[float, float] = (0.5, 8.0)
    sizes: tuple[float, ...] = (1.0, 0.5, 2.0, 0.1)
    stiffnesses: tuple[float, ...] = (1.0, 0.1, 10.0)
    slips: tuple[float, ...] = (1.0, 0.1, 10.0)
    again: tuple[tuple[float, float], ...] = (
        (1.0, 1.0),
        (0.7, 1.0),
        (0.5, 1.0),
        (0.5, 2.0),
        (1.4, 1.0),
        (2.0, 1.0),
        (2.0, 0.5),
        (1.0, 2.0),
    )
    spread: float = 0.5
    shapes: int = 8
    beyond: float = 4.0
    brackets: int = 2
    parabolas: int = 2
    near: float = 1.3
    reshaped: float = 1e-2
    at_once: float = 1.0 / 30.0
    negligible: float = 1e-6
    wide: float = 1.5
    lossless: float = 1e-9
    ratios: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0)
    every: int = 16
    nearer: tuple[float, ...] = (1.0, 0.9, 1.1, 1.3)
    rough: float = 1e-3
    fine: float = 1e-5
    deflections: int = 64
    reach: float = 3.0
    softest: float = 0.5
    damped: float = 2.0
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
