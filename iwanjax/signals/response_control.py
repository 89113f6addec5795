"""Frequency and damping from steady vibration at held response: no model, no ring-down."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from iwanjax.correlation import correlation_time
from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.signals.stepped_sine import SteppedSine, stepped_sine
from iwanjax.types import ArrayLike

_FEWEST_FREQUENCIES = 4
# Between levels closer than this there is no slope to be had.
_SAME = 0.01
# Each takes the amplitude at resonance, the slope between levels and the other modes'
# flexibility from the one before; what is wrong shrinks by the slope, a tenth or so.
_ROUNDS = 12
# Parameters of a level: k, m, h and its slope.
_OF_A_LEVEL = 4
# Deviations by which that flexibility has to differ from zero: one in 400 does by chance.
_CLEAR = 3.0


@dataclass(frozen=True, eq=False)
class ControlledResonance(AbstractResult):
    """Result of :func:`controlled_resonance`.

    Attributes
    ----------
    curves : ModalCurves
        Frequency and damping of each level, in rising order.
    mass : (levels,) array
        What each level's own slope says of the modal mass, force over acceleration; one number,
        were the mode the same throughout a sweep.
    flexibility : float
        What all other modes add to the mode's own, displacement over force; zero where the
        points do not show it.
    drift : float
        Hz by which the mode moves while a level is measured, by the scatter of ``mass``; NaN for a
        single level.
    """

    curves: ModalCurves
    mass: np.ndarray
    flexibility: float
    drift: float

    _units: ClassVar = {"drift": "Hz"}


class _Resonance(NamedTuple):
    """What a level's points say.

    Attributes
    ----------
    omega, mass, loss : float
        Of the resonance, rad/s; m; and h there.
    omega_std, mass_std, loss_std : float
        Deviations, from the scatter about the fit.
    displacement, response : float
        Amplitudes there, of the mode's own displacement and of what was measured.
    band : float
        Of the sweep: what omega^2 differs by from end to end, over that of the resonance.
    left, other : (2, points) array
        Dynamic stiffness less the fit, in phase and in quadrature, and what a unit of flexibility
        more would add to that.
    """

    omega: float
    mass: float
    loss: float
    omega_std: float
    mass_std: float
    loss_std: float
    displacement: float
    response: float
    band: float
    left: np.ndarray
    other: np.ndarray


class _Sweeps(NamedTuple):
    """All levels, with one flexibility."""

    flexibility: float
    levels: tuple[_Resonance, ...]

    @property
    def square(self) -> float:
        """What the fits leave."""
        return float(sum(np.sum(each.left**2) for each in self.levels))

    @property
    def step(self) -> float:
        """What the flexibility is off by, to first order."""
        along = sum(np.sum(each.left * each.other) for each in self.levels)
        size = sum(np.sum(each.other**2) for each in self.levels)
        return -float(along / size) if size > 0.0 else 0.0


def resonance_from_control(
    level: ArrayLike,
    frequency: ArrayLike,
    force: ArrayLike,
    response: ArrayLike,
    phase: ArrayLike,
    *,
    quantity: str = "acceleration",
    unit: str = "",
    name: str = "",
) -> ModalCurves:
    """The curves of :func:`controlled_resonance`, which says what the arguments are.

    Returns
    -------
    ModalCurves
        Against the response of each level at its resonance, in rising order, with deviations.

    Raises
    ------
    InputError
        As :func:`controlled_resonance`.
    """
    return controlled_resonance(
        level, frequency, force, response, phase, quantity=quantity, unit=unit, name=name
    ).curves


def controlled_resonance(
    level: ArrayLike,
    frequency: ArrayLike,
    force: ArrayLike,
    response: ArrayLike,
    phase: ArrayLike,
    *,
    quantity: str = "acceleration",
    unit: str = "",
    name: str = "",
) -> ControlledResonance:
    r"""Amplitude-dependent frequency and damping from stepped sines under response control.

    At one amplitude a nonlinear mode is a linear one. Other modes add a flexibility R to what a
    sensor shows, the same at all levels, so that the mode's own displacement is
    :math:`q = U - R F`. Its dynamic stiffness :math:`Z = F/q` is fitted level by level about the
    resonance:

    .. math:: \mathrm{Re}\,Z = k - m\omega^2, \qquad
              \mathrm{Im}\,Z = h + h'\left(\frac{\omega}{\omega_r} - 1\right), \qquad
              \omega_r = \sqrt{k/m}, \qquad \zeta = \frac{h}{2\bar m\omega_r^2}

    While the p-th derivative of U is held over a sweep, p = 2 for the acceleration, the mode's
    displacement changes and the stiffness with it: k is taken to vary as :math:`|q|^s`, with
    s from the frequencies of neighbouring levels. For a single level s is taken to be zero
    and its damping comes out divided by 1 + ps/2.

    R is what leaves the least squared residual of all levels, and zero where the points do not
    show it. The modal mass :math:`\bar m` is one number, the mean of the levels'. What these
    scatter by beyond their own deviations is that the mode drifts while it is measured: a
    stiffness that changes evenly over a sweep from :math:`\omega_1` to :math:`\omega_2` passes for
    mass, so that

    .. math:: \Delta f = \frac{f}{2}\,\frac{\sigma_m}{\bar m}\,
              \frac{\omega_2^2 - \omega_1^2}{\omega_r^2}

    Parameters
    ----------
    level : array_like
        Label of the level that each point belongs to; arrays broadcast against each other.
    frequency : array_like
        Hz, at least 4 different ones for each level, on both sides of its resonance.
    force, response : array_like
        Amplitudes of the fundamental, positive.
    phase : array_like
        Of the response's fundamental ahead of the force, rad.
    quantity : {"acceleration", "velocity", "displacement"}
        What the response is.
    unit, name : str
        Labels of the curves.

    Returns
    -------
    ControlledResonance
        Its curves are against the response of each level at its resonance. Their deviations are
        those of the fits, whose neighbouring residuals may be alike, and hold the drift: what the
        level would differ by if it were measured again.

    Raises
    ------
    InputError
        For arrays that do not broadcast or are not positive, levels with too few points,
        those whose resonance was not passed, and different levels of one amplitude.
    """
    points = stepped_sine(level, frequency, force, response, phase, quantity)
    labels = points.level
    found = [(float(np.mean(points.response[labels == each])), each) for each in np.unique(labels)]
    amplitude = np.array([mean for mean, _ in sorted(found)])
    levels = []
    for _, label in sorted(found):
        here = points.of(labels == label)
        different = np.unique(here.omega).size
        if different < _FEWEST_FREQUENCIES:
            raise InputError(
                f"level {label:g} has {different} different frequencies; expected at least "
                f"{_FEWEST_FREQUENCIES}"
            )
        levels.append(here)
    close = np.flatnonzero(np.diff(amplitude) < _SAME * amplitude[1:])
    if close.size:
        one, other = levels[close[0]].name, levels[close[0] + 1].name
        raise InputError(
            f"{one} and {other} differ by less than {100 * _SAME:g} % in amplitude; label their "
            "points as one level"
        )
    alone, beside = (_sweeps(levels, among_others) for among_others in (False, True))
    chosen = beside if _clear(alone, beside) else alone
    omega, mass, loss, omega_std, mass_std, loss_std = np.array(
        [each[:6] for each in chosen.levels]
    ).T
    common = float(np.mean(mass))
    scatter = math.nan
    if mass.size > 1:
        scatter = math.sqrt(max(0.0, float(np.var(mass, ddof=1) - np.mean(mass_std**2))))
    band = np.array([each.band for each in chosen.levels])
    f = omega / (2.0 * np.pi)
    moved = 0.5 * f * band * scatter / common
    drift = float(np.sqrt(np.mean(moved**2)))
    zeta = 0.5 * loss / (common * omega**2)
    mean_std = np.sqrt(np.mean(mass_std**2) + np.nan_to_num(scatter) ** 2) / math.sqrt(mass.size)
    curves = ModalCurves(
        [each.response for each in chosen.levels],
        f,
        zeta,
        frequency_std=np.hypot(omega_std / (2.0 * np.pi), np.nan_to_num(moved)),
        damping_std=zeta * np.hypot(loss_std / loss, mean_std / common),
        quantity=quantity,
        unit=unit,
        name=name,
    )
    return ControlledResonance(curves, mass, chosen.flexibility, drift)


def _sweeps(levels: Sequence[SteppedSine], among_others: bool) -> _Sweeps:
    """All levels, with the slopes between them and, among other modes, their flexibility."""
    flexibility, slope = 0.0, np.zeros(len(levels))
    found = _Sweeps(flexibility, tuple(_resonance(each, 0.0) for each in levels))
    for _ in range(_ROUNDS):
        if len(levels) > 1:
            amplitude = np.log([each.displacement for each in found.levels])
            slope = np.gradient(2.0 * np.log([each.omega for each in found.levels]), amplitude)
        if among_others:
            flexibility += found.step
        own = [each.of_one_mode(flexibility) for each in levels]
        rows = tuple(_resonance(each, s) for each, s in zip(own, slope, strict=True))
        found = _Sweeps(flexibility, rows)
    return found


def _clear(alone: _Sweeps, beside: _Sweeps) -> bool:
    """Whether the other modes' flexibility shows."""
    count = sum(each.left.size for each in beside.levels)
    free = count - _OF_A_LEVEL * len(beside.levels) - 1
    if free < 1:
        return False
    tau = float(np.mean([correlation_time(each.left.T[None]) for each in beside.levels]))
    return alone.square - beside.square > _CLEAR**2 * tau * beside.square / free


