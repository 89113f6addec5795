"""What a general law is like: in words by the forces of its parts, and by the names nearest it."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.effects.kinds import ForceKind, JointKind, Kind
from iwanjax.estimation.settings import SEARCH
from iwanjax.identification.joint_priors import Joint, located, unknown
from iwanjax.joints import AbstractJoint, PlaceMotion, UnnamedLaw, hysteresis
from iwanjax.joints.force_law import Scales
from iwanjax.joints.unnamed_terms import PARTS
from iwanjax.settings.stages import settings


def described(law: UnnamedLaw, motion: PlaceMotion, parts: Mapping[str, np.ndarray]) -> str:
    """The law in words, by what each part's force is of all of it in the recordings.

    Parameters
    ----------
    law : UnnamedLaw
        As fitted.
    motion : PlaceMotion
        Of its place, (recordings, N).
    parts : mapping of str to (recordings, N) array
        Force of each part in that motion.
    """
    size = {name: _size(force) for name, force in parts.items()}
    whole = np.sum(list(parts.values()), axis=0)
    share = settings().judgement.neighbour
    acting = {name for name, each in size.items() if each > share * _size(whole)}
    words = _words(law, motion, parts, acting)
    if acting != {"spring"} or "linear" not in words:
        return ", ".join(words)
    # That has a name: what speaks against it is weaker.
    others = {name: each for name, each in size.items() if name != "spring"}
    most = max(others.values())
    if most < _size(_bent(np.asarray(motion.d), parts["spring"])):
        return "elastic, nearly linear, no memory"
    weaker = {name for name, each in others.items() if each > share * most}
    return f"elastic, linear, and weaker: {', '.join(_words(law, motion, parts, weaker))}"


def _words(
    law: UnnamedLaw, motion: PlaceMotion, parts: Mapping[str, np.ndarray], acting: set[str]
) -> list[str]:
    """What parts of a law are like."""
    elastic, reach, words = {"spring"}, float(np.max(np.abs(motion.d))), []
    if "duhem" in acting and not _loses(law, reach):
        elastic, acting = {"spring", "duhem"}, acting - {"duhem"} | {"spring"}
    if "spring" in acting:
        words += ["elastic", *_shape(law.alone(*elastic), reach)]
    if "damper" in acting:
        dampers = np.array(law.strengths[PARTS["damper"]])
        # The last of them is the one that the deflection opens.
        if dampers[-1] > settings().judgement.neighbour * np.sum(dampers):
            words.append("damping that grows with the deflection")
        else:
            words.append(_growth(np.asarray(motion.v), parts["damper"]))
    fading = acting & {"bristles"} and bool(_fading(law) > settings().judgement.neighbour)
    if acting & {"sliders", "yielding", "duhem"} or ("bristles" in acting and not fading):
        words.append("rate-independent hysteresis")
    if "duhem" in acting and _pinched(law):
        words.append("pinched")
    if fading:
        words.append("friction that weakens with the rate")
    if "relaxation" in acting:
        words.append("a force that relaxes with time")
    if "inertia" in acting:
        words.append("inertia that grows with the deflection" if _grows(law) else "inertia")
    if "resonance" in acting:
        frequency, ratio = np.exp(np.stack(law.resonance)) / [float(law.period), 1.0]
        words.append(f"a resonance at {frequency:.3g} Hz with a damping ratio of {ratio:.2g}")
    if not acting & {"sliders", "relaxation", "yielding", "bristles", "duhem", "resonance"}:
        words.append("no memory")
    return words


def _bent(d: np.ndarray, force: np.ndarray) -> np.ndarray:
    """What of a spring's force is in no proportion to the deflection."""
    return force - d * (np.vdot(force, d) / max(np.vdot(d, d), 1e-300))


def _size(force: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(force))))


def _fading(law: UnnamedLaw) -> float:
    """By how much less the bristles hold at the largest rate than at little of it."""
    bristles = law.bristles
    slow, fast = (
        float(jnp.sum(bristles.force * bristles.limit(share * law.rate)))
        for share in (settings().judgement.neighbour, 1.0)
    )
    return 1.0 - fast / max(slow, 1e-300)


