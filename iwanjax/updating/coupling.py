"""Modes that moved together: each one's curve without what the others do to it."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Parameter
from iwanjax.quasistatic.coupled import coupled_modes
from iwanjax.types import ArrayLike, as_real
from iwanjax.updating.structural import StructuralProblem

# Change of what the others do, over the deviations, root mean square, from which on it has settled:
# a change of so much adds a twentieth to them. Half and twice of it move the parameters of two
# modes of the three masses (tests/studies/test_coupled_fit.py) by up to 0.2 of their deviations.
_SETTLED = 0.3
# Cycles of the slowest mode, and sliders: half of those that coupled_modes takes for its own
# figures. Both terms of a difference have them, so that most of what they miss falls out: half and
# twice the cycles move the same by up to 0.6 of their deviations, twice the sliders by up to 0.8,
# half of them by up to 2.5, which then have twice the deviations.
_CYCLES, _SLIDERS = 20, 40
# Chance of the prior beyond which a parameter is lost: five deviations.
_FAR = 3e-7
_INSTEAD = (
    "Hold what is known (fixed=, for instance K_T by low amplitudes), give hits that move fewer "
    "modes, or fit the recordings themselves (ij.diagnose refits the joints)"
)


@dataclass(frozen=True, eq=False)
class ModalCoupling:
    """What the other modes that move at the same time do to a curve.

    Attributes
    ----------
    mode : int
        The curve's own.
    modes : tuple of int
        The others.
    amplitude : (levels, modes) array
        Their modal displacement at each level.
    frequency, damping : (levels,) array
        What they add to the mode's own, Hz and 1.
    frequency_change, damping_change : (levels,) array
        How much of that is in doubt, part of the curve's deviations: what it moved by with the last
        fit, all where no motion was found.
    """

    mode: int
    modes: tuple[int, ...]
    amplitude: Float[np.ndarray, "levels modes"]
    frequency: Float[np.ndarray, " levels"]
    damping: Float[np.ndarray, " levels"]
    frequency_change: Float[np.ndarray, " levels"]
    damping_change: Float[np.ndarray, " levels"]

    def taken_off(self, curves: ModalCurves) -> ModalCurves:
        """The curve as it were with the mode alone."""
        f, zeta = (np.asarray(x) for x in (curves.frequency, curves.damping))
        kept = zeta - self.damping
        # Where a model that is still wrong takes off more than there is, nothing is known.
        positive = kept > 0.0
        doubt = np.where(positive, self.damping_change, zeta)
        return eqx.tree_at(
            lambda c: (c.frequency, c.damping, c.frequency_std, c.damping_std),
            curves,
            (
                f - self.frequency,
                np.where(positive, kept, zeta),
                np.hypot(np.asarray(curves.frequency_std), self.frequency_change),
                np.hypot(np.asarray(curves.damping_std), doubt),
            ),
        )

    @property
    def begun(self) -> "ModalCoupling":
        """By a model that was fitted to nothing: nothing to take off, all of it in doubt."""
        return replace(
            self,
            frequency=0.0 * self.frequency,
            damping=0.0 * self.damping,
            frequency_change=np.abs(self.frequency) + self.frequency_change,
            damping_change=np.abs(self.damping) + self.damping_change,
        )

    def after(self, last: "ModalCoupling", step: float) -> "ModalCoupling":
        """So far from the last one towards this one, and all of their difference in doubt."""
        f, zeta = self.frequency - last.frequency, self.damping - last.damping
        return replace(
            self,
            frequency=last.frequency + step * f,
            damping=last.damping + step * zeta,
            frequency_change=np.abs(f) + self.frequency_change,
            damping_change=np.abs(zeta) + self.damping_change,
        )

    def told(self) -> str:
        """What was taken off the curve at most, in words; nothing where the mode moved alone."""
        if not np.any(self.frequency) and not np.any(self.damping):
            return ""
        most = [x[np.argmax(np.abs(x))] for x in (self.frequency, self.damping)]
        others = " and ".join(str(mode) for mode in self.modes)
        return (
            f"Mode {self.mode} is without what {'modes' if len(self.modes) > 1 else 'mode'} "
            f"{others} did to it at the same time: {most[0]:+.2g} Hz and {most[1]:+.2g} of damping "
            f"at most, in doubt by {np.max(np.abs(self.frequency_change)):.1g} Hz and "
            f"{np.max(np.abs(self.damping_change)):.1g}."
        )

    def settled(self, curves: ModalCurves) -> bool:
        """Whether the last fit has changed it by next to nothing of the curve's deviations."""
        shares = [
            change / np.asarray(std)
            for change, std in (
                (self.frequency_change, curves.frequency_std),
                (self.damping_change, curves.damping_std),
            )
        ]
        return bool(np.sqrt(np.mean(np.square(shares))) <= _SETTLED)


