"""What may be missing from a model: each kind of physics with its force and its signs."""

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.errors import InputError
from iwanjax.joints import ParameterInfo


class Motion(NamedTuple):
    """What a place of the structure does over one step.

    Attributes
    ----------
    d, v, a : array
        Deflection, rate and acceleration of the place at the end of the step.
    moved : array
        Change of the deflection over the step.
    dt : array
        Length of the step, s.
    """

    d: Array
    v: Array
    a: Array
    moved: Array
    dt: Array


UnitForce: TypeAlias = Callable[[Motion, Array, Array], tuple[Array, Array]]
"""(motion, shape, memory) -> (force per unit size, memory), elementwise over places."""


class Scales(NamedTuple):
    """What a place has seen, to choose shapes by: largest deflection, and longest period (s)."""

    deflection: float
    period: float


@dataclass(frozen=True)
class Kind:
    """One kind of missing physics: a force size * unit_force at some place.

    Parameters
    ----------
    name : str
        As in ``diagnosis.json``.
    usual : str
        What the field calls it.
    size : ParameterInfo
        The factor of the force; zero is no force at all.
    unit_force : function
        Force that opposes a growing deflection, for size 1.
    signs : str
        What betrays it, in words.
    shape : ParameterInfo, optional
        A second, positive parameter that the force depends on in another way.
    shapes : function
        Scales -> values of it to begin with.
    positive : bool
        Whether a negative size means nothing.
    """

    name: str
    usual: str
    size: ParameterInfo
    unit_force: UnitForce
    signs: str
    shape: ParameterInfo | None = None
    shapes: Callable[[Scales], tuple[float, ...]] = lambda scales: (1.0,)
    positive: bool = False


def _memoryless(law: Callable[[Motion, Array], Array]) -> UnitForce:
    return lambda motion, shape, memory: (law(motion, shape), memory)


def _slider(motion: Motion, slip: Array, stretch: Array) -> tuple[Array, Array]:
    stretch = jnp.clip(stretch + motion.moved, -slip, slip)
    return stretch, stretch


def _maxwell(motion: Motion, tau: Array, stretch: Array) -> tuple[Array, Array]:
    x = motion.dt / tau
    stretch = jnp.exp(-x) * stretch - jnp.expm1(-x) / x * motion.moved
    return stretch, stretch


_KINDS = (
    Kind(
        "stiffness_error",
        "wrong or missing linear stiffness, boundary",
        ParameterInfo("k", "force/length", "stiffness"),
        _memoryless(lambda m, _: m.d),
        "a frequency that is off at every amplitude",
    ),
    Kind(
        "mass_error",
        "unmodelled mass (sensor, cable, fixture)",
        ParameterInfo("m", "mass", "mass"),
        _memoryless(lambda m, _: m.a),
        "frequencies that are off at every amplitude, the higher the more",
    ),
    Kind(
        "viscous_damping",
        "unmodelled linear damper",
        ParameterInfo("c", "force*time/length", "viscous coefficient"),
        _memoryless(lambda m, _: m.v),
        "damping that is off at every amplitude",
    ),
    Kind(
        "cubic_stiffness",
        "hardening or softening, geometric",
        ParameterInfo("k3", "force/length^3", "cubic stiffness"),
        _memoryless(lambda m, _: m.d**3),
        "a frequency that changes with the square of the amplitude; third harmonics",
    ),
    Kind(
        "quadratic_stiffness",
        "asymmetric elastic force, curvature",
        ParameterInfo("k2", "force/length^2", "quadratic stiffness"),
        _memoryless(lambda m, _: m.d**2),
        "an offset and second harmonics that grow with amplitude",
    ),
    Kind(
        "gap_contact",
        "clearance, stop, bolt-shank pinning",
        ParameterInfo("k", "force/length", "contact stiffness", 0.0),
        _memoryless(lambda m, g: jnp.sign(m.d) * jnp.maximum(jnp.abs(m.d) - g, 0.0)),
        "a frequency that rises suddenly above some amplitude",
        ParameterInfo("gap", "length", "clearance", 0.0),
        lambda s: (0.3 * s.deflection, 0.7 * s.deflection),
        positive=True,
    ),
    Kind(
        "bilinear_stiffness",
        "opening and closing contact, preload loss in a joint",
        ParameterInfo("dk", "force/length", "stiffness on one side"),
        _memoryless(lambda m, _: jnp.maximum(m.d, 0.0)),
        "an offset and even harmonics that keep their share at every amplitude",
    ),
    Kind(
        "coulomb_friction",
        "dry friction at a support or seal",
        ParameterInfo("k", "force/length", "stiffness before slip", 0.0),
        _slider,
        "damping that falls with amplitude once it slips, stiffness at small amplitude",
        ParameterInfo("slip", "length", "deflection at slip", 0.0),
        lambda s: (0.003 * s.deflection, 0.05 * s.deflection),
        positive=True,
    ),
    Kind(
        "quadratic_damping",
        "drag",
        ParameterInfo("c2", "force*time^2/length^2", "drag coefficient"),
        _memoryless(lambda m, _: m.v * jnp.abs(m.v)),
        "damping that grows in proportion to amplitude",
    ),
    Kind(
        "viscoelastic",
        "elastomer, bungee, seal",
        ParameterInfo("k", "force/length", "stiffness of the spring", 0.0),
        _maxwell,
        "damping and stiffness that depend on frequency, not on amplitude",
        ParameterInfo("tau", "time", "relaxation time", 0.0),
        lambda s: (0.4 * s.period, 2.0 * s.period),
        positive=True,
    ),
)

CATALOGUE: dict[str, Kind] = {kind.name: kind for kind in _KINDS}
"""All kinds by name; :func:`register_kind` adds one's own."""


def register_kind(kind: Kind) -> None:
    """Make a kind of one's own take part in every diagnosis.

    Raises
    ------
    InputError
        For something else than a Kind, or a name that is taken.
    """
    if not isinstance(kind, Kind):
        raise InputError(f"register_kind: expected a Kind, got {type(kind).__name__}")
    if CATALOGUE.setdefault(kind.name, kind) is not kind:
        raise InputError(f"register_kind: {kind.name!r} is taken")


def kinds_of(names: tuple[str, ...] = ()) -> tuple[Kind, ...]:
    """The kinds of these names, all of the catalogue for none.

    Raises
    ------
    InputError
        For an unknown name, with the nearest known one.
    """
    for name in names:
        if name not in CATALOGUE:
            near = difflib.get_close_matches(name, CATALOGUE, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(CATALOGUE)}"
            raise InputError(f"hypotheses: {name!r} is unknown; {hint}")
    return tuple(CATALOGUE[name] for name in names) if names else tuple(CATALOGUE.values())
