"""What may be missing from a model: each kind of physics with its force and its signs."""

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.discrepancy.nested import (
    MAXWELL,
    SLIDING_JOINT,
    STUCK_JOINT,
    STUCK_SLIDER,
    TURNED,
    WRONG_SIGN,
    Nested,
    Scales,
    closed_gap,
)
from iwanjax.errors import InputError
from iwanjax.joints import ParameterInfo
from iwanjax.joints.iwan import IWAN_PARAMETERS


class PlaceMotion(NamedTuple):
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


UnitForce: TypeAlias = Callable[[PlaceMotion, Array, Array], tuple[Array, Array]]
"""(motion, shape, memory) -> (force per unit size, memory), elementwise over places."""


@dataclass(frozen=True)
class ForceKind:
    """One kind of missing physics: a force size * unit_force at some place of the structure.

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
    inertial : bool
        Whether the force is in proportion to the place's acceleration.
    variant : str
        Which of several forms of the same name, in words; empty for the only one.
    limits : tuple of Nested
        Simpler kinds that it becomes at the ends of its shape's range: where one of them does
        all but as well, that one is named.
    """

    name: str
    usual: str
    size: ParameterInfo
    unit_force: UnitForce
    signs: str
    shape: ParameterInfo | None = None
    shapes: Callable[[Scales], tuple[float, ...]] = lambda scales: (1.0,)
    positive: bool = False
    inertial: bool = False
    variant: str = ""
    limits: tuple[Nested, ...] = ()


@dataclass(frozen=True)
class SensorKind:
    """One kind of fault of the measurement chain; it acts on what is predicted, not on the data.

    Parameters
    ----------
    name, usual, size, signs
        As for :class:`ForceKind`.
    acts : {"gain", "delay", "limit"}
        What is wrong with a sensor: a factor 1 + size, a delay in seconds, or the largest value
        that it shows.
    fixed : float, optional
        The size, where there is nothing to fit.
    positive : bool
        Whether a negative size means nothing.
    limits : tuple of Nested
        Simpler kinds that it becomes at one size: with nothing to fit.
    """

    name: str
    usual: str
    size: ParameterInfo
    signs: str
    acts: Literal["gain", "delay", "limit"]
    fixed: float | None = None
    positive: bool = False
    limits: tuple[Nested, ...] = ()


@dataclass(frozen=True)
class JointKind:
    """One kind of fault of the model's joints, or a joint too few.

    Parameters
    ----------
    name, usual, signs
        As for :class:`ForceKind`.
    parameters : tuple of ParameterInfo
        What is fitted.
    limits : tuple of Nested
        As for :class:`ForceKind`.
    """

    name: str
    usual: str
    parameters: tuple[ParameterInfo, ...]
    signs: str
    limits: tuple[Nested, ...] = ()


@dataclass(frozen=True)
class ModeKind:
    """One way in which a mode's own joint is not its own: what else moves it.

    Parameters
    ----------
    name, usual, size, signs
        As for :class:`ForceKind`.
    limits : tuple of Nested
        As for :class:`ForceKind`.
    """

    name: str
    usual: str
    size: ParameterInfo
    signs: str
    limits: tuple[Nested, ...] = ()
    # There is nothing about it beside its size.
    shape: ClassVar[None] = None


Kind: TypeAlias = ForceKind | SensorKind | JointKind | ModeKind


def _memoryless(law: Callable[[PlaceMotion, Array], Array]) -> UnitForce:
    return lambda motion, shape, memory: (law(motion, shape), memory)


def _slider(motion: PlaceMotion, slip: Array, stretch: Array) -> tuple[Array, Array]:
    stretch = jnp.clip(stretch + motion.moved, -slip, slip)
    return stretch, stretch


def _maxwell(motion: PlaceMotion, tau: Array, stretch: Array) -> tuple[Array, Array]:
    # Exact for a rate that changes evenly over the step, to where it is at the end: with a rate
    # that stays as it is, a damper would lag by half a step.
    x = motion.dt / tau
    whole = -jnp.expm1(-x) / x
    ramp = (1.0 - whole) / x
    share = 2.0 * (whole - ramp)
    stretch = jnp.exp(-x) * stretch + share * motion.moved + (whole - share) * motion.dt * motion.v
    return stretch, stretch


