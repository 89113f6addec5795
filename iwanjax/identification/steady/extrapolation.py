"""How far curves of a mode carry beyond the amplitudes that were fitted."""

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.effects.kinds import JointKind
from iwanjax.estimation.evidence import log_evidence
from iwanjax.estimation.least_squares import least_squares
from iwanjax.estimation.problem import residuals_and_slopes, residuals_and_slopes_in_variables
from iwanjax.identification.steady.curves import ModeFit
from iwanjax.identification.steady.fit import SteadyFit
from iwanjax.joints.iwan import IWAN_PARAMETERS, phi_max_of
from iwanjax.settings.stages import settings
from iwanjax.updating.microslip import IwanPlace, alike_in_microslip
from iwanjax.updating.modal import ModalIwanProblem

_MACROSLIP = ("F_S", "beta")


def without_needless_macroslip(fit: ModeFit) -> ModeFit:
    r"""A fit with its Iwan joint in microslip, where macroslip explains no more than chance.

    A search ends on a kink that noise has made at the last levels as well as on the plain beyond
    it, and the two part where nothing was measured. In microslip only chi and
    :math:`R/(\chi+1)` are known of a joint: two values fewer are adjusted, and of fits the one of
    larger evidence is kept.

    Parameters
    ----------
    fit : SteadyFit
        To curves of a mode; those with other joints come back as they are.

    Returns
    -------
    SteadyFit
        Of those that the curves cannot tell from it the middle one, the others in ``alike``.
    """
    for place in _places(fit):
        fit = _without_needless_macroslip(fit, place)
    return fit


def _places(fit: ModeFit) -> list[IwanPlace]:
    """Iwan joints of the mode's own and left out of it."""
    problem, found = fit.problem, []
    if isinstance(problem.base, ModalIwanProblem):
        found += problem.base.iwan_places(jnp.asarray(fit.theta[: len(problem.base.names)]))
    if fit.effect is not None and isinstance(fit.effect.kind, JointKind):
        names = [info.name for info in IWAN_PARAMETERS]
        positions = dict(zip(names, map(int, problem.places), strict=False))
        found.append(IwanPlace("", positions, float(jnp.max(problem.measured.q))))
    return found


def _without_needless_macroslip(fit: ModeFit, place: IwanPlace) -> ModeFit:
    """The same of one joint."""
    begin = _in_microslip(fit, fit.theta, place)
    if not begin:
        return fit
    known = settings().steady
    starts = np.stack(begin)[np.arange(known.starts) % len(begin)]
    found = least_squares(fit.problem, jnp.asarray(starts), known.runs)
    ends = [each for each in found if np.isfinite(each.cost) and _sticks(each.values, place)]
    if not ends:
        return fit
    end = min(ends, key=lambda each: each.cost)
    idle = (*fit.idle, *(place.positions[name] for name in _MACROSLIP))
    stuck = SteadyFit(fit.effect, fit.problem, end.values, end.cost, end.cost, idle)
    first = min(fit.cost, stuck.cost)
    values = log_evidence(
        (fit.cost, stuck.cost),
        (fit.unknowns, stuck.unknowns),
        fit.count,
        max(1.0, first / fit.count),
        stuck.correlation(),
    )
    if values[1] < values[0]:
        return fit
    family = [
        each
        for each in _in_microslip(fit, end.values, place)
        if np.all(np.isfinite(residuals_and_slopes(fit.problem, jnp.asarray(each))[0]))
    ]
    if not family:
        return stuck
    middle = len(family) // 2
    return replace(stuck, theta=family.pop(middle), alike=(*fit.alike, *family))


def _in_microslip(fit: ModeFit, theta: np.ndarray, place: IwanPlace) -> list[np.ndarray]:
    """Joints of other strength with the same microslip, the weakest first."""
    own = {name: float(theta[i]) for name, i in place.positions.items()}
    found = []
    oscillator = fit.problem.base.model(jnp.asarray(theta[: -fit.problem.beside.count]))
    stiffest = float(oscillator.K_inf)
    if place.positions["K_T"] < fit.problem.places[0]:
        stiffest += own["K_T"]
    for joint in alike_in_microslip(**own, reach=place.reach, stiffest=stiffest):
        moved = theta.copy()
        for name, i in place.positions.items():
            moved[i] = joint[name]
        found.append(moved)
    return found


