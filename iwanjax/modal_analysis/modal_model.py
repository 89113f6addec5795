"""Real modes and residual terms, fitted to frequency response functions."""

import math
import sys
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from iwanjax.estimation.parameters import Chart
from iwanjax.estimation.problem import AbstractLeastSquares, residuals_and_slopes


class ModalTerms(NamedTuple):
    """What the fitted functions are made of.

    Attributes
    ----------
    omega, zeta : (n,) array
        Natural frequencies, rad/s, and damping ratios.
    shapes : (s, n) array
        At the sensors.
    drives : (i, n) array
        At the inputs; of decays (2 i, n) what each begins with, velocities after displacements.
    remote : (terms, s, i) array
        Residual terms: below and above the band; of decays over s, constant, and with s.
    """

    omega: Array
    zeta: Array
    shapes: Array
    drives: Array
    remote: Array


class ModalModel(AbstractLeastSquares):
    r"""Frequency response functions of real modes, as residuals of their parameters.

    .. math::
        H_{si}(s) = s^{p_s} \Big[ \sum_r \frac{\phi_{sr} \phi_{ir}}
        {s^2 + 2\zeta_r\omega_r s + \omega_r^2} + \sum_e \frac{R_{e,si}}
        {s^2 + 2\zeta_e\omega_e s + \omega_e^2} \Big]

    with p the derivative of the displacement that a sensor measures. The lower and upper residual
    terms R are those of modes of given frequencies far below and above the band, so that a
    structure can have them. Of free decays the numerators are :math:`\phi_{sr} (a_r s + b_r)`,
    p is zero, and :math:`d/s + c + e s` is what lies beyond the band.

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
        ModalTerms n.
    edges : (2, 2) array
        omega of the modes below and above the band, and zeta of these.
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
    edges: Float[Array, "2 2"]
    middle: Float[Array, " parameters"]
    scale: Float[Array, " parameters"]
    names: tuple[str, ...] = eqx.field(static=True, default=())

    def modes(self, theta: Float[Array, " parameters"]) -> ModalTerms:
        """What a row of parameters says."""
        n, (sensors, inputs) = self.count, self.H.shape[1:]
        drives = 2 * inputs if self.decays else self.sites.count(None)
        ends = np.cumsum([n, n, sensors * n, drives * n])
        omega, zeta, shapes, own, remote = jnp.split(theta, ends)
        shapes, own = shapes.reshape(sensors, n), own.reshape(drives, n)
        if not self.decays:
            free = iter(own)
            own = jnp.stack([next(free) if each is None else shapes[each] for each in self.sites])
        # A mode that a search sends off to any damping is told by its end, which stays a number, as
        # do squares of what it is in.
        most = 0.25 * math.log(sys.float_info.max)
        ratio = jnp.exp(jnp.clip(zeta, -most, most))
        return ModalTerms(jnp.exp(omega), ratio, shapes, own, remote.reshape(-1, sensors, inputs))

    def parameters(self, modes: ModalTerms) -> Float[Array, " parameters"]:
        """The row of parameters that says it."""
        free = [i for i, site in enumerate(self.sites) if site is None]
        drives = modes.drives if self.decays else np.asarray(modes.drives)[free]
        parts = (np.log(modes.omega), np.log(modes.zeta), modes.shapes, drives, modes.remote)
        return jnp.concatenate([jnp.ravel(each) for each in parts])

    def terms(
        self, omega: Array, zeta: Array, s: Complex[Array, " lines"]
    ) -> tuple[Complex[Array, "lines n"], Complex[Array, "lines terms"]]:
        """One over the modes' denominators, and what residual terms are multiplied by."""
        s = s[:, None]
        dynamic = 1.0 / (s**2 + 2.0 * zeta * omega * s + omega**2)
        if self.decays:
            return dynamic, jnp.concatenate([1.0 / s, jnp.ones_like(s), s], axis=1)
        far, ratio = self.edges
        return dynamic, 1.0 / (s**2 + 2.0 * ratio * far * s + far**2)

    def functions(
        self, modes: ModalTerms, s: Complex[Array, " lines"]
    ) -> Complex[Array, "lines s i"]:
        """Frequency response functions, or spectra of decays, at any s."""
        dynamic, beyond = self.terms(modes.omega, modes.zeta, s)
        remote = jnp.einsum("ft,tsi->fsi", beyond, modes.remote)
        if not self.decays:
            found = jnp.einsum("sr,fr,ir->fsi", modes.shapes, dynamic, modes.drives)
            return (found + remote) * (s[:, None] ** self.power)[:, :, None]
        inputs = self.H.shape[2]
        begun = modes.drives[:inputs] * s[:, None, None] + modes.drives[inputs:]
        return jnp.einsum("sr,fr,fir->fsi", modes.shapes, dynamic, begun) + remote

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
    def modes(self) -> ModalTerms:
        """What they say."""
        return self.model.modes(jnp.asarray(self.theta))

    @property
    def deviations(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the logarithms of omega and zeta, (n,) each, and of shapes (s, n)."""
        n, sensors = self.model.count, self.model.H.shape[1]
        omega, zeta, shapes, _ = np.split(
            np.sqrt(np.diag(self.covariance)), np.cumsum([n, n, sensors * n])
        )
        return omega, zeta, shapes.reshape(sensors, n)


def fitted(model: ModalModel, begin: ModalTerms) -> FittedModes:
    """Least squares from a start, with the covariance of its end."""
    # Here, because it loads the optimisers, which figures and study files do not need.
    from iwanjax.estimation.least_squares import least_squares

    theta = model.parameters(begin)
    _, slopes = residuals_and_slopes(model, theta)
    size = jnp.linalg.norm(slopes, axis=0)
    scale = 1.0 / jnp.where(size > 0.0, size, 1.0)
    model = eqx.tree_at(lambda each: (each.middle, each.scale), model, (theta, scale))
    found = least_squares(model, theta[None], 1)[0]
    _, slopes = residuals_and_slopes(model, jnp.asarray(found.values))
    # In the search's units, so that no parameter's unit decides what counts as open.
    J = np.asarray(slopes) * np.asarray(scale)
    covariance = np.linalg.pinv(J.T @ J, hermitian=True) * np.outer(scale, scale)
    return FittedModes(model, found.values, covariance, found.converged)
