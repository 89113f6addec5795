"""The effects that are concealed, and the forces of those that act at one deflection."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from iwanjax.trial.structure import Array

Force = Callable[[Array], Array]
"""Force of a local element per recording, from its deflection per recording."""

PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "stiffness_error": ("k",),
    "mass_error": ("m",),
    "viscous_damping": ("c",),
    "cubic_stiffness": ("k3",),
    "quadratic_stiffness": ("k2",),
    "gap_contact": ("k", "gap", "sides"),  # one side: contact at positive deflections only
    "bilinear_stiffness": ("dk",),
    "coulomb_friction": ("k", "slip"),  # slip is the deflection at which the slider gives way
    "iwan_joint": ("F_S", "K_T", "chi", "beta"),
    "stiction": ("theta",),
    "quadratic_damping": ("c2",),
    "viscoelastic": ("k", "tau"),
    "attached_oscillator": ("m", "c", "k"),
    "joint_drift": ("factor_F_S", "factor_K_T"),  # from each recording to the next
    "sensor_gain": ("gain",),
    "sensor_delay": ("intervals",),
    "sensor_saturation": ("limit",),
    "sensor_polarity": (),
    "sensor_high_pass": ("corner",),  # Hz, of first order
    "sensor_hum": ("amplitude", "frequency", "third"),  # third: share of the third harmonic
    "sensor_drift": ("size",),  # rms of the offset that wanders
    "force_gain": ("gain",),
    "force_delay": ("intervals",),
    "force_saturation": ("limit",),
    "force_polarity": (),
}
LINEAR = ("stiffness_error", "mass_error", "viscous_damping")


@dataclass(frozen=True)
class Effect:
    """One concealed effect; a value is a number, or one number per recording.

    `where` is a row of the structure, or of a fault the sensor or the input.
    """

    kind: str
    where: str
    values: tuple[float | Array, ...]

    def each(self, recordings: int) -> list[Array]:
        """Return every parameter as one number per recording."""
        return [np.broadcast_to(np.asarray(v, float), (recordings,)) for v in self.values]


def _coulomb(k: Array, slip: Array) -> Force:
    stretch, last = np.zeros_like(k), np.zeros_like(k)

    def force(d: Array) -> Array:
        np.clip(stretch + d - last, -slip, slip, out=stretch)
        last[:] = d
        return k * stretch

    return force


def _maxwell(k: Array, tau: Array, dt: float) -> Force:
    """Spring and dashpot in series, exact for a deflection that is linear within a step."""
    stretch, last = np.zeros_like(k), np.zeros_like(k)
    decay = np.exp(-dt / tau)
    gain = tau / dt * (1 - decay)

    def force(d: Array) -> Array:
        stretch[:] = decay * stretch + gain * (d - last)
        last[:] = d
        return k * stretch

    return force


def _gap(k: Array, gap: Array, sides: Array) -> Force:
    other = sides > 1

    def force(d: Array) -> Array:
        pushed = np.maximum(d - gap, 0.0)
        return k * (pushed - other * np.maximum(-d - gap, 0.0))

    return force


def element(effect: Effect, recordings: int, dt: float) -> Force | None:
    """Return the force of a local element of one deflection, or None for another kind."""
    values = effect.each(recordings)
    match effect.kind:
        case "cubic_stiffness":
            return lambda d: values[0] * d**3
        case "quadratic_stiffness":
            return lambda d: values[0] * d**2
        case "bilinear_stiffness":
            return lambda d: values[0] * np.maximum(d, 0.0)
        case "gap_contact":
            return _gap(values[0], values[1], values[2])
        case "coulomb_friction":
            return _coulomb(values[0], values[1])
        case "viscoelastic":
            return _maxwell(values[0], values[1], dt)
    return None
