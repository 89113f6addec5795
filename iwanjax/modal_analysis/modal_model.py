"""Real modes and residual terms, fitted to frequency response functions."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from iwanjax.estimation.least_squares import least_squares
from iwanjax.estimation.parameters import Chart
from iwanjax.estimation.problem import AbstractLeastSquares, residuals_and_slopes

# Share of the least frequency below the band: nearer to it no fit can tell the difference.
_NEAR = 1e-6


class Modes(NamedTuple):
    """What the fitted functions are made of.

    Attributes
    ----------
    omega : (n + residual,) array
        Natural frequencies, rad/s, residual modes last.
    zeta : (n + residual,) array
        Damping ratios.
    shapes : (s, n + residual) array
        At the sensors, residual modes last.
    drives : (i, n + residual) array
        At the inputs; of decays (2 i, n) what each begins with, velocities after displacements.
    remote : (3, s, i) array
        Of decays, what modes beyond the band add: over s, constant, and with s; else empty.
    """

    omega: Array
    zeta: Array
    shapes: Array
    drives: Array
    remote: Array


class ModalModel(AbstractLeastSquares):
    r"""Frequency response functions of real modes, as residuals of their parameters.

    .. math::
        H_{si}(s) = s^{p_s} \sum_r \frac{\phi_{sr} \phi_{ir}}
        {s^2 + 2\zeta_r\omega_r s + \omega_r^2}

    with p the derivative of the displacement that a sensor measures. The last terms are modes
    below and above the band, as many of each as inputs: the lower and upper residual terms, such
    as a structure can have. Those below share one frequency and damping, which are free, those
    above have a fixed one. Of free decays the numerator is :math:`\phi_{sr} (a_r s + b_r)`, p is
    zero, and a row :math:`d/s + c + e s` is what lies beyond the band.

    Attributes
    ----------
    s : (F,) array
        sigma + i omega, rad/s.
    H : (F, s, i) array
        Measured.
    deviation : (F, s, i) array
        Of the complex value.
    power : (s,) array of int
        p.
    sites : tuple of int or None
        For each input the sensor at its place; None where there is none, and the shape there is
        a parameter.
    decays : bool
        Whether these are spectra of free decays.
    count : int
        Modes n in the band.
    residual : int
        Modes beyond it, half of them below; 0 for decays.
    lowest : float
        Least omega of those below, rad/s: a structure that floats has stiffness all the same.
    upper : (2,) array
        omega and zeta of those above.
    middle, scale : (parameters,) array
        Where the search begins, and its unit of each parameter.
    """

    chart: Chart
    s: Complex[Array, " F"]
    H: Complex[Array, "F s i"]
    deviation: Float[Array, "F s i"]
    power: Array
    sites: tuple[int | None, ...] = eqx.field(static=True)
    decays: bool = eqx.field(static=True)
    count: int = eqx.field(static=True)
    residual: int = eqx.field(static=True)
    lowest: float
    upper: Float[Array, "2"]
    middle: Float[Array, " parameters"]
    scale: Float[Array, " parameters"]
    names: tuple[str, ...] = eqx.field(static=True, default=())

    def modes(self, theta: Float[Array, " parameters"]) -> Modes:
        """What a row of parameters says."""
        n, total = self.count, self.count + self.residual
        sensors, inputs = self.H.shape[1:]
        each = n if self.decays else n + 1
        of_poles, rest = jnp.exp(theta[: 2 * each]).reshape(2, each), theta[2 * each :]
        if not self.decays:
            half = self.residual // 2
            below = jnp.repeat(of_poles[:, n:] + jnp.array([[self.lowest], [0.0]]), half, axis=1)
            above = jnp.repeat(self.upper[:, None], half, axis=1)
            of_poles = jnp.concatenate([of_poles[:, :n], below, above], axis=1)
        omega, zeta = of_poles
        shapes, rest = rest[: sensors * total].reshape(sensors, total), rest[sensors * total :]
        if self.decays:
            drives, rest = rest[: 2 * inputs * n].reshape(2 * inputs, n), rest[2 * inputs * n :]
            return Modes(omega, zeta, shapes, drives, rest.reshape(3, sensors, inputs))
        other = rest.reshape(-1, total)
        rows, taken = [], 0
        for site in self.sites:
            rows.append(other[taken] if site is None else shapes[site])
            taken += site is None
        return Modes(omega, zeta, shapes, jnp.stack(rows), jnp.zeros((3, 0, 0)))

    def parameters(self, modes: Modes) -> Float[Array, " parameters"]:
        """The row of parameters that says it."""
        own = [i for i, site in enumerate(self.sites) if site is None]
        drives = modes.drives if self.decays else modes.drives[np.array(own, int)]
        each = self.count if self.decays else self.count + 1
        omega = jnp.asarray(modes.omega[:each])
        if not self.decays:
            # Where it is the least, as near to it as the logarithm can begin.
            above = jnp.maximum(omega[-1] - self.lowest, _NEAR * self.lowest)
            omega = omega.at[-1].set(above)
        poles = jnp.log(omega), jnp.log(modes.zeta[:each])
        parts = (*poles, modes.shapes, drives, modes.remote)
        return jnp.concatenate([jnp.ravel(each) for each in parts])

    def functions(self, modes: Modes, s: Complex[Array, " lines"]) -> Complex[Array, "lines s i"]:
        """Frequency response functions, or spectra of decays, at any s."""
        s = s[:, None]
        dynamic = 1.0 / (s**2 + 2.0 * modes.zeta * modes.omega * s + modes.omega**2)
        if not self.decays:
            terms = jnp.einsum("sr,fr,ir->fsi", modes.shapes, dynamic, modes.drives)
            return terms * (s**self.power)[:, :, None]
        inputs = self.H.shape[2]
        a, b = modes.drives[:inputs], modes.drives[inputs:]
        begun = a * s[:, :, None] + b
        terms = jnp.einsum("sr,fr,fir->fsi", modes.shapes, dynamic, begun)
        over, constant, slope = modes.remote
        return terms + over / s[:, :, None] + constant + slope * s[:, :, None]

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """Real and imaginary parts of fitted minus measured, over their deviations."""
        off = (self.functions(self.modes(theta), self.s) - self.H) / self.deviation
        # The complex value's deviation is shared by its two parts.
        return jnp.sqrt(2.0) * jnp.concatenate([off.real.ravel(), off.imag.ravel()])

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """Parameter values of the variables that are searched, each in its own unit."""
        return self.middle + self.scale * z

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse."""
        return (theta - self.middle) / self.scale


