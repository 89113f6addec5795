"""The single-mode assumption: what a modal joint model misses when several modes move."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from iwanjax.dynamics.decays import ModalDecays
from iwanjax.quasistatic import ModalOscillator, coupled_modes, qsma
from iwanjax.results import AbstractResult
from iwanjax.signals.hilbert import RingDown

# Loads and points of a curve, and how far the loads reach beyond what the largest amplitude needs.
_LOADS, _POINTS, _MARGIN = 200, 200, 3.0


@dataclass(frozen=True, eq=False)
class ModeComparison(AbstractResult):
    """One mode of one decay beside two models: result of :func:`iwanjax.compare_modes`.

    Attributes
    ----------
    case, mode : int
        Which decay, and which elastic mode.
    time : (levels,) array
        s.
    amplitude : (levels,) array
        Modal displacement of the mode itself.
    measured, single, coupled : (levels, 2) array
        Frequency, Hz, and damping: of the decay, of the mode as if it were alone, and with
        the other modes' amplitudes taken into account.
    share : (levels, joints) array
        The mode's part of the joints' strokes.
    alone : (3, points) array
        Amplitude, frequency and damping of the mode alone over all decays that were
        compared, for drawing.
    """

    case: int
    mode: int
    time: Float[np.ndarray, " levels"] = field(repr=False)
    amplitude: Float[np.ndarray, " levels"] = field(repr=False)
    measured: Float[np.ndarray, "levels 2"] = field(repr=False)
    single: Float[np.ndarray, "levels 2"] = field(repr=False)
    coupled: Float[np.ndarray, "levels 2"] = field(repr=False)
    share: Float[np.ndarray, "levels joints"] = field(repr=False)
    alone: Float[np.ndarray, "3 points"] = field(repr=False)

    _shown = ("case", "mode", "time", "amplitude", "single_error", "coupled_error", "share")

    @property
    def single_error(self) -> Float[np.ndarray, "levels 2"]:
        """Relative error of the single-mode model's frequency and damping."""
        return self.single / self.measured - 1.0

    @property
    def coupled_error(self) -> Float[np.ndarray, "levels 2"]:
        """The same of the coupled prediction."""
        return self.coupled / self.measured - 1.0

    def statement(self) -> str:
        """The comparison in a sentence."""
        single, coupled = (
            100.0 * np.median(np.abs(error[:, 1]))
            for error in (self.single_error, self.coupled_error)
        )
        least = 100.0 * float(np.min(self.share))
        return (
            f"mode {self.mode}, decay {self.case}: taken alone its damping is off by "
            f"{single:.2g} % (median), with the other modes' motion by {coupled:.2g} %; its "
            f"smallest share of a joint's stroke is {least:.2g} %"
        )


def compare_modes(
    decays: ModalDecays,
    single: Mapping[int, ModalOscillator] | None = None,
    *,
    cycles: int = 40,
) -> tuple[ModeComparison, ...]:
    """Hold the decays of a structure's modes against single-mode and coupled predictions.

    The modal Iwan model takes a joint to be moved by one mode alone; a hit at a point moves
    it by all at once (thesis Sec. 2.3.1, Eq. 2.30), so that in microslip damping is
    underestimated, in macroslip overestimated. The coupled prediction takes the amplitudes
    that the other modes have at the same time from the decays.

    Parameters
    ----------
    decays : ModalDecays
        Of :func:`~iwanjax.modal_decays`.
    single : mapping of int to ModalOscillator, optional
        Fitted model of each mode; by default quasi-static modal analysis of the structure.
    cycles : int
        As for :func:`~iwanjax.coupled_modes`.

    Returns
    -------
    tuple of ModeComparison
        For each decay and mode that could be analysed.

    Raises
    ------
    InputError
        As :func:`~iwanjax.coupled_modes` and :func:`~iwanjax.qsma`.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> from iwanjax.dynamics import half_sine
    >>> chain, dt = ij.three_mass(zeta=2e-3), 0.2
    >>> push = half_sine(dt * np.arange(8000), 1.0, 0.5)[:, None]  # on the third mass
    >>> modes = ij.compare_modes(ij.modal_decays(chain, push, dt, inputs=[[0, 0, 1]]))
    >>> [each.mode for each in modes]
    [0, 1, 2]
    >>> all(np.abs(each.coupled_error[:, 0]).max() < 2e-4 for each in modes)  # of frequencies
    True
    """
    places = [
        (case, i, each)
        for i in range(len(decays.modes))
        for case, row in enumerate(decays.ringdowns)
        if (each := row[i]) is not None
    ]
    if not places:
        return ()
    amplitudes = [_amplitudes(decays, *place) for place in places]
    together = coupled_modes(
        decays.structure, np.concatenate(amplitudes), modes=decays.modes, cycles=cycles
    )
    alone = {
        i: _alone(decays, i, (single or {}).get(decays.modes[i])) for i in {i for _, i, _ in places}
    }
    ends = np.cumsum([each.shape[0] for each in amplitudes])
    found = []
    for (case, i, each), amplitude, end in zip(places, amplitudes, ends, strict=True):
        model, drawn = alone[i]
        q, rows = amplitude[:, i], slice(end - amplitude.shape[0], end)
        found.append(
            ModeComparison(
                case,
                decays.modes[i],
                each.time,
                q,
                np.stack([each.curves.frequency, each.curves.damping], axis=1),
                np.stack(model.frequency_and_damping(q), axis=1),
                np.stack([together.frequency[rows, i], together.damping[rows, i]], axis=1),
                np.asarray(together.share[rows, i]),
                drawn,
            )
        )
    return tuple(found)


def _amplitudes(decays: ModalDecays, case: int, i: int, each: RingDown) -> np.ndarray:
    """All modes' amplitudes at the levels of one mode's decay, (levels, modes)."""
    rows = [np.interp(each.time, decays.time, row) for row in decays.envelope[case].T]
    rows[i] = np.asarray(each.curves.as_quantity("displacement").amplitude)
    return np.stack(rows, axis=1)


def _alone(
    decays: ModalDecays, i: int, given: ModalOscillator | None
) -> tuple["ModalOscillator | _Curve", np.ndarray]:
    """The model of one mode alone, and its curves over all amplitudes that were measured."""
    several = [row[i] for row in decays.ringdowns]
    q = np.concatenate(
        [each.curves.as_quantity("displacement").amplitude for each in several if each is not None]
    )
    model = _quasi_static(decays, decays.modes[i], q) if given is None else given
    grid = np.geomspace(q.min(), q.max(), _POINTS)
    return model, np.stack([grid, *map(np.asarray, model.frequency_and_damping(grid))])


class _Curve:
    """Frequency and damping of a quasi-static analysis at any amplitude within it."""

    def __init__(self, q: np.ndarray, frequency: np.ndarray, damping: np.ndarray):
        self.log_q, self.frequency, self.log_damping = np.log(q), frequency, np.log(damping)

    def frequency_and_damping(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = np.log(q)
        damping = np.exp(np.interp(x, self.log_q, self.log_damping))
        return np.interp(x, self.log_q, self.frequency), damping


def _quasi_static(decays: ModalDecays, mode: int, q: np.ndarray) -> _Curve:
    omega2 = float(decays.structure.basis.omega2[mode])
    alpha = omega2 * np.geomspace(q.min() / _MARGIN, q.max() * _MARGIN, _LOADS)
    found = qsma(decays.structure, mode, alpha, frequency="first_harmonic", deflections=False)
    solved = np.asarray(found.converged)
    curves = (found.q, found.curves.frequency, found.curves.damping)
    return _Curve(*(np.asarray(x)[solved] for x in curves))