def _loses(law: UnnamedLaw, reach: float) -> bool:
    """Whether cycles of what yields along a curve lose more than little of what dry friction does.

    Up and down the same curve, about the same force, it is a spring.
    """
    duhem = law.alone("duhem")
    whole = 4.0 * reach * float(duhem.loading(reach, reach))
    return float(duhem.dissipation(reach)) > settings().judgement.neighbour * whole


def _pinched(law: UnnamedLaw) -> bool:
    """Whether a branch that grows away from zero stiffens again, as where something closes."""
    f = np.asarray(law.duhem.f)
    onward = f[f.size // 2 :]
    least = np.minimum.accumulate(onward)
    return bool(np.any(onward > (1.0 + settings().judgement.neighbour) * least))


def _grows(law: UnnamedLaw) -> bool:
    """Whether the mass that grows is more than little of both."""
    constant, growing = np.array(law.strengths[PARTS["inertia"]])
    return bool(growing > settings().judgement.neighbour * (constant + growing))


def _shape(spring: UnnamedLaw, reach: float) -> list[str]:
    """How a spring departs from a straight line, over the deflections that were reached."""
    share = settings().judgement.neighbour
    d = reach * np.linspace(0.0, 1.0, 41)[1:]
    up, down = np.asarray(spring.backbone(d)), -np.asarray(spring.backbone(-d))
    odd, even = 0.5 * (up + down), 0.5 * (up - down)
    found = []
    if np.max(np.abs(even)) > share * np.max(np.abs(odd)):
        weak, strong = sorted((np.max(np.abs(up)), np.max(np.abs(down))))
        found.append("one-sided" if weak < share * strong else "asymmetric")
    secant = odd / d
    largest = np.max(np.abs(secant))
    if abs(secant[0]) < share * largest:
        power = _power(d, odd)
        words = f"rising with the deflection to the power {power:.1f}"
        found.append("with a clearance" if math.isnan(power) else words)
    elif secant[-1] < secant[0] - share * largest:
        found.append("softening")
    elif secant[-1] > secant[0] + share * largest:
        found.append("hardening")
    else:
        found.append("linear")
    return found


def _power(d: np.ndarray, force: np.ndarray) -> float:
    """Of the deflection, by its larger half; NaN where no power follows the force from there on."""
    x, y = np.log(d / d[-1]), np.log(np.maximum(np.abs(force / force[-1]), 1e-300))
    half = x > math.log(0.5)
    power = float(np.vdot(x[half], y[half]) / np.vdot(x[half], x[half]))
    off = np.max(np.abs(np.exp(power * x) - np.exp(y)))
    return power if off < settings().judgement.neighbour else math.nan


def _growth(v: np.ndarray, force: np.ndarray) -> str:
    """With which power of the rate, by a straight line through logarithms of its larger values."""
    large = np.abs(v) > settings().judgement.neighbour * np.max(np.abs(v))
    x, y = np.log(np.abs(v[large])), np.log(np.maximum(np.abs(force[large]), 1e-300))
    power = float(np.polyfit(x, y, 1)[0])
    if abs(power - 1.0) <= settings().judgement.neighbour:
        return "damping in proportion to the rate"
    return f"damping that grows with the rate to the power {power:.1f}"


def nearest(
    kinds: Sequence[Kind], seen: Scales, motion: PlaceMotion, force: np.ndarray
) -> dict[str, float]:
    r"""Named kinds by how nearly each makes the law's force in the same motion.

    Of the share :math:`r` of the force that a kind's best size and shape leave the odds against
    none of the names are :math:`(0.1/r)^4`, as for any neighbour of the truth
    (:class:`~iwanjax.settings.judgement.JudgementSettings`).

    Parameters
    ----------
    kinds : sequence of Kind
        To be tried: forces, and joints left out of which all parameters are fitted.
    seen : Scales
        What the place has seen.
    motion : PlaceMotion
        Of the place, (recordings, N).
    force : (recordings, N) array
        Of the law.

    Returns
    -------
    dict of str to float
        Probabilities, the largest first; what is missing to 1 is that none is right.
    """
    known, odds = settings().judgement, {}
    whole = max(float(np.sum(force**2)), 1e-300)
    forces = [kind for kind in kinds if isinstance(kind, ForceKind)]
    shares = [(kind.name, math.sqrt(_left(kind, motion, force) / whole)) for kind in forces]
    shares += [(e.kind.name, e.share) for e in nearest_laws(kinds, seen, motion, force)]
    for name, share in shares:
        own = (known.neighbour / max(share, 1e-6)) ** known.sharpness
        odds[name] = max(own, odds.get(name, 0.0))
    total = 1.0 + sum(odds.values())
    ordered = sorted(odds.items(), key=lambda each: -each[1])
    return {name: each / total for name, each in ordered[: known.listed]}


class NearLaw(NamedTuple):
    """A joint left out that makes about the force of a law.

    Attributes
    ----------
    kind : JointKind
        Its name.
    law : AbstractJoint
        With its parameters.
    share : float
        Of the force, root mean square, that it leaves.
    """

    kind: JointKind
    law: AbstractJoint
    share: float


def nearest_laws(
    kinds: Sequence[Kind], seen: Scales, motion: PlaceMotion, force: np.ndarray
) -> list[NearLaw]:
    """Joints left out whose forces are nearest to a law's, the nearest first.

    All of their parameters are fitted to the force, from those beginnings of a search of each that
    are nearest to it already: a search costs hundreds of times what a look at its beginning does.

    Parameters
    ----------
    kinds, seen, motion, force
        As for :func:`nearest`.
    """
    found = []
    for kind in kinds:
        # What K holds already makes no force of its own here.
        if not isinstance(kind, JointKind) or kind.law is None or kind.within:
            continue
        begun = kind.law.begun(seen, **dict(kind.held))
        joint = unknown(begun[-1])
        values = [{p.name: float(getattr(each, p.name)) for p in each.parameters} for each in begun]
        starts = np.stack([located(joint, each) for each in values])
        along = jax.device_put((motion, force))
        off = np.asarray(_shares_left(joint, jax.device_put(starts), *along))
        near = np.argsort(off, kind="stable")[: settings().histories.joint_faults.near]
        ends, left = map(np.asarray, _nearest_of(joint, jax.device_put(starts[near]), *along))
        best = int(np.argmin(left))
        law = jax.device_get(joint.at(jax.device_put(ends[best])))
        found.append(NearLaw(kind, law, math.sqrt(float(left[best]))))
    return sorted(found, key=lambda each: each.share)


@eqx.filter_jit
def _shares_left(joint: Joint, z: Array, motion: PlaceMotion, force: Array) -> Array:
    """What share of the force's squares each of some z leaves as it is, (z,)."""
    return jax.vmap(lambda each: _share_left(_off(joint, each, motion, force)))(z)


@eqx.filter_jit
def _nearest_of(joint: Joint, z: Array, motion: PlaceMotion, force: Array) -> tuple[Array, Array]:
    """Ends of searches from some z, and what share of the force's squares each leaves."""
    import optimistix as optx  # here, because few need it and it is slow to import

    def off(z: Array, _: None) -> Array:
        return _off(joint, z, motion, force)

    def one(z: Array) -> tuple[Array, Array]:
        solver = optx.LevenbergMarquardt(rtol=SEARCH.host_tolerance, atol=SEARCH.host_tolerance)
        end = optx.least_squares(off, solver, z, max_steps=SEARCH.most_steps, throw=False).value
        return end, _share_left(off(end, None))

    return jax.lax.map(one, z)


def _off(joint: Joint, z: Array, motion: PlaceMotion, force: Array) -> Array:
    """Of a force, by how much of all of it a joint differs from it at each sample."""
    made = hysteresis(joint.at(z), motion.d, sliders=None, dt=motion.dt)
    return jnp.ravel(made - force) / jnp.maximum(jnp.linalg.norm(force), 1e-300)


def _share_left(off: Array) -> Array:
    """Sum of squares; infinite where it is no number."""
    left = jnp.sum(off**2)
    return jnp.where(jnp.isfinite(left), left, jnp.inf)


class SizedLaw(NamedTuple):
    """A named law of some size and shape.

    Attributes
    ----------
    kind : ForceKind
        Its name.
    size, shape : float
        As a search takes them.
    """

    kind: ForceKind
    size: float
    shape: float

    def force(self, motion: PlaceMotion) -> np.ndarray:
        """Along a motion, (recordings, N)."""
        return self.size * np.asarray(_unit_forces(self.kind, jnp.array([self.shape]), motion))[0]


def nearest_pairs(
    kinds: Sequence[ForceKind], motion: PlaceMotion, force: np.ndarray
) -> list[tuple[SizedLaw, SizedLaw]]:
    """Two different names whose forces together are nearest to a law's, the best pairs first.

    Parameters
    ----------
    kinds, motion, force
        As for :func:`nearest`.

    Returns
    -------
    list of pairs
        Each of two names once, in either form, of the best shapes on their grids.
    """
    columns, owners = [np.zeros((0, force.size))], []
    for kind in kinds:
        shapes, unit = _on_grid(kind, motion)
        unit = unit.reshape(len(unit), -1)
        sound = np.flatnonzero(np.all(np.isfinite(unit), axis=1) & np.any(unit != 0.0, axis=1))
        columns.append(unit[sound])
        owners += [(kind, float(shapes[i])) for i in sound]
    X = np.concatenate(columns)
    along, square = X @ np.ravel(force), np.maximum(np.sum(X**2, axis=1), 1e-300)
    positive = np.array([kind.positive for kind, _ in owners])
    found: dict[frozenset[int], tuple[float, tuple[SizedLaw, SizedLaw]]] = {}
    for i, (first, shape) in enumerate(owners):
        both = X @ X[i]
        rest = np.maximum(square - both**2 / square[i], 1e-9 * square)
        size = (along - both * along[i] / square[i]) / rest
        own = (along[i] - both * size) / square[i]
        taken = own * along[i] + size * along
        taken[(positive & (size < 0.0)) | (positive[i] & (own < 0.0))] = -math.inf
        for j in np.argsort(-taken, kind="stable").tolist():
            second, other = owners[j]
            if second is first or not math.isfinite(taken[j]):
                continue
            pair = SizedLaw(first, float(own[j]), shape), SizedLaw(second, float(size[j]), other)
            key = frozenset((id(first), id(second)))
            if key not in found or taken[j] > found[key][0]:
                found[key] = (float(taken[j]), pair)
            # Behind it are pairs of this first law that are worse.
            break
    return [pair for _, pair in sorted(found.values(), key=lambda each: -each[0])]


def _on_grid(kind: ForceKind, motion: PlaceMotion) -> tuple[np.ndarray, np.ndarray]:
    """Shapes about where a search begins, and forces of size 1, (shapes, recordings, N)."""
    largest = float(np.max(np.abs(motion.d)))
    rate = max(float(np.max(np.abs(motion.v))), 1e-300)
    starts = kind.shapes(Scales(largest, 2.0 * np.pi * largest / rate))
    around = 10.0 ** np.linspace(-1.0, 1.0, 9) if kind.shape is not None else np.ones(1)
    shapes = np.unique(np.outer(starts, around))
    return shapes, np.asarray(_unit_forces(kind, jnp.asarray(shapes), motion))


def _left(kind: ForceKind, motion: PlaceMotion, force: np.ndarray) -> float:
    """Sum of squares that the best size and shape leave, the shape on a grid about its starts."""
    _, unit = _on_grid(kind, motion)
    along, alone = np.einsum("srn,rn->s", unit, force), np.einsum("srn,srn->s", unit, unit)
    size = along / np.maximum(alone, 1e-300)
    size = np.maximum(size, 0.0) if kind.positive else size
    left = np.sum(force**2) - 2.0 * size * along + size**2 * alone
    left = left[np.isfinite(left)]
    return float(np.min(left, initial=np.sum(force**2)))


@eqx.filter_jit
def _unit_forces(kind: ForceKind, shapes: Array, motion: PlaceMotion) -> Array:
    """Forces of size 1, (shapes, recordings, N)."""
    d, v, a, moved = (jnp.moveaxis(x, -1, 0) for x in motion[:4])
    shape = shapes[:, None]

    def step(memory: Array, at: tuple[Array, Array, Array, Array]) -> tuple[Array, Array]:
        place = PlaceMotion(at[0], at[1], at[2], at[3], motion.dt)
        unit, memory = kind.unit_force(place, shape, memory)
        still = jnp.zeros((len(shapes), at[0].shape[0]))
        return memory + still, unit + still

    none = jnp.zeros((len(shapes), d.shape[1]))
    return jnp.moveaxis(jax.lax.scan(step, none, (d, v, a, moved))[1], 0, -1)