class FittedModes(NamedTuple):
    """The end of a fit.

    Attributes
    ----------
    model : ModalModel
        What was fitted.
    theta : (parameters,) array
        Its parameters.
    covariance : (parameters, parameters) array
        By the deviations that were fitted with; directions that the data leave open have none.
    converged : bool
        Whether the search ended by its tolerance.
    """

    model: ModalModel
    theta: np.ndarray
    covariance: np.ndarray
    converged: bool

    @property
    def modes(self) -> Modes:
        """What they say."""
        return self.model.modes(jnp.asarray(self.theta))

    @property
    def deviations(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the logarithms of omega and zeta, (n,) each, and of shapes (s, n + residual)."""
        model, std = self.model, np.sqrt(np.diag(self.covariance))
        each = model.count if model.decays else model.count + 1
        sensors, total = model.H.shape[1], model.count + model.residual
        shapes = std[2 * each :][: sensors * total].reshape(sensors, total)
        return std[: model.count], std[each : each + model.count], shapes


def fitted(model: ModalModel, begin: Modes) -> FittedModes:
    """Least squares from a start, with the covariance of its end."""
    theta = model.parameters(begin)
    _, slopes = residuals_and_slopes(model, theta)
    size = jnp.linalg.norm(slopes, axis=0)
    scale = jnp.where(size > 0.0, 1.0 / jnp.where(size > 0.0, size, 1.0), 1.0)
    model = eqx.tree_at(lambda each: (each.middle, each.scale), model, (theta, scale))
    found = least_squares(model, theta[None], 1)[0]
    _, slopes = residuals_and_slopes(model, jnp.asarray(found.values))
    # In the search's units, so that no parameter's unit decides what counts as open.
    J = np.asarray(slopes) * np.asarray(scale)
    covariance = np.linalg.pinv(J.T @ J, hermitian=True) * np.outer(scale, scale)
    return FittedModes(model, found.values, covariance, found.converged)
