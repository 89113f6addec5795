"""A law for what has no name: springs, dampers, sliders, yield and masses side by side."""

from pathlib import Path
from typing import Any, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.files.trees import read_tree, write_tree
from iwanjax.joints.abstract import AbstractJoint, Law, ParameterInfo, named
from iwanjax.joints.discrete import AbstractDiscrete
from iwanjax.joints.duhem import FIRST_BRANCH, DuhemSpring
from iwanjax.joints.masing import masing_loading
from iwanjax.joints.maxwell import Relaxing
from iwanjax.joints.sliders import SliderBank
from iwanjax.joints.unnamed_inertia import Masses
from iwanjax.joints.unnamed_motion import Dampers, RelaxingSprings, SideBySide, Sliders
from iwanjax.joints.unnamed_parts import CYCLE, Bristles, SplineSpring, YieldingSprings
from iwanjax.joints.unnamed_terms import (
    BRISTLES,
    ELASTIC,
    FADING,
    OUTSIDE,
    PARTS,
    RESONANCE,
    SHARES,
    SLIPS,
    TERMS,
    TIMES,
    YIELDS,
)
from iwanjax.types import ArrayLike, as_real, is_traced, real


class UnnamedLaw(AbstractJoint):
    r"""A general law of a place's own motion: a spring, dampers, sliders, yield, masses.

    With :math:`x = d/D` and :math:`u = v/V`

    .. math:: F = S(x) + R(x, u) + \sum_j s_j\,\frac{\sigma_j}{\phi_j}
              + \sum_m r_m\,\frac{q_m}{D} + \sum_l y_l\,\frac{z_l}{\phi_l}
              + \sum_n b_n w_n + m_0\ddot d + m_2(x^2\ddot d + x\dot d\dot x)
              + b\,w

    S is a cubic spline through the origin whose slope may change at each knot, beside
    :math:`x^2` and :math:`x^3`, R a sum of dampers :math:`u/(|u| + \epsilon)`, of both sides of u,
    :math:`u|u|/(|u| + 0.1)`, :math:`u|u|`, :math:`u^3` and :math:`x^2 u`;
    :math:`\sigma_j` are the stretches of sliders that slip at :math:`\phi_j`, and
    :math:`\dot q_m + q_m/\tau_m = v`, and the springs :math:`z_l` yield as those of Bouc and Wen
    with the exponent 2, :math:`\dot z = v\,[1 - (z/\phi)^2]` where that grows and :math:`v` where
    it falls: they unload straight, which no bank of sliders does. Bristles
    :math:`\phi\dot w = v - |v|\,w/g(u)` yield gradually either way (Dahl 1976), some with
    :math:`g = 1`, others the more the faster as dry friction does (Canudas de Wit et al. 1995),
    :math:`g = (1 + 2e^{-(au)^2})/3`. There is a mass and one that grows with the deflection, as
    forces at the acceleration :math:`2\pi V/T`, another that resonates
    (:class:`~iwanjax.joints.AttachedOscillator`), and a spring that yields along a curve of any
    shape, :math:`dw = f(\pm w)\,|dx|` (:class:`~iwanjax.joints.duhem.DuhemSpring`). Beyond D the
    spline goes on straight, beyond 2D and 2V powers as well. All but its strengths are at least
    zero, and :math:`f(w) \le f(-w)` for w > 0, so that no closed cycle feeds energy.

    Parameters
    ----------
    strengths : (terms,) array_like
        Force of each term at x = 1, u = 1 or that acceleration, in the order of
        :data:`~iwanjax.joints.unnamed_terms.TERMS`.
    deflection, rate : float
        D, length, and V, length/time: the largest that it was fitted to.
    period : float
        T, time: of the motion it was fitted to, by which relaxation times are chosen.
    branch : (25,) array_like, optional
        Logarithms of f(-|w|) D at the nodes of w from 0 to 1, then of f(-w)/f(w) at those after 0;
        by default Bouc and Wen's with the exponent 1 and a slip of D.
    resonance : (2,) array_like, optional
        Logarithms of the frequency, over 1/T, and of the damping ratio of the mass that resonates.

    Raises
    ------
    InputError
        For other numbers of strengths, negative ones but of the spring, and scales of zero.
    """

    # A law that was fitted as a whole is no parameter of a fit to curves. Strengths are leaves of
    # their own: one with an axis would be taken for a batch of parameter sets.
    parameters: ClassVar[tuple[ParameterInfo, ...]] = ()

    strengths: tuple[Array, ...] = eqx.field(converter=lambda x: _row(x, "strengths"))
    deflection: Array = eqx.field(converter=named("deflection"))
    rate: Array = eqx.field(converter=named("rate"))
    period: Array = eqx.field(converter=named("period"))
    branch: tuple[Array, ...] = eqx.field(
        converter=lambda x: _row(x, "branch"), default=tuple(FIRST_BRANCH.tolist())
    )
    resonance: tuple[Array, ...] = eqx.field(
        converter=lambda x: _row(x, "resonance"), default=tuple(RESONANCE.tolist())
    )

    @classmethod
    def blank(cls, deflection: float, rate: float, period: float) -> Self:
        """The law without any force, for a place of these largest motions."""
        return cls(np.zeros(len(TERMS)), deflection, rate, period)

    def with_strengths(self, strengths: ArrayLike | tuple[Any, ...]) -> Self:
        """The same with other strengths, (terms,)."""
        scales = self.deflection, self.rate, self.period
        return type(self)(strengths, *scales, self.branch, self.resonance)

    def with_branch(self, branch: ArrayLike) -> Self:
        """The same with another shape of the spring that yields along a curve."""
        scales = self.deflection, self.rate, self.period
        return type(self)(self.strengths, *scales, branch, self.resonance)

    def with_resonance(self, resonance: ArrayLike) -> Self:
        """The same with another frequency and damping of the mass that resonates."""
        scales = self.deflection, self.rate, self.period
        return type(self)(self.strengths, *scales, self.branch, resonance)

    def alone(self, *parts: str) -> Self:
        """Some of the parts by themselves, by their names in ``unnamed_terms.PARTS``."""
        kept = {i for part in parts for i in range(len(TERMS))[PARTS[part]]}
        own = enumerate(self.strengths)
        return self.with_strengths(tuple(x if i in kept else 0.0 for i, x in own))

    def save(self, path: str | Path) -> Path:
        """Write the law to an ``.npz`` file, which studies name by ``file:``."""
        return write_tree(path, self)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what :meth:`save` wrote.

        Raises
        ------
        InputError
            For a file that is missing or damaged, or that holds something else.
        """
        found = read_tree(path)
        if not isinstance(found, cls) or len(found.strengths) != len(TERMS):
            held = f"a {type(found).__name__}"
            raise InputError(f"{path}: holds {held}; expected an {cls.__name__} saved by save()")
        return found

    @property
    def initial_stiffness(self) -> Array:
        """Of the spring, the sliders and what yields, at rest, force/length."""
        return self.law()(jnp.zeros(()))[1]

    @property
    def limit_stiffness(self) -> Array:
        """Mean of the slopes that the spring goes on with, force/length."""
        ends = 2.0 * OUTSIDE * self.deflection * jnp.array([-1.0, 1.0])
        return jnp.mean(self.spring.curve(ends)[1])

    @property
    def spring(self) -> SplineSpring:
        """The elastic part."""
        return SplineSpring.of(jnp.stack(self.strengths[:ELASTIC]), self.deflection)

    @property
    def dampers(self) -> Dampers:
        """Forces of the rate."""
        return Dampers(self.deflection, self.rate, self._of("damper"))

    @property
    def sliders(self) -> Sliders:
        """Each node's strength shared among those about it."""
        phi = self.deflection * SLIPS
        return Sliders(SliderBank(phi, jnp.asarray(SHARES) @ self._of("sliders") / phi))

    @property
    def relaxing(self) -> RelaxingSprings:
        """Springs in series with dashpots."""
        tau = self.period / (2.0 * np.pi) * jnp.asarray(TIMES)
        unit = Relaxing(jnp.ones_like(tau), tau)
        return RelaxingSprings(unit, self._of("relaxation") / self.deflection)

    @property
    def yielding(self) -> YieldingSprings:
        """Springs that yield gradually and unload straight."""
        return YieldingSprings(self._of("yielding"), self.deflection * YIELDS)

    @property
    def bristles(self) -> Bristles:
        """Springs that yield gradually either way, some the more the faster."""
        fading = jnp.asarray(FADING) / self.rate
        return Bristles(self._of("bristles"), self.deflection * BRISTLES, fading)

    @property
    def masses(self) -> Masses:
        """One of constant size, one that grows with the deflection, and one that resonates."""
        force = jnp.concatenate([self._of("inertia"), self._of("resonance")])
        scales = self.deflection, self.rate, self.period
        return Masses.of(force, *scales, jnp.stack(self.resonance))

    @property
    def duhem(self) -> DuhemSpring:
        """A spring that yields along a curve of any shape."""
        force = self.strengths[PARTS["duhem"].start]
        back, held = jnp.split(jnp.stack(self.branch), [FIRST_BRANCH.size // 2 + 1])
        return DuhemSpring.of(force, self.deflection, back, held)

    def _of(self, part: str) -> Array:
        """Strengths of a part."""
        return jnp.stack(self.strengths[PARTS[part]])

    def _acts(self, *parts: str) -> bool:
        """Whether any of these has a strength, or may have: zeros that JAX does not trace are none.

        A search of a few terms is so spared the others: to compile, and in each step.
        """
        strengths = [each for part in parts for each in self.strengths[PARTS[part]]]
        return any(is_traced(each) or bool(each != 0.0) for each in strengths)

    def discrete(self, sliders: int | None = None) -> SideBySide:
        """All parts that have any strength, and the spring, in motion."""
        found: list[AbstractDiscrete] = [self.spring]
        if self._acts("damper"):
            found.append(self.dampers)
        if self._acts("sliders"):
            found.append(self.sliders)
        if self._acts("relaxation"):
            found.append(self.relaxing)
        if self._acts("yielding"):
            found.append(self.yielding)
        if self._acts("bristles"):
            found.append(self.bristles)
        if self._acts("inertia", "resonance"):
            found.append(self.masses)
        if self._acts("duhem"):
            found.append(self.duhem)
        return SideBySide(tuple(found))

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent): the spring, the sliders and what yields."""
        bank = self.sliders.bank
        curves = [self.spring.curve, *(part.curve for part in self._that_yield)]
        curves.append(lambda d: _virgin(bank, d))

        def evaluate(d: Array) -> tuple[Array, Array]:
            forces, tangents = zip(*(curve(d) for curve in curves), strict=True)
            return sum(forces, jnp.zeros_like(d)), sum(tangents, jnp.zeros_like(d))

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Slope from tip to tip of the quasi-static cycle, force/length."""
        amplitude = jnp.abs(real(d))
        at_rest = amplitude == 0
        safe = jnp.where(at_rest, 1.0, amplitude)
        tips = self.loading(safe, safe) - self.loading(-safe, safe)
        return jnp.where(at_rest, self.initial_stiffness, 0.5 * tips / safe)

    def tip_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        """Secant of the spring, tangent of the sliders, and of what yields, force/length."""
        amplitude = jnp.abs(real(d))
        yielded = [part.tip_stiffness(amplitude) for part in self._that_yield]
        held = _virgin(self.sliders.bank, amplitude)[1]
        return self.alone("spring").secant(d) + held + sum(yielded)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Energy lost in a steady harmonic cycle of amplitude |d|, force x length.

        Sliders lose :math:`4k\phi(|d| - \phi)_+` each, relaxing springs
        :math:`\pi k d^2\omega\tau/(1 + \omega^2\tau^2)`, dampers :math:`\oint R\,dd`, yielding
        springs :math:`-k\phi^2[\ln(1 - w^2) + w^2]` to the share w of their slip at the tip,
        bristles of steady slip :math:`4k\phi[|d| - \phi\tanh(|d|/\phi)]`, and the mass that
        resonates as an :class:`~iwanjax.joints.AttachedOscillator`.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        omega : array_like, optional
            Circular frequency, rad/s; without it that of ``period``.
        """
        amplitude = jnp.abs(real(d))
        w = 2.0 * jnp.pi / self.period if omega is None else real(omega)
        bank, relaxing = self.sliders.bank, self.relaxing
        slipped = jnp.maximum(amplitude[..., None] - bank.phi, 0.0)
        lost = 4.0 * jnp.sum(bank.k * bank.phi * slipped, axis=-1)
        lost = lost + self.yielding.cycle(amplitude) + self.bristles.cycle(amplitude, w)
        lost = lost + self.duhem.cycle(amplitude) + self.masses.dissipation(amplitude, w)
        angle = w * relaxing.unit.c
        stored = relaxing.stiffness * angle / (1.0 + angle**2)
        lost = lost + jnp.pi * jnp.sum(stored) * amplitude**2
        phase = 2.0 * np.pi * (np.arange(CYCLE) + 0.5) / CYCLE
        phase = phase.reshape(-1, *(1,) * amplitude.ndim)
        v = w * amplitude * np.cos(phase)
        power = self.dampers.force(amplitude * np.sin(phase), v) * v
        return lost + 2.0 * jnp.pi / w * jnp.mean(power, axis=0)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Loading branch of the quasi-static loop: the spring, the sliders by Masing's rule."""
        to, bank = real(d), self.sliders.bank
        amplitude = jnp.abs(real(d_0))
        held = masing_loading(lambda x: _virgin(bank, x), to, amplitude)
        yielded = [part.loading(to, amplitude) for part in self._that_yield]
        return self.spring.curve(to)[0] + held + sum(yielded)

    @property
    def _that_yield(self) -> list[YieldingSprings | Bristles | DuhemSpring]:
        """Parts that yield gradually and have any strength."""
        found: list[YieldingSprings | Bristles | DuhemSpring] = []
        if self._acts("yielding"):
            found.append(self.yielding)
        if self._acts("bristles"):
            found.append(self.bristles)
        if self._acts("duhem"):
            found.append(self.duhem)
        return found

    def __repr__(self) -> str:
        """How far it was fitted."""
        scales = (self.deflection, self.rate)
        if is_traced(self.strengths, scales):
            return "UnnamedLaw(traced)"
        return f"UnnamedLaw(to |d| = {float(scales[0]):.3g}, |v| = {float(scales[1]):.3g})"

    def __check_init__(self) -> None:
        """Refuse what is no law, or would feed energy."""
        if len(self.branch) != FIRST_BRANCH.size:
            raise InputError(
                f"UnnamedLaw: branch has {len(self.branch)} numbers; expected {FIRST_BRANCH.size}, "
                "two for each node but the first"
            )
        if len(self.resonance) != RESONANCE.size:
            raise InputError(
                f"UnnamedLaw: resonance has {len(self.resonance)} numbers; expected 2, logarithms "
                "of a frequency and of a damping ratio"
            )
        if len(self.strengths) != len(TERMS):
            raise InputError(
                f"UnnamedLaw: strengths has {len(self.strengths)} numbers; expected {len(TERMS)}, "
                "one for each term"
            )
        if is_traced(self.strengths, self.deflection, self.rate, self.period):
            return
        for name in ("deflection", "rate", "period"):
            if not np.all(np.asarray(getattr(self, name)) > 0.0):
                raise InputError(
                    f"UnnamedLaw: {name} = {getattr(self, name)}; expected a positive number"
                )
        least = float(np.min(np.stack(self.branch)[FIRST_BRANCH.size // 2 + 1 :]))
        if not least >= 0.0:
            raise InputError(
                f"UnnamedLaw: a logarithm of f(-w)/f(w) in branch is {least:g}; expected at least "
                "0: less would feed energy"
            )
        for name, strength in list(zip(TERMS, self.strengths, strict=True))[ELASTIC:]:
            if np.any(np.asarray(strength) < 0.0):
                raise InputError(
                    f"UnnamedLaw: the strength of {name} is {float(strength):g}; expected at least "
                    "0: less would feed energy"
                )


def _row(values: ArrayLike | tuple[Any, ...], name: str) -> tuple[Array, ...]:
    """The numbers of a row, one by one."""
    # Some of a tuple may be numbers where others are traced.
    if isinstance(values, tuple) and is_traced(values):
        as_they_are: tuple[Any, ...] = values
        return as_they_are
    row = as_real(values, name)
    # One by one by JAX, each place would be a compilation of its own.
    if is_traced(row):
        return tuple(part[0] for part in jnp.split(row, row.shape[0]))
    return tuple(jax.device_put(list(np.asarray(row))))


def _virgin(bank: SliderBank, d: Array) -> tuple[Array, Array]:
    stretch = jnp.clip(d[..., None], -bank.phi, bank.phi)
    stuck = jnp.where(jnp.abs(d)[..., None] < bank.phi, bank.k, 0.0)
    return jnp.sum(bank.k * stretch, axis=-1), jnp.sum(stuck, axis=-1)
