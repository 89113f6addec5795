"""Tuned numbers of the judgement: when evidence and misfits become a verdict."""

from dataclasses import dataclass


@dataclass(frozen=True)
class JudgementSettings:
    """How evidence and misfits become a verdict, and what of it is worth words.

    Attributes
    ----------
    sure : float, deviations
        Deviations that a size has to differ from zero by: one in twenty is farther off by chance.
    uncertain : float, deviations
        Deviations by which uncertain parameters may put held-out recordings off.
    clear : float, deviations
        Deviations beyond which frequency or damping differs: one in 400 by chance.
    alike : float, natural logarithm
        Evidences closer than this cannot be told apart: odds of 20 to 1, from
        which on Kass & Raftery (1995) call evidence strong.
    likely, excluded : float, probability
        Probability from which on an explanation is mentioned, and below which it is excluded.
    unexplained : float, ratio
        Error of fitted recordings over the noise's from which on something is left unexplained.
    unforeseen : float, ratio
        Error of held-out recordings over what noise and uncertain parameters account for, from
        which on the report mentions it.
    often : float, ratio
        What noise exceeds in one case of twenty over what it leaves, from which on the report names
        both.
    listed : int
        Rivals that a summary lists.
    neighbour : float, share
        Share of a misfit at which a law is as likely a neighbour of the truth as the truth itself.
        Over Gaussian motion the best v|v| leaves 0.31 of v^3, 0.16 with a damper beside it, and a
        damper alone 0.39 of v|v|; a cubic spring in a circuit whose damping is known to 3 % leaves
        0.09 (Silverbox: 0.10 of what is fitted, 0.06 of what is held out), drag for cubic damping
        0.12 (notebook 06). Half of it takes the spring for unknown, double of it drag for cubic
        damping.
    sharpness : float, power
        Power of that share in the odds: a choice that no data made.
    more_there : float, share
        Share of the noise's square that other laws at a name's place have to take off what it
        leaves for a general law to be tried there as well. Of 28 right names on the chain of three
        25 take 0.003 and less, three sliders in coarse steps 0.008 to 0.02; of five gaps in which
        something rubs, named as both, 0.001 to 0.035; of an Iwan joint that was called a spring
        0.10, a spring and a slider 0.05. Half of it costs a search beside some sliders, double of
        it loses the latter.
    """

    sure: float = 2.0
    uncertain: float = 2.0
    clear: float = 3.0
    alike: float = 3.0
    likely: float = 0.05
    excluded: float = 1e-3
    unexplained: float = 1.25
    unforeseen: float = 1.5
    often: float = 1.15
    listed: int = 6
    neighbour: float = 0.1
    sharpness: float = 4.0
    more_there: float = 0.03
