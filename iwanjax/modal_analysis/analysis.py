"""From recordings to modes: poles of rising order, then a fit of real modes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Chart
from iwanjax.files import nearest
from iwanjax.modal_analysis.modal_model import FittedModes, ModalModel, fitted
from iwanjax.modal_analysis.poles import MOST_DAMPING, Stabilisation, clustered, poles_by_order
from iwanjax.modal_analysis.result import ModalTest
from iwanjax.modal_analysis.start import linear_start, residual_modes
from iwanjax.signals.frf import Estimator, FrequencyResponses, frequency_responses
from iwanjax.signals.recording import Recording
from iwanjax.signals.spectral_samples import Excitation
from iwanjax.threads import one_thread
from iwanjax.types import require_double_precision

# Order of the largest model, and orders of the stabilisation chart: several times the modes of any
# band that one test tells apart.
_HIGHEST, _CHART = 40, 20
# A mode shows in a third of the orders at least: weak ones come late.
_ORDERS = 3
# The upper residual term is of a mode at twice the band's upper end: far enough to be smooth
# within, near enough not to shorten the time steps of a simulation.
_BEYOND = 2.0
# The lower one is of a mode at this share of the lower end: within the band a mass, to a quarter
# of a percent, and yet a structure that floats has stiffness.
_LOWEST = 0.05
# Lines either side over which scatter and misfit are averaged: 11 complex values tell a deviation
# to 15 %.
_NEIGHBOURS = 5
# Fits, each weighted by what the last one has left.
_ROUNDS = 3
# Deviations that a shape at the driving points is off zero, where a mode's mass is told by it.
_SEEN = 3.0
# Values that a fit is made of: more make it slower, not better.
_MOST_VALUES = 6000


@one_thread()
def modal_test(
    recordings: Sequence[Recording] | Recording,
    band: tuple[float, float] | None = None,
    *,
    order: int | Literal["auto"] = "auto",
    driving_points: Mapping[str, str] | None = None,
    estimator: Estimator = "H1",
    excitation: Excitation = "auto",
    period: float | None = None,
    block: float | None = None,
    window: float | None = None,
) -> ModalTest:
    r"""Modes of a structure by its frequency response functions, or by free decays.

    Poles that come back in models of rising order (p-LSCF) start a fit of real modes with lower
    and upper residual terms,

    .. math::
        H_{si}(\omega) = (i\omega)^{p_s} \sum_r \frac{\phi_{sr}\phi_{ir}}
        {\omega_r^2 - \omega^2 + 2 i \zeta_r \omega_r \omega}

    to the functions, weighted by their scatter, or by what the modes leave at neighbouring lines
    where that is more: a structure that is not linear has more than its scatter shows.

    Parameters
    ----------
    recordings : sequence of Recording, or a single one
        Hits from rest, steady states of periodic forces, stationary noise, or free decays; of one
        kind, with the same sensors. At low amplitude: nothing else is linear.
    band : (f_1, f_2), optional
        Hz; by default where forces (of decays the responses) have energy.
    order : int or "auto"
        Of the largest model's denominator; 40 where the lines suffice.
    driving_points : mapping of str to str, optional
        For an input the sensor at its place, in its direction: their shapes are the same, which
        scales all. By default a sensor of the same name.
    estimator : {"H1", "H2", "Hv"}
        Of the functions.
    excitation, period, block, window
        As for :func:`iwanjax.signals.spectral_samples.spectral_samples`; by default what the
        recordings show.

    Returns
    -------
    ModalTest
        With ``model()``, the linear structure, and ``plot()``.

    Raises
    ------
    InputError
        For recordings that do not belong together, unknown sensors, and no mode in the band.

    References
    ----------
    Guillaume et al., IMAC 21 (2003); Ewins, Modal Testing, 2nd ed., 2000, ch. 4.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(4096) / 512
    >>> decay = np.exp(-t) * np.cos(2 * np.pi * 40 * t)
    >>> hit = ij.as_recording(decay, sampling_rate=512, quantity="velocity", sensors="tip")
    >>> test = ij.modal_test(hit, band=(20, 80))
    >>> print(f"{test.frequency[0]:.2f} Hz, {100 * test.damping[0]:.3f} %")
    40.00 Hz, 0.398 %
    """
    require_double_precision("modal_test")
    responses = frequency_responses(
        recordings,
        band,
        estimator=estimator,
        excitation=excitation,
        period=period,
        block=block,
        window=window,
    )
    sites = _sites(responses, driving_points or {})
    poles, stabilisation = _poles(responses, order)
    if not len(poles):
        raise InputError(
            f"no pole between {responses.frequency[0]:g} and {responses.frequency[-1]:g} Hz comes "
            "back from order to order; is there a mode in the band? widen it, raise order, or use "
            "longer or less noisy recordings"
        )
    end, deviation, which, said = _fit(responses, poles, sites)
    own = _in_band(responses, end)
    if not own.size:
        raise InputError(f"no mode is left in the band: {'; '.join(said) or 'none resonates'}")
    return _result(responses, end, deviation, sites, _renumbered(stabilisation, which, own), said)


def _sites(responses: FrequencyResponses, given: Mapping[str, str]) -> tuple[int | None, ...]:
    """For each input the index of the sensor at its place."""
    sensors, inputs = responses.sensors, responses.inputs
    for name, sensor in given.items():
        for what, each, known in (("input", name, inputs), ("sensor", sensor, sensors)):
            if each not in known:
                raise InputError(
                    f"driving_points: no {what} {each!r}; expected one of {', '.join(known)}"
                    f"{nearest(each, known)}"
                )
    names = [given.get(name, name) for name in inputs]
    return tuple(sensors.index(name) if name in sensors else None for name in names)


def _first_deviation(responses: FrequencyResponses) -> Float[np.ndarray, "F s i"]:
    """Scatter over neighbouring lines; without any a share that is the same for all."""
    size = np.abs(responses.frf)
    # Neither peaks nor the noise between them count for everything.
    even = np.sqrt(size**2 + np.median(size**2, axis=0))
    if not np.all(np.isfinite(responses.frf_std)):
        return even
    scatter = np.sqrt(_averaged(responses.frf_std**2))
    # No sensor and no structure repeats itself to more digits than it was read with.
    return np.maximum(scatter, np.finfo(np.float32).eps * even)


def _averaged(square: np.ndarray) -> np.ndarray:
    from scipy.ndimage import uniform_filter1d  # here, because it takes a tenth of a second

    return uniform_filter1d(square, 2 * _NEIGHBOURS + 1, axis=0, mode="nearest")


def _poles(
    responses: FrequencyResponses, order: int | Literal["auto"]
) -> tuple[Complex[np.ndarray, " n"], Stabilisation]:
    """Poles that come back, and those of all orders."""
    lines = len(responses.frequency)
    most = _HIGHEST if order == "auto" else int(order)
    if most < 2:
        raise InputError(f"order = {order}: expected 2 at least, or auto")
    # Three lines for each coefficient at least.
    highest = max(min(most, lines // 3), 2)
    orders = range(2, highest + 1, max(highest // _CHART, 1))
    deviation = _first_deviation(responses)
    weight = 1.0 / np.sqrt(np.mean(deviation**2, axis=2))
    found = poles_by_order(responses.s, responses.frf, weight, orders)
    ends = float(responses.frequency[0]), float(responses.frequency[-1])
    return clustered(found, orders, ends, max(len(orders) // _ORDERS, 1), responses.window)


def _fit(
    responses: FrequencyResponses,
    poles: Complex[np.ndarray, " n"],
    sites: tuple[int | None, ...],
) -> tuple[FittedModes, Float[np.ndarray, "F s i"], np.ndarray, list[str]]:
    """Fits that are weighted by what the last one has left, without modes that gain nothing.

    Returns the last one, its deviations, which of the poles are left, and what to say of others.
    """
    lines, deviation = _telling(responses, poles), _first_deviation(responses)
    which, said, settled = np.arange(len(poles)), [], 0
    ends = 2.0 * math.pi * responses.frequency[[0, -1]] * np.array([_LOWEST, _BEYOND])
    # As the modes in the band have.
    edges = np.stack([ends, np.full(2, np.median(-np.real(poles) / np.abs(poles)))])
    while True:
        model = _model(responses, len(poles), sites, deviation, lines, edges)
        begin, gain = linear_start(model, poles)
        end = fitted(model, begin)
        lost = _lost(responses, end, gain if settled else None)
        if not any(lost):
            settled += 1
            if settled == _ROUNDS:
                return end, deviation, which, said
        said += [each for each in lost if each]
        kept = np.array([each is None for each in lost])
        if not kept.any():
            raise InputError(f"no mode is left: {'; '.join(said)}")
        modes = end.modes
        omega, zeta = np.asarray(modes.omega), np.asarray(modes.zeta)
        omega, zeta = omega[kept], zeta[kept]
        poles = omega * (-zeta + 1j * np.sqrt(np.maximum(1.0 - zeta**2, 0.0)))
        which = which[kept]
        every = np.asarray(model.functions(modes, jnp.asarray(responses.s)))
        square = _averaged(np.abs(every - responses.frf) ** 2)
        scatter = _averaged(responses.frf_std**2)
        deviation = np.sqrt(np.fmax(square, scatter))


def _lost(
    responses: FrequencyResponses, end: FittedModes, gain: np.ndarray | None
) -> list[str | None]:
    """For each mode why it is none, as far as this test can tell; None for a mode."""
    model, modes = end.model, end.modes
    _, sensors, inputs = model.H.shape
    frequency = np.asarray(modes.omega) / (2.0 * math.pi)
    std = end.deviations[2]
    sites = [site for site in model.sites if site is not None]
    seen = np.linalg.norm(np.asarray(modes.shapes)[sites], axis=0)
    unsure = np.linalg.norm(std[sites], axis=0)
    # What a mode adds to the description, by the Bayesian information criterion.
    price = (2 + sensors + inputs) * math.log(2 * model.H.size)
    low, high = responses.frequency[[0, -1]]
    # Share of its amplitude that a mode loses over a block. A line of noise fits without any loss,
    # and one over its denominator is then no number.
    loses = np.asarray(modes.zeta * modes.omega) / np.diff(responses.frequency[:2])
    said: list[str | None] = []
    for k, f in enumerate(frequency):
        name = f"a mode at {f:.4g} Hz"
        if not low / _BEYOND < f < high * _BEYOND:
            said.append(f"{name} is left to the residual terms: far beyond the band")
        elif loses[k] < np.finfo(np.float32).eps:
            said.append(f"{name} does not decay, as a line of noise: left out")
        elif modes.zeta[k] >= 1.0:
            said.append(f"{name} does not oscillate, so heavily is it damped: left out")
        elif sites and not model.decays and seen[k] < _SEEN * unsure[k]:
            said.append(
                f"{name} moves no driving point (shape there {seen[k]:.2g} +- {unsure[k]:.2g}), so "
                "that its mass is not known: left out"
            )
        elif gain is not None and gain[k] < price:
            said.append(f"{name} is no more than noise: left out")
        else:
            said.append(None)
    return said


def _model(
    responses: FrequencyResponses,
    count: int,
    sites: tuple[int | None, ...],
    deviation: np.ndarray,
    lines: np.ndarray,
    edges: np.ndarray,
) -> ModalModel:
    """What is measured, at some of its lines."""
    decays, power = responses.excitation == "decay", responses.derivatives
    return ModalModel(
        chart=Chart(()),
        s=jnp.asarray(responses.s[lines]),
        H=jnp.asarray(responses.frf[lines]),
        deviation=jnp.asarray(deviation[lines]),
        power=jnp.asarray(0 * power if decays else power),
        sites=sites,
        decays=decays,
        count=count,
        edges=jnp.asarray(edges),
        middle=jnp.zeros(0),
        scale=jnp.ones(0),
    )


def _telling(responses: FrequencyResponses, poles: np.ndarray) -> np.ndarray:
    """Lines that a fit is made of: all of them, or those nearest to modes, in their bandwidths."""
    count = len(responses.frequency)
    most = max(_MOST_VALUES // responses.frf[0].size, 4 * len(poles))
    if count <= most:
        return np.arange(count)
    away = np.abs(1j * np.imag(responses.s)[:, None] - poles) / np.abs(np.real(poles))
    near = np.argsort(np.min(away, axis=1), kind="stable")[: most // 2]
    spread = np.linspace(0, count - 1, most // 2).round().astype(int)
    return np.union1d(near, spread)


def _renumbered(stabilisation: Stabilisation, which: np.ndarray, own: np.ndarray) -> Stabilisation:
    """Poles with the modes that are left of them, lowest frequency first."""
    number = np.full(max(int(stabilisation.mode.max(initial=-1)) + 1, 1), -1)
    number[which[own]] = np.arange(len(own))
    mode = np.where(stabilisation.mode >= 0, number[stabilisation.mode], -1)
    return replace(stabilisation, mode=mode)


def _result(
    responses: FrequencyResponses,
    end: FittedModes,
    deviation: np.ndarray,
    sites: tuple[int | None, ...],
    stabilisation: Stabilisation,
    said: list[str],
) -> ModalTest:
    model, modes = end.model, end.modes
    frequency, damping = np.asarray(modes.omega) / (2.0 * np.pi), np.asarray(modes.zeta)
    scaled = not model.decays and any(site is not None for site in sites)
    shapes, drives = np.asarray(modes.shapes), np.asarray(modes.drives)
    if model.decays:
        drives = np.zeros((0, shapes.shape[1]))
    else:
        for numerator, omega, zeta in zip(modes.remote, *model.edges, strict=True):
            more = residual_modes(np.asarray(numerator), model.sites)
            shapes, drives = (np.c_[a, b] for a, b in zip((shapes, drives), more, strict=True))
            frequency = np.r_[frequency, np.full(more[0].shape[1], omega / (2.0 * math.pi))]
            damping = np.r_[damping, np.full(more[0].shape[1], zeta)]
    own = _in_band(responses, end)
    # All others stand for what lies beyond.
    rest = np.setdiff1d(np.arange(len(frequency)), own)
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    largest = np.where(largest == 0.0, 1.0, largest)
    scale = np.sign(largest) if scaled else 1.0 / largest
    shapes, drives = shapes * scale, drives * scale if scaled else drives / scale
    omega_std, zeta_std, shapes_std = end.deviations
    fit = np.asarray(model.functions(modes, jnp.asarray(responses.s)))
    if not model.decays:  # as a structure has them, whose residual terms are modes
        s = responses.s[:, None]
        omega = 2.0 * math.pi * frequency
        dynamic = 1.0 / (s**2 + 2.0 * damping * omega * s + omega**2)
        fit = np.einsum("sr,fr,ir->fsi", shapes, dynamic, drives)
        fit *= (s**responses.derivatives)[:, :, None]
    size = np.sqrt(np.sum(np.abs(responses.frf) ** 2, axis=(0, 2)))
    misfit = np.sqrt(np.sum(np.abs(fit - responses.frf) ** 2, axis=(0, 2))) / size
    scatter = np.sqrt(np.sum(responses.frf_std**2, axis=(0, 2))) / size
    if np.any(misfit > _SEEN * scatter):
        said = [
            *said,
            f"the modes leave {100 * np.max(misfit):.2g} % of a response, the averages' scatter is "
            f"{100 * np.max(scatter):.2g} %: the structure is not linear at this level, or modes "
            "are missing; deviations are by what is left",
        ]
    if not end.converged:
        said = [*said, "the fit has not converged: narrow the band or lower order"]
    return ModalTest(
        frequency=frequency[own],
        frequency_std=(frequency[: model.count] * omega_std)[own],
        damping=damping[own],
        damping_std=(damping[: model.count] * zeta_std)[own],
        shapes=shapes[:, own],
        shapes_std=(shapes_std * np.abs(scale[: model.count]))[:, own],
        drives=drives[:, own],
        scaled=scaled,
        residual_frequency=frequency[rest],
        residual_damping=damping[rest],
        residual_shapes=shapes[:, rest],
        residual_drives=drives[:, rest],
        responses=responses,
        fitted=fit,
        distortion=deviation,
        misfit=misfit,
        scatter=scatter,
        stabilisation=stabilisation,
        sites={
            name: responses.sensors[site]
            for name, site in zip(responses.inputs, sites, strict=True)
            if site is not None
        },
        converged=end.converged,
        warnings=tuple(said),
    )


def _in_band(responses: FrequencyResponses, end: FittedModes) -> np.ndarray:
    """Indices of the modes that are resonances of the band, lowest frequency first."""
    f, zeta = np.asarray(end.modes.omega) / (2.0 * np.pi), np.asarray(end.modes.zeta)
    low, high = responses.frequency[[0, -1]]
    found = np.flatnonzero((f >= low) & (f <= high) & (zeta <= MOST_DAMPING))
    return found[np.argsort(f[found], kind="stable")]
