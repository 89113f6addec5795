"""Tuned numbers of how recordings are made ready to be compared."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ConditioningSettings:
    """How recordings are made ready to be compared.

    Attributes
    ----------
    pulse_noise : float, deviations
        Standard deviations of its noise that a force exceeds in a pulse.
    pulse_peak : float
        Share of its peak that it exceeds there.
    beside : int, samples
        Samples beside that which belong to a pulse.
    ringing : int, samples
        The same where modes lie so high that what a recorder's filter makes ring beside a pulse
        moves them, though these samples bring noise with them.
    high : float
        Share of the sampling rate above which a mode lies so high.
    fewest : int, samples
        Samples of a pulse: a shorter burst is noise.
    endless : float
        Share of its peak by which the last quarter of a force scatters that never ends.
    cut_off : float
        Scatter of a force beyond its pulses, by nine of ten samples, over that of its last quarter,
        above which they are not all of it: 1 for noise.
    enough : int, samples
        Samples before the first force that a sensor's noise is measured on.
    spoilt : int, samples
        Samples beside those that a sensor's own filter may spoil.
    model_error : float
        Share of a channel's root mean square that a model may be off by and still be right.
    force_error : float
        Share of a force's peak that its samples may be off by while it acts.
    force_parts : int
        Parts of a step between samples that a force is followed in.
    force_draws : int
        Realisations of the noise of forces that act throughout, by which its effect is estimated:
        of one mode that hardly decays within a recording, two squares, its mean square is then
        known to 1/sqrt(8) = 35 %, of one that decays ten times to 11 %.
    tail : int, samples
        Samples beside a pulse over which what is between them dies away.
    directions : int
        Directions in which the state after a pulse is uncertain.
    noise_bands, noise_values : int
        Bands up to the highest frequency that is compared, at most, and degrees of freedom of the
        noise in each, at least: its variance is then known to sqrt(2/50) = 20 %.
    flat : float
        Times the variance of quieter bands that noise may have in another quiet one: 3 dB. Of the
        laboratory's white noise 95 of a hundred are then at most 1.30 times too high; with half of
        it 1.22 times, with twice 1.63 times, and noise that is half pink 0.78 to 0.82 of it.
    lags : int
        Samples of the past by which a linear predictor foretells the next: two for each mode at
        least, and the more the less white noise in them leaves uncertain (at 20 its one-step error
        is 1.02 to 1.16 of the noise, at 40 1.00 to 1.07).
    coloured : float
        Root mean square of all that shows without motion over that in quiet bands, up to which it
        is noise: sensors' own noise rises towards low frequencies.
    repeats : float
        Change of a force from period to period, as share of it, that is noise.
    other_noise : float
        Largest over smallest variance of a sensor's noise, beyond which its recordings differ: with
        five of 20 samples each one in a hundred does by chance (Hartley's test).
    back_time_constant : float, cycles
        Of the observer that tells a motion from the recording: the data, not the model,
        say what happened.
    back_cycles : float, cycles
        Cycles of the slowest mode that it sees of a free decay.
    state_error, least_state_error : float
        Share of its amplitude that each mode's state at the beginning may be off by, and of the
        fastest one's rate.
    """

    pulse_noise: float = 6.0
    pulse_peak: float = 1e-3
    beside: int = 3
    ringing: int = 16
    high: float = 0.2
    fewest: int = 2
    endless: float = 0.05
    cut_off: float = 1.5
    enough: int = 20
    spoilt: int = 8
    model_error: float = 0.002
    force_error: float = 0.01
    force_parts: int = 4
    force_draws: int = 8
    tail: int = 16
    directions: int = 6
    noise_bands: int = 20
    noise_values: int = 50
    flat: float = 2.0
    lags: int = 40
    coloured: float = 3.0
    repeats: float = 0.1
    other_noise: float = 4.6
    back_time_constant: float = 1.0
    back_cycles: float = 6.0
    state_error: float = 0.3
    least_state_error: float = 0.02

    @property
    def least(self) -> int:
        """Samples that a recording needs."""
        return self.enough + 2 * self.spoilt


CONDITIONING = ConditioningSettings()
"""As diagnoses are made."""
