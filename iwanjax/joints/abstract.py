"""What every joint element offers: parameters, backbone, secant, dissipation, loop."""

import abc
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, Self, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.discrete import AbstractDiscrete, Elastic
from iwanjax.joints.sliders import SLIDERS
from iwanjax.types import ArrayLike, as_real, is_traced, real

Law: TypeAlias = Callable[[Array], tuple[Array, Array]]
"""Deflection d -> (force, tangent stiffness) on the virgin curve, elementwise."""

_HARMONIC_NODES = 64


class HasCycles(Protocol):
    """What an element does over steady cycles of amplitude |d|."""

    def harmonic_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        """In-phase first harmonic over d."""
        ...

    def tip_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        """Stiffness at the tips that a free decay's amplitude shrinks by."""
        ...

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Energy lost in a cycle."""
        ...


@dataclass(frozen=True)
class ParameterInfo:
    """One parameter of an element: what it is, where it may lie, how a fit should move it.

    Parameters
    ----------
    name : str
        Attribute of the element.
    dimension : str
        In force and length, for instance ``"force/length"``; ``"1"`` when it has none.
    meaning : str
        A few words for reports.
    lower, upper : float
        Open bounds outside which the formulas do not hold; ``closed`` names the ends
        that belong to the range.
    transform : {"log", "logit", "identity"}
        The map to an unbounded variable that suits the parameter.
    usual : (float, float), optional
        The range a fit uses unless told otherwise, where it is narrower than the bounds.
    """

    name: str
    dimension: str
    meaning: str
    lower: float = -np.inf
    upper: float = np.inf
    closed: Literal["", "lower", "upper", "both"] = ""
    transform: Literal["log", "logit", "identity"] = "identity"
    usual: tuple[float, float] | None = None

    def contains(self, value: Array | np.ndarray) -> Any:
        """Whether each value lies within the bounds."""
        above = value >= self.lower if self.closed in ("lower", "both") else value > self.lower
        below = value <= self.upper if self.closed in ("upper", "both") else value < self.upper
        return above & below

    def check(self, value: Array, owner: str) -> None:
        """Refuse a value outside the bounds, naming it and its element; traced ones pass.

        Raises
        ------
        InputError
        """
        if is_traced(value):
            return
        inside = self.contains(np.asarray(value))
        if not np.all(inside):
            worst = np.asarray(value)[~inside].ravel()[0]
            raise InputError(
                f"{owner}: {self.name} = {worst:.17g} ({self.meaning}) lies outside {self.range}"
            )

    @property
    def range(self) -> str:
        """The bounds as text, for instance ``(-1, inf)``."""
        left = "[" if self.closed in ("lower", "both") else "("
        right = "]" if self.closed in ("upper", "both") else ")"
        return f"{left}{self.lower:g}, {self.upper:g}{right}"


class AbstractJoint(eqx.Module):
    """One-dimensional element between the two ends of a deflection row d = row @ u.

    All methods are elementwise in the deflection and broadcast against parameters
    that are arrays, so one object can carry a batch of parameter sets. Forces are
    those the element opposes to a growing d.

    Examples
    --------
    >>> import iwanjax as ij
    >>> joints = [ij.LinearSpring(k=2.0), ij.Jenkins(F_S=1.0, K_T=2.0)]
    >>> all(isinstance(joint, ij.AbstractJoint) for joint in joints)
    True
    >>> [float(joint.secant(1.0)) for joint in joints]
    [2.0, 1.0]
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]]
    # Whether the force is always proportional to the deflection: such elements are part of
    # the linear structure in a static solve.
    linear: ClassVar[bool] = False

    def with_parameters(self, **values: ArrayLike) -> Self:
        """The same with other values of some parameters; what else it was made of stays.

        Parameters
        ----------
        **values : array_like
            By the parameters' names.
        """
        made = {name: getattr(self, name) for name in inspect.signature(type(self)).parameters}
        return type(self)(**(made | values)) if values else self

    @abc.abstractmethod
    def law(self) -> Law:
        """The virgin curve as a function d -> (force, tangent), constants worked out once."""

    @abc.abstractmethod
    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Secant stiffness (tip force / amplitude) of the steady cycle of amplitude |d|."""

    @abc.abstractmethod
    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Energy dissipated per steady cycle of amplitude |d| (at ``omega`` rad/s)."""

    @abc.abstractmethod
    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Force on the loading branch, from -d_0 to d_0, of the steady cycle of amplitude d_0."""

    @property
    @abc.abstractmethod
    def initial_stiffness(self) -> Array:
        """Tangent stiffness at rest: the low-amplitude limit."""

    @property
    @abc.abstractmethod
    def limit_stiffness(self) -> Array:
        """Secant stiffness at very large amplitude; infinite where the force outgrows d."""

    def backbone(self, d: ArrayLike) -> Float[Array, "..."]:
        """Virgin loading force at deflection d, any sign and shape.

        Parameters
        ----------
        d : array_like
            Deflection, length.

        Returns
        -------
        array
            Force, in the unit of the element's strength.
        """
        return self.law()(real(d))[0]

    def tangent(self, d: ArrayLike) -> Float[Array, "..."]:
        """Slope of the virgin curve at deflection d, force/length."""
        return self.law()(real(d))[1]

    def tip_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        r"""Stiffness at the tips that a free decay's amplitude shrinks by.

        Between two turns, at -(d + delta/2) and d - delta/2, where nothing moves, the springs
        give back what is lost. On Masing branches and in an elastic force G that is

        .. math:: \tfrac12 D(d) = \left[d\,F'(d) + G(d)\right]\delta = k_{tip}\,d\,\delta

        whatever delta is for the one and to its square for the other: the tangent of a Masing
        element (for friction beside a spring the spring alone), the secant of an elastic one.
        From the energy balance, with Masing's branch :math:`2F((x + q)/2) - F(q)`; no source.

        Parameters
        ----------
        d : array_like
            Amplitude, length.

        Returns
        -------
        array
            Force/length; by default the tangent, as for a Masing element.
        """
        return self.tangent(jnp.abs(real(d)))

    def harmonic_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        r"""In-phase first-harmonic stiffness of the steady cycle d cos(t).

        .. math:: k_1(d) = \frac{2}{\pi d}\int_0^{\pi} F(d\cos t)\cos t\,dt

        over the unloading branch, by the midpoint rule in t (spectrally accurate for a
        smooth branch). It is the stiffness a Hilbert transform of a ring-down sees,
        where the secant only joins the tips of the loop.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        """
        amplitude = jnp.abs(real(d))
        at_rest = amplitude == 0
        safe = jnp.where(at_rest, 1.0, amplitude)
        shapes = (jnp.shape(getattr(self, info.name)) for info in self.parameters)
        rank = len(jnp.broadcast_shapes(amplitude.shape, *shapes))
        t = (np.arange(_HARMONIC_NODES) + 0.5) * np.pi / _HARMONIC_NODES
        cosine = np.cos(t).reshape(-1, *(1,) * rank)
        # The unloading branch at d cos t is minus the loading branch at -d cos t.
        mean = -jnp.mean(self.loading(-safe * cosine, safe) * cosine, axis=0)
        return jnp.where(at_rest, self.initial_stiffness, 2.0 * mean / safe)

    def after(self, d_max: ArrayLike) -> HasCycles:
        """The element's cycles after one of a larger amplitude, as in a free decay.

        Parameters
        ----------
        d_max : array_like
            Largest amplitude so far, length; broadcasts against the cycles' own.

        Returns
        -------
        HasCycles
            The element itself unless it remembers (:class:`Iwan5` does).
        """
        return self

    def discrete(self, sliders: int | None = SLIDERS) -> AbstractDiscrete:
        """The element in motion, for integration in time; one parameter set.

        Parameters
        ----------
        sliders : int or None
            For elements that are made of sliders; the others have none. None asks for the
            closed form instead, where there is one.

        Returns
        -------
        AbstractDiscrete
            With ``init`` and ``step``. Unless the element says otherwise its force follows the
            virgin curve both ways.
        """
        return Elastic(self)

    def loop(
        self, d_0: ArrayLike, points: int = 201
    ) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
        """The steady hysteresis loop of amplitude d_0, up and down, for plotting.

        Parameters
        ----------
        d_0 : float
            Amplitude, length.
        points : int
            Points on each of the two branches.

        Returns
        -------
        (d, force) : two (2 points,) arrays
            Closed curve; the enclosed area is ``dissipation(d_0)``.
        """
        amplitude = real(d_0)
        # Cosine spacing resolves the steep start of each branch.
        up = -amplitude * jnp.cos(jnp.linspace(0.0, jnp.pi, points))
        force = self.loading(up, amplitude)
        return jnp.concatenate([up, -up]), jnp.concatenate([force, -force])

    def __repr__(self) -> str:
        """The element with its parameters as numbers, or shapes for batches."""
        values = {info.name: getattr(self, info.name) for info in self.parameters}
        shown = (
            f"{name}={value:.6g}"
            if not is_traced(value) and jnp.ndim(value) == 0
            else f"{name}={jnp.shape(value)}"
            for name, value in values.items()
        )
        return f"{type(self).__name__}({', '.join(shown)})"

    def __check_init__(self) -> None:
        """Hold every parameter against its bounds and the shapes against each other."""
        shapes = []
        for info in self.parameters:
            value = getattr(self, info.name)
            shapes.append(value.shape)
            info.check(value, type(self).__name__)
        try:
            np.broadcast_shapes(*shapes)
        except ValueError:
            named = ", ".join(
                f"{info.name} {shape}" for info, shape in zip(self.parameters, shapes, strict=True)
            )
            raise InputError(
                f"{type(self).__name__}: parameter shapes do not broadcast together: {named}"
            ) from None


def named(name: str) -> Callable[[ArrayLike], Array]:
    """Converter for a field: what arrives becomes a real array, errors call it by its name."""
    return lambda value: as_real(value, name)