def checked_beside(
    beside: Sequence[Mapping[int, ArrayLike] | None],
    curves: Sequence[ModalCurves],
    own: Sequence[int],
) -> list[dict[int, Float[np.ndarray, " levels"]]]:
    """The other modes' amplitudes of each curve as arrays.

    Raises
    ------
    InputError
        For another number of curves, a curve's own mode, and amplitudes of another length,
        negative ones or NaN.
    """
    if len(beside) != len(curves):
        raise InputError(
            f"fit: beside is for {len(beside)} curve(s); expected {len(curves)}, one mapping for "
            "each, empty where the mode moved alone"
        )
    found = []
    for i, (others, each, mode) in enumerate(zip(beside, curves, own, strict=True)):
        row = {}
        for other, values in (others or {}).items():
            A = np.asarray(as_real(values, f"beside[{i}][{other}]"))
            if other == mode:
                raise InputError(f"beside[{i}] names mode {other}, which the curve is of")
            if A.shape != each.amplitude.shape or not np.all(np.isfinite(A) & (A >= 0.0)):
                raise InputError(
                    f"beside[{i}][{other}]: expected {each.amplitude.size} amplitudes, none "
                    f"negative, one for each level; got shape {A.shape}"
                )
            row[other] = A
        found.append(row)
    return found


def couplings(
    problem: StructuralProblem,
    theta: np.ndarray,
    beside: Sequence[Mapping[int, np.ndarray]],
) -> list[ModalCoupling]:
    """What the others do to each curve, by these parameters (:func:`iwanjax.coupled_modes`)."""
    values = jnp.asarray(theta)
    structure, background = problem.jointed(values), problem.background(values)
    q = np.asarray(problem.measured.q)
    found = []
    for part, mode, zeta, others in zip(
        problem.measured.slices, problem.modes, np.asarray(background), beside, strict=True
    ):
        own = q[part][:, None]
        A = np.stack([*others.values()], axis=1) if others else np.zeros((len(own), 0))
        added, doubt = np.zeros((2, 2, len(own)))
        if np.any(A):
            moving = coupled_modes(
                structure,
                np.hstack([own, A]),
                # Of the others the damping does not matter here: their amplitudes are measured.
                zeta,
                modes=[mode, *others],
                cycles=_CYCLES,
                sliders=_SLIDERS,
            )
            alone = coupled_modes(
                structure, own, zeta, modes=[mode], cycles=_CYCLES, sliders=_SLIDERS
            )
            known = np.asarray(moving.converged & alone.converged)
            both, one = (
                np.stack([np.asarray(each.frequency)[:, 0], np.asarray(each.damping)[:, 0]])
                for each in (moving, alone)
            )
            # Where parameters that are far off leave no motion to be found, nothing is known.
            added, doubt = np.where(known, both - one, 0.0), np.where(known, 0.0, np.abs(one))
        found.append(ModalCoupling(mode, tuple(others), A, *added, *doubt))
    return found


def refuse_lost(parameters: Sequence[Parameter], active: Container[str]) -> None:
    """With such parameters what modes do to one another means nothing.

    Raises
    ------
    InputError
    """
    for p in parameters:
        if p.fixed or p.name in active:
            continue
        low, high = p.prior.quantile(np.array([_FAR, 1.0 - _FAR]))
        if not low <= p.value <= high:
            raise InputError(
                f"fit: the levels that other modes leave alone do not hold {p.name}, which went to "
                f"{p.value:.3g} (started around {p.prior.quantile(np.array(0.5)):.3g}). {_INSTEAD}"
            )


def refuse_ruled(
    coupling: Sequence[ModalCoupling], curves: Sequence[ModalCurves], settled: bool
) -> None:
    """Curves that others rule hold no joint: several ends explain them, each with its own share.

    A fit by turns between such ends goes from one to the next, and does not settle.

    Raises
    ------
    InputError
    """
    for own, each in zip(coupling, curves, strict=True):
        share = float(np.median(np.abs(own.damping) / np.asarray(each.damping)))
        if share > 1.0:
            raise InputError(
                f"fit: what other modes do to mode {own.mode} is {share:.1f} times the damping "
                f"that was measured, in the middle of its levels: they rule its joints. {_INSTEAD}"
            )
    if not settled:
        raise InputError(
            "fit: what the modes do to one another still changes from one fit to the next: they "
            f"rule one another's curves. {_INSTEAD}"
        )