def _sticks(theta: np.ndarray, place: IwanPlace) -> bool:
    """Whether a joint stays below macroslip at all measured amplitudes."""
    values = {name: jnp.asarray(theta[i]) for name, i in place.positions.items()}
    return float(phi_max_of(**values)) > place.reach


def spread(fit: ModeFit, measured: Sequence[ModalCurves]) -> tuple[ModalCurves, ...]:
    r"""By how much predictions move within what the fitted levels leave open of the parameters.

    With :math:`C = (J^TJ/s^2 + \sigma_0^{-2} I)^{-1}` the covariance of the variables that are
    searched and of the logarithm of the effect's shape, :math:`s^2` the misfit where it exceeds
    one, and :math:`\lambda_k v_k` its eigenvalues and vectors, half of what predictions
    differ by between :math:`\pm\sqrt{\lambda_k}\, v_k`, all k together; and joints that the
    levels cannot tell from the one taken, as they are.

    Parameters
    ----------
    fit : SteadyFit
        To curves of a mode.
    measured : sequence of ModalCurves
        In the order of the fit.

    Returns
    -------
    tuple of ModalCurves
        At the measured amplitudes, the spreads as deviations.
    """
    problem, effect = fit.problem, fit.effect
    z = np.asarray(problem.to_variables(jnp.asarray(fit.theta)))
    _, slopes = residuals_and_slopes_in_variables(problem, jnp.asarray(z))
    J = np.asarray(slopes)
    if effect is None:
        J = J[:, : -problem.beside.count]
    shaped = effect is not None and effect.shape_info is not None
    if shaped:
        J = np.column_stack([J, fit.by_shape()])

    def at(step: np.ndarray) -> np.ndarray:
        moved, factor = z.copy(), 1.0
        own = step[:-1] if shaped else step
        moved[: len(own)] += own
        if shaped:
            factor = float(np.exp(step[-1]))
        there = np.asarray(problem.to_values(jnp.asarray(moved)))
        return _predicted(replace(fit, theta=there), factor, measured)

    middle = _predicted(fit, 1.0, measured)
    square = np.zeros_like(middle)
    for step in _axes(J, fit):
        up, down = (np.where(np.isfinite(x), x, middle) for x in (at(step), at(-step)))
        square += (0.5 * (up - down)) ** 2
    others = [_predicted(replace(fit, theta=each), 1.0, measured) for each in fit.alike]
    if others:
        square += np.mean([(each - middle) ** 2 for each in others], axis=0)
    ends = np.cumsum([each.amplitude.size for each in measured])[:-1]
    return tuple(
        _deviating(seen, *each)
        for seen, each in zip(measured, np.split(np.sqrt(square), ends, axis=1), strict=True)
    )


def _axes(J: np.ndarray, fit: ModeFit) -> list[np.ndarray]:
    """Principal axes of the covariance, one deviation long, of what the levels depend on."""
    known = settings().steady
    sizes = np.linalg.norm(J, axis=0)
    used = sizes > known.negligible * sizes.max()
    tau = max(1.0, fit.correlation())
    left = fit.left / max(tau, fit.count - tau * int(used.sum()))
    precision = J[:, used].T @ J[:, used] / (max(1.0, left) * tau)
    precision += np.eye(int(used.sum())) / known.wide**2
    values, vectors = np.linalg.eigh(precision)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        step = np.zeros(len(sizes))
        step[used] = vector / np.sqrt(value)
        found.append(step)
    return found


def _predicted(fit: ModeFit, factor: float, measured: Sequence[ModalCurves]) -> np.ndarray:
    """Frequency and damping of all curves with another shape, (2, levels)."""
    effect = fit.effect
    if effect is not None and factor != 1.0:
        fit = replace(fit, effect=effect._replace(shape=effect.shape * factor))
    rows = [(each.frequency, each.damping) for each in fit.predicted(measured)]
    return np.concatenate([np.stack([np.asarray(x) for x in row]) for row in rows], axis=1)


def _deviating(seen: ModalCurves, f: np.ndarray, zeta: np.ndarray) -> ModalCurves:
    """A curve with other deviations."""
    return ModalCurves(
        seen.amplitude,
        seen.frequency,
        seen.damping,
        frequency_std=f,
        damping_std=zeta,
        quantity=seen.quantity,
        unit=seen.unit,
        name=seen.name,
    )
