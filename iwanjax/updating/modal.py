"""Fitting one oscillator of unit modal mass with a joint to the curves of its mode."""

import itertools
import math
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.estimation.priors import AbstractPrior, LogNormal, Normal, Uniform
from iwanjax.estimation.transforms import Transform
from iwanjax.joints import AbstractJoint, ParameterInfo
from iwanjax.joints.iwan import AbstractIwan, phi_max_of, strength_of
from iwanjax.joints.iwan5 import Iwan5, ring_down_share
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.structures.small import solve_spd
from iwanjax.updating.microslip import IwanPlace, drop_of
from iwanjax.updating.problem import AbstractProblem, Measured, Reference, check_free, modal_unit

# Deviation of the logarithm of a joint's strength and stiffness before the data: a factor
# of four and a half either way.
_WIDE = 1.5
# Where starts put phi_max: logarithms of ratios to the largest amplitude.
_RANGE_BELOW, _RANGE_ABOVE = 3.0, 2.0
# How far from where the best start has left it a kink is tried again, in its logarithm: four of
# the intervals of 8 per cent that a ring-down has by default, two places in each; and with how
# many values of theta.
_KINK, _THETAS = 0.3, 4


class ModalProblem(AbstractProblem):
    """A :class:`~iwanjax.ModalOscillator` held against measured curves of its mode.

    Parameters are f_0, zeta_0 and the joint's own.
    """

    measured: Measured
    chart: Chart
    kind: type[AbstractJoint] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)

    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """What a ring-down shows at the measured amplitudes.

        NaN where the joint would be stiffer than the mode: no search or walk goes there.
        """
        model = self.model(theta)
        measured = self.measured
        f, zeta = model.ringdown_frequency_and_damping(measured.q, largest=measured.largest)
        return jnp.where(model.K_inf > 0, f, jnp.nan), zeta

    def model(self, theta: Float[Array, " parameters"]) -> ModalOscillator:
        """The oscillator with these parameters."""
        joint = dict(zip(self.names[2:], theta[2:], strict=True))
        return ModalOscillator(theta[0], theta[1], self.kind(**joint))

    def improved(self, theta: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        r"""The same start with f_0, zeta_0 and the joint's overall strength s from the data.

        With all forces of the joint times s the curves are linear in
        :math:`\omega_0^2, s, \zeta_0` (with the measured frequency in small terms):

        .. math:: \omega^2 = \omega_0^2 - s\,[K_T - k_1(q)], \qquad
                  \zeta = s\,\frac{D(q)}{2\pi\omega^2q^2} + \zeta_0

        so that a search has only the shape of the joint's law left to find. f_0 and zeta_0 keep
        the values that they are fixed at; with a fixed force nothing is moved.
        """
        infos = {info.name: info for info in self.kind.parameters}
        free = np.isin(np.arange(len(self.names)), self.chart.free)
        forces = np.array(
            [name in infos and "force" in infos[name].dimension for name in self.names]
        )
        if not np.all(free[forces]):
            return theta
        measured = self.measured
        joint = self.model(theta).joint
        omega = 2.0 * math.pi * measured.frequency
        cycles = joint.after(measured.largest)
        yielded = joint.initial_stiffness - cycles.harmonic_stiffness(measured.q)
        loss = cycles.dissipation(measured.q, omega=omega)
        zero = jnp.zeros_like(omega)
        weight_f = 1.0 / (2.0 * omega * 2.0 * math.pi * measured.frequency_std)
        weight_z = 1.0 / measured.damping_std
        # Columns of one size, or the normal equations would be singular in floating point.
        scale = jnp.mean(omega**2)
        lost = loss / (2.0 * math.pi * omega**2 * measured.q**2)
        columns = [
            jnp.concatenate([weight_f * scale, zero]),
            jnp.concatenate([-weight_f * yielded, weight_z * lost]),
            jnp.concatenate([zero, weight_z]),
        ]
        x = [(2.0 * math.pi * theta[0]) ** 2 / scale, jnp.ones(()), theta[1]]
        sought = [i for i, moves in enumerate((free[0], True, free[1])) if moves]
        b = jnp.concatenate([weight_f * omega**2, weight_z * measured.damping])
        b = b - sum(columns[i] * x[i] for i in range(3) if i not in sought)
        sizes = [jnp.linalg.norm(columns[i]) for i in sought]
        A = [columns[i] / size for i, size in zip(sought, sizes, strict=True)]
        found = solve_spd([[row @ other for other in A] for row in A], [row @ b for row in A])
        for i, value, size in zip(sought, found, sizes, strict=True):
            x[i] = value / size
        strength = jnp.clip(x[1], 1e-3, 1e3)
        f_0 = jnp.sqrt(jnp.maximum(x[0] * scale, 0.25 * scale)) / (2.0 * math.pi)
        better = jnp.where(forces, theta * strength, theta).at[0].set(f_0).at[1].set(x[2])
        # What is fixed stays to the last digit, whatever its bounds.
        return jnp.where(free, jnp.clip(better, self.chart.lower, self.chart.upper), theta)

    def iwan_places(self, theta: Float[Array, " parameters"]) -> tuple[IwanPlace, ...]:
        """The mode's joint, up to the largest amplitude."""
        if not issubclass(self.kind, AbstractIwan):
            return ()
        positions = {name: self.names.index(name) for name in ("F_S", "K_T", "chi", "beta")}
        return (IwanPlace("", positions, float(jnp.max(self.measured.q))),)

    def derived(self, theta: Float[Array, " parameters"]) -> Mapping[str, Array]:
        """Stiffness beside the joint and, of an Iwan joint, its slider distribution."""
        model = self.model(theta)
        found = {"K_inf": model.K_inf}
        if isinstance(model.joint, AbstractIwan):
            found |= {"phi_max": model.joint.phi_max, "R": model.joint.R, "S": model.joint.S}
        return found

    def remarks(self, values: Mapping[str, float], determined: Mapping[str, bool]) -> list[str]:
        r"""Of a five-parameter joint, whether the decays reach where theta shows.

        What slipped at the largest amplitude slips again while a cycle is above
        :math:`(1+\theta)/2` of that; below, (4.47) makes the curves those of theta = 1.
        """
        joint = self.model(jnp.asarray([values[name] for name in self.names])).joint
        if not isinstance(joint, Iwan5):
            return []
        q, largest = (np.asarray(x) for x in (self.measured.q, self.measured.largest))
        # Where the decays do not show phi_max, a fit's own is no reason to have seen theta.
        slipped = float(joint.phi_max) if determined.get("F_S", True) else np.inf
        above = q >= 0.5 * (1.0 + values["theta"]) * np.minimum(largest, slipped)
        if determined.get("theta", np.any(above)):
            return []
        highest = float(np.max(q / largest))
        return [
            f"theta is not determined: it shows only above (1 + theta)/2 of the largest amplitude "
            f"of a decay (or of phi_max, where that is less), where {np.sum(above)} of {q.size} "
            "levels lie; below, the curves are those of theta = 1 with another R. The highest "
            f"level is at {highest:.2g} of its decay's largest amplitude: no theta above "
            f"{max(0.0, 2.0 * highest - 1.0):.2g} is excluded by what is not seen. Measure nearer "
            "to the largest amplitude."
        ]


class ModalIwanProblem(ModalProblem):
    r"""The same with an Iwan joint, in variables that suit microslip data.

    In microslip the curves know F_S, K_T, chi and beta only through chi and the drop c of
    stiffness at some amplitude (:func:`~iwanjax.updating.microslip.drop_of`), so that the
    parameters themselves lie on thin curved ridges. Here c and phi_max take the places of K_T and
    F_S. With a theta it is c times (4.47)'s share that they know, below (1 + theta)/2 of the
    largest amplitude, and that is c here.
    """

    q_ref: Array

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """Parameters of (f_0, zeta_0, phi_max, c, chi, beta, ...), each in its own transform."""
        f_0, zeta_0, phi_max, drop, chi, beta, *kinetic = self.chart.to_values(z)
        # The drop of a joint whose K_T is one.
        unit = drop_of(jnp.ones_like(drop), phi_max, chi, beta, self.q_ref)
        K_T = drop / (self._share(chi, kinetic) * unit)
        F_S = strength_of(phi_max, K_T, chi, beta)
        return jnp.stack([f_0, zeta_0, F_S, K_T, chi, beta, *kinetic])

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        f_0, zeta_0, F_S, K_T, chi, beta, *kinetic = theta
        phi_max = phi_max_of(F_S, K_T, chi, beta)
        drop = drop_of(K_T, phi_max, chi, beta, self.q_ref) * self._share(chi, kinetic)
        return self.chart.to_variables(jnp.stack([f_0, zeta_0, phi_max, drop, chi, beta, *kinetic]))

    def _share(self, chi: Array, kinetic: Sequence[Array]) -> Array:
        return ring_down_share(chi, *kinetic) if kinetic else jnp.ones_like(chi)

    @property
    def most_runs(self) -> int:
        """More than of other problems: a run takes 6 ms, and the kink's valley is narrow.

        Of 16 runs on the hits of ``configs/modal_ringdown.yaml`` one or two ended in it for five
        seeds, of 64 six to eight.
        """
        return 64

    def spread(self, draws: np.ndarray) -> np.ndarray:
        """All but the first start with phi_max evenly over the measured range and beyond.

        The curves have a kink at phi_max: each gap between measured amplitudes that it may
        lie in is a valley of its own, narrow beside that of microslip everywhere.
        """
        K_T, chi, beta = draws.T[3:6]
        q = np.log(np.asarray(self.measured.q))
        low, high = max(q.min(), q.max() - _RANGE_BELOW), q.max() + _RANGE_ABOVE
        phi_max = np.exp(np.linspace(low, high, len(draws) + 1)[1:])
        remaining = (beta + (chi + 1.0) / (chi + 2.0)) / (1.0 + beta)
        spread = draws.copy()
        spread[1:, 2] = (K_T * phi_max * remaining)[1:]
        order = np.argsort(spread[:, 2] / (spread[:, 3] * remaining))
        return spread[order]

    def restarts(self, theta: np.ndarray, count: int) -> np.ndarray | None:
        """Of a five-parameter joint: other theta, with the kink of the curves near where it is.

        That lies at (1 + theta)/2 of phi_max or of the largest amplitude, whichever is less. The
        gaps between measured amplitudes in which it may lie are valleys of their own, which an
        estimate does not leave when it moves theta alone. None where theta is fixed.
        """
        if "theta" not in self.names or self.names.index("theta") not in self.chart.free:
            return None
        at, kinks = self.names.index("theta"), -(-count // _THETAS)
        z = self.to_variables(jnp.asarray(theta))
        tried = (np.arange(_THETAS) + 0.5) / _THETAS
        shift = np.exp(_KINK * np.linspace(-1.0, 1.0, kinks))
        rows = []
        # Of each place for the kink the best theta is run.
        for moved, kinetic in itertools.islice(itertools.product(shift, tried), count):
            values = np.array(self.chart.to_values(z))
            values[2] *= moved * (1.0 + theta[at]) / (1.0 + kinetic)
            values[at] = kinetic
            rows.append(self.to_values(self.chart.to_variables(jnp.asarray(values))))
        return np.asarray(jnp.stack(rows))


def modal_problem(
    kind: type[AbstractJoint],
    curves: Sequence[ModalCurves],
    parameters: Sequence[Parameter],
    reference: Reference,
) -> ModalProblem:
    """The problem that suits a joint and the bounds of its parameters.

    Raises
    ------
    InputError
        For curves that cannot be fitted, or more parameters than data.
    """
    measured = Measured.of(curves)
    check_free(parameters, measured)
    chart = Chart(parameters)
    strength = [p for p in parameters if p.name in ("F_S", "K_T")]
    unbounded = all(p.lower == 0.0 and p.upper == math.inf and not p.fixed for p in strength)
    common = {
        "measured": measured,
        "chart": chart,
        "kind": kind,
        "names": tuple(p.name for p in parameters),
        "reference": reference,
    }
    if issubclass(kind, AbstractIwan) and unbounded:
        # Another variable than the parameter stands behind these two, but always positive.
        return ModalIwanProblem(**common, q_ref=jnp.exp(jnp.mean(jnp.log(measured.q))))
    return ModalProblem(**common)


def modal_parameters(
    kind: type[AbstractJoint], curves: ModalCurves | Sequence[ModalCurves]
) -> dict[str, Parameter]:
    r"""Parameters of a modal oscillator, with values and priors on the scale of the curves.

    Stiffness is measured by the drop of :math:`\omega^2` over the curves, force by that
    times the largest amplitude. chi stays within Segalman's (-1, 0) unless told otherwise:
    the formulas hold beyond, where the distribution of sliders grows with their strength.

    Parameters
    ----------
    kind : type
        The joint's class, for instance :class:`~iwanjax.Iwan4`.
    curves : ModalCurves or sequence of them
        Measured curves of one mode.

    Returns
    -------
    dict of str to Parameter
        Keyed f_0, zeta_0 and the names of the joint's own; change them by
        ``dataclasses.replace`` and hand them to :func:`~iwanjax.fit`.

    Raises
    ------
    InputError
        For curves that cannot be fitted.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> q = np.geomspace(1e-3, 1e-1, 20)
    >>> std = {"frequency_std": np.full(20, 1e-3), "damping_std": np.full(20, 1e-5)}
    >>> curves = ij.ModalCurves(q, 10.0 - q, 1e-3 + 0.1 * q, **std)
    >>> list(ij.modal_parameters(ij.Jenkins, curves))
    ['f_0', 'zeta_0', 'F_S', 'K_T']
    """
    several = [curves] if isinstance(curves, ModalCurves) else list(curves)
    measured = Measured.of(several)
    q, f, zeta = (np.asarray(x) for x in (measured.q, measured.frequency, measured.damping))
    f_low = float(f[np.argmin(q)])
    fall = max(float(f_low - f.min()), 3.0 * float(np.median(measured.frequency_std)))
    most = float(max(zeta.max(), np.median(measured.damping_std)))
    stiffness = (2.0 * math.pi) ** 2 * 2.0 * f_low * fall
    scales = {
        "1": 1.0,
        "length": float(q.max()),
        "force": stiffness * float(q.max()),
        "force/length": stiffness,
        "force/length^3": stiffness / float(q.max()) ** 2,
        "force*time/length": 2.0 * most * 2.0 * math.pi * f_low,
    }
    found = [
        Parameter(
            "f_0",
            f_low,
            Normal(f_low, 3.0 * fall),
            unit="Hz",
            meaning="natural frequency at vanishing amplitude",
            lower=0.0,
            transform="log",
        ),
        Parameter(
            "zeta_0",
            0.5 * float(max(zeta.min(), 0.1 * most)),
            Uniform(0.0, 1.5 * most),
            meaning="damping ratio beside the joint",
            lower=0.0,
            upper=1.5 * most,
            transform="logit",
        ),
    ]
    for info in kind.parameters:
        if info.dimension not in scales:
            raise InputError(
                f"{kind.__name__}.{info.name} is in {info.dimension}, for which there is no "
                f"scale in the curves; known: {', '.join(scales)}"
            )
        unit = modal_unit(info.dimension, several[0])
        found.append(_joint_parameter(info, scales[info.dimension], unit))
    return {p.name: p for p in found}


def _joint_parameter(info: ParameterInfo, scale: float, unit: str) -> Parameter:
    """A joint's parameter in a fit, with a prior on the given scale."""
    low, high = info.usual or (info.lower, info.upper)
    prior: AbstractPrior
    transform: Transform
    if math.isfinite(low) and math.isfinite(high):
        value, transform, prior = 0.5 * (low + high), "logit", Uniform(low, high)
    elif low < 0.0:
        value, transform, prior = 0.0, "identity", Normal(0.0, scale)
    else:
        # Strength and stiffness are several times what has been seen to yield so far.
        value = scale if info.dimension == "1" else 4.0 * scale
        transform, prior = "log", LogNormal(value, _WIDE)
    return Parameter(
        info.name,
        value,
        prior,
        unit=unit,
        meaning=info.meaning,
        lower=low,
        upper=high,
        transform=transform,
    )