def _resonance(level: SteppedSine, exponent: float) -> _Resonance:
    """Of one level, with its stiffness varying as the displacement to the exponent."""
    before = 0.5 * (level.omega[0] + level.omega[-1])
    for _ in range(_ROUNDS):
        before = _inphase(level, exponent, before)[2]
    k, m, omega_r, columns, left = _inphase(level, exponent, before)
    units = np.array([1.0, before**-2])
    covariance = _covariance(columns, left) * np.outer(units, units)
    slanted = np.stack([np.ones_like(level.omega), level.omega / omega_r - 1.0], axis=1)
    (h, _), lost = _least_squares(slanted, level.quadrature)
    spread = _covariance(slanted, lost)
    share = np.array([1.0 / k, -1.0 / m])
    logs = np.log(level.omega)
    displacement, response = (
        float(np.exp(np.interp(np.log(omega_r), logs, np.log(each))))
        for each in (level.displacement, level.response)
    )
    other = level.dynamic**2
    return _Resonance(
        omega=omega_r,
        mass=m,
        loss=h,
        omega_std=0.5 * omega_r * float(np.sqrt(share @ covariance @ share)),
        mass_std=float(np.sqrt(covariance[1, 1])),
        loss_std=float(np.sqrt(spread[0, 0])),
        displacement=displacement,
        response=response,
        band=float(level.omega[-1] ** 2 - level.omega[0] ** 2) / omega_r**2,
        left=np.stack([level.inphase - columns @ [k, m * omega_r**2], lost]),
        other=np.stack(
            [_least_squares(columns, np.real(other))[1], _least_squares(slanted, np.imag(other))[1]]
        ),
    )