_KINDS: tuple[Kind, ...] = (
    ForceKind(
        "stiffness_error",
        "wrong or missing linear stiffness, boundary",
        ParameterInfo("k", "force/length", "stiffness"),
        _memoryless(lambda m, _: m.d),
        "a frequency that is off at every amplitude",
    ),
    ForceKind(
        "mass_error",
        "unmodelled mass (sensor, cable, fixture)",
        ParameterInfo("m", "mass", "mass"),
        _memoryless(lambda m, _: m.a),
        "frequencies that are off at every amplitude, the higher the more",
        inertial=True,
    ),
    ForceKind(
        "viscous_damping",
        "unmodelled linear damper",
        ParameterInfo("c", "force*time/length", "viscous coefficient"),
        _memoryless(lambda m, _: m.v),
        "damping that is off at every amplitude",
    ),
    ForceKind(
        "cubic_stiffness",
        "hardening or softening, geometric",
        ParameterInfo("k3", "force/length^3", "cubic stiffness"),
        _memoryless(lambda m, _: m.d**3),
        "a frequency that changes with the square of the amplitude; third harmonics",
    ),
    ForceKind(
        "quadratic_stiffness",
        "asymmetric elastic force, curvature",
        ParameterInfo("k2", "force/length^2", "quadratic stiffness"),
        _memoryless(lambda m, _: m.d**2),
        "an offset and second harmonics that grow with amplitude",
    ),
    *(
        ForceKind(
            "gap_contact",
            "clearance, stop, bolt-shank pinning",
            ParameterInfo("k", "force/length", "contact stiffness", 0.0),
            _memoryless(law),
            "a frequency that rises suddenly above some amplitude",
            ParameterInfo("gap", "length", "clearance", 0.0),
            lambda s: (0.3 * s.deflection, 0.7 * s.deflection),
            positive=True,
            variant=variant,
            limits=limits,
        )
        for variant, limits, law in (
            (
                "",
                (closed_gap("stiffness_error"),),
                lambda m, g: jnp.sign(m.d) * jnp.maximum(jnp.abs(m.d) - g, 0.0),
            ),
            (
                "where d > 0",
                (closed_gap("bilinear_stiffness"),),
                lambda m, g: jnp.maximum(m.d - g, 0.0),
            ),
            ("where d < 0", (), lambda m, g: -jnp.maximum(-m.d - g, 0.0)),
        )
    ),
    ForceKind(
        "bilinear_stiffness",
        "opening and closing contact, preload loss in a joint",
        ParameterInfo("dk", "force/length", "stiffness on one side"),
        _memoryless(lambda m, _: jnp.maximum(m.d, 0.0)),
        "an offset and even harmonics that keep their share at every amplitude",
    ),
    ForceKind(
        "coulomb_friction",
        "dry friction at a support or seal",
        ParameterInfo("k", "force/length", "stiffness before slip", 0.0),
        _slider,
        "damping that falls with amplitude once it slips, stiffness at small amplitude",
        ParameterInfo("slip", "length", "deflection at slip", 0.0),
        lambda s: (0.003 * s.deflection, 0.05 * s.deflection),
        positive=True,
        limits=(STUCK_SLIDER,),
    ),
    ForceKind(
        "quadratic_damping",
        "drag",
        ParameterInfo("c2", "force*time^2/length^2", "drag coefficient"),
        _memoryless(lambda m, _: m.v * jnp.abs(m.v)),
        "damping that grows in proportion to amplitude",
    ),
    ForceKind(
        "viscoelastic",
        "elastomer, bungee, seal",
        ParameterInfo("k", "force/length", "stiffness of the spring", 0.0),
        _maxwell,
        "damping and stiffness that depend on frequency, not on amplitude",
        ParameterInfo("tau", "time", "relaxation time", 0.0),
        lambda s: (0.4 * s.period, 2.0 * s.period),
        positive=True,
        limits=MAXWELL,
    ),
    SensorKind(
        "sensor_gain",
        "calibration of a sensor",
        ParameterInfo("gain_error", "1", "factor of the sensor less one"),
        "one sensor off by the same share at every frequency and amplitude",
        "gain",
        limits=(WRONG_SIGN,),
    ),
    SensorKind(
        "sensor_delay",
        "delay of a filter in one channel",
        ParameterInfo("delay", "time", "by which the sensor is late", 0.0),
        "one sensor whose phase lags in proportion to frequency",
        "delay",
        positive=True,
    ),
    SensorKind(
        "sensor_saturation",
        "overload of an amplifier",
        ParameterInfo("limit", "sensor", "largest value that the sensor shows", 0.0),
        "peaks of one sensor that are cut at one level",
        "limit",
    ),
    SensorKind(
        "sensor_polarity",
        "sensor mounted or wired the wrong way round",
        ParameterInfo("factor", "1", "factor of the sensor less one"),
        "one sensor with the opposite sign",
        "gain",
        fixed=TURNED,
    ),
    JointKind(
        "stiction",
        "static and kinetic friction that differ",
        (ParameterInfo("theta", "1", "kinetic over static friction", 0.0, upper=1.0),),
        "less damping after large amplitudes than the joint's growth would have it",
    ),
    JointKind(
        "joint_drift",
        "bolt loosening, wear-in, temperature",
        (
            ParameterInfo("F_S_change", "1", "of ln F_S from recording to recording"),
            ParameterInfo("K_T_change", "1", "of ln K_T from recording to recording"),
        ),
        "recordings that each want another strength of one joint",
    ),
    JointKind(
        "iwan_joint",
        "a joint left out",
        IWAN_PARAMETERS,
        "microslip where no joint is",
        (SLIDING_JOINT, STUCK_JOINT),
    ),
    ModeKind(
        "modal_coupling",
        "a joint that several modes move at once",
        ParameterInfo("ratio", "1", "the joint's deflection by the other mode over that by this"),
        "hits that differ at equal amplitude, the lower in frequency the more another mode moves",
    ),
)

CATALOGUE: dict[str, tuple[Kind, ...]] = {}
"""All kinds by name, each with its variants; :func:`register_kind` adds one's own."""
for _kind in _KINDS:
    CATALOGUE[_kind.name] = (*CATALOGUE.get(_kind.name, ()), _kind)


def shipped(kind: Kind) -> bool:
    """Whether a kind is one of the package's own."""
    return any(kind is own for own in _KINDS)


def register_kind(kind: ForceKind) -> None:
    """Make a kind of one's own take part in every diagnosis.

    Raises
    ------
    InputError
        For something else than a ForceKind, or a name that is taken.
    """
    if not isinstance(kind, ForceKind):
        raise InputError(f"register_kind: expected a ForceKind, got {type(kind).__name__}")
    if CATALOGUE.setdefault(kind.name, (kind,)) != (kind,):
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
    return tuple(kind for name in names or CATALOGUE for kind in CATALOGUE[name])