def _inphase(
    level: SteppedSine, exponent: float, omega_r: float
) -> tuple[float, float, float, np.ndarray, np.ndarray]:
    """Stiffness at the displacement that goes with omega_r, mass, the resonance that follows.

    The columns that they are fitted by, the mass as that times omega_r^2, and what they leave.
    """
    lowest, highest = level.omega[0], level.omega[-1]
    logs = np.log(level.omega), np.log(level.displacement)
    there = np.exp(np.interp(np.log(omega_r), *logs))
    # Columns of one size: the mass times omega_r^2 is about the stiffness.
    columns = np.stack(
        [(level.displacement / there) ** exponent, -((level.omega / omega_r) ** 2)], axis=1
    )
    (k, inertia), left = _least_squares(columns, level.inphase)
    if k <= 0.0 or inertia <= 0.0:
        raise InputError(
            f"{level.name}: the in-phase dynamic stiffness does not fall with frequency; phase "
            "must be that of the response ahead of the force, in rad"
        )
    found = omega_r * np.sqrt(k / inertia)
    if not lowest <= found <= highest:
        raise InputError(
            f"{level.name}: the resonance, at {found / (2 * np.pi):.6g} Hz, lies outside the "
            f"measured {lowest / (2 * np.pi):.6g} to {highest / (2 * np.pi):.6g} Hz"
        )
    return k, inertia / omega_r**2, found, columns, left


def _least_squares(columns: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two coefficients, and what they leave."""
    found, *_ = np.linalg.lstsq(columns, right, rcond=None)
    return found, right - columns @ found


def _covariance(columns: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Of two coefficients, by what they leave."""
    # Residuals that are alike from point to point are so many fewer.
    tau = correlation_time(left[None, :, None])
    variance = tau * np.sum(left**2) / (left.size - 2)
    return variance * np.linalg.inv(columns.T @ columns)
