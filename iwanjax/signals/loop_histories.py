"""Loops side by side, drawn by few values, as a fit takes them."""

import math
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.settings.stages import settings
from iwanjax.signals.force_loop import ForceLoop


class LoopHistories(eqx.Module):
    """Loops side by side, each after what leads to it from rest.

    Attributes
    ----------
    d, force : (loops, N) array
        Deflections and forces; where a loop has none, the last deflection again.
    weight : (loops, N) array
        One over the force's deviation; zero where it was not measured, or held out.
    dt : (loops, N) array or None
        Time from the value before to each, s; None where a loop has no time.
    times : (2, loops) array
        Period of the cycles and duration of each loop, s.
    channels : dict of str to (loops, N) array
        What else was recorded; where a loop has none, its first or its last value again.
    """

    d: Float[Array, "loops N"]
    force: Float[Array, "loops N"]
    weight: Float[Array, "loops N"]
    dt: Float[Array, "loops N"] | None = None
    times: Float[Array, "2 loops"] | None = None
    channels: dict[str, Float[Array, "loops N"]] = eqx.field(default_factory=dict)

    @property
    def largest(self) -> float:
        """Largest deflection."""
        return float(jnp.max(jnp.abs(self.d)))

    @property
    def lead(self) -> Float[Array, " loops"]:
        """Time from rest to each loop's first value, s; zero without a time."""
        return jnp.zeros(len(self.d)) if self.dt is None else jnp.sum(self.dt[:, :3], axis=1)

    def middle(self, channel: str) -> tuple[float, float]:
        """Middle of what a channel of the fitted loops goes through, and half of its range."""
        u = np.asarray(self.channels[channel])[np.asarray(self.weight) > 0]
        return 0.5 * float(u.max() + u.min()), 0.5 * float(np.ptp(u))


def noise_of(loops: Sequence[ForceLoop], known: float | None) -> tuple[float, ...]:
    """Deviation of each loop's force: of its noise, and of the scatter between its cycles."""
    best = settings().steady.best_force
    return tuple(
        max(
            np.fmax(loop.noise, loop.scatter) if known is None else known,
            best * math.sqrt(float(np.mean(loop.force**2))),
        )
        for loop in loops
    )


def driven(
    loops: Sequence[ForceLoop],
    noise: Sequence[float],
    fitted: int,
    at_rest: bool,
    most: float | None = None,
) -> LoopHistories:
    """Loops, of which the first ones are to be fitted, each by so many values at most.

    Those that may begin at rest do so, or on the outermost loop like the others.
    """
    most = settings().steady.values if most is None else most
    chosen = [_drawing(loop.d, most) for loop in loops]
    length = max(map(len, chosen)) + 2
    d, force, weight, dt = np.zeros((4, len(loops), length))
    channels = {name: np.zeros_like(d) for name in loops[0].channels}
    for i, (loop, deviation, at) in enumerate(zip(loops, noise, chosen, strict=True)):
        end = len(at) + 2
        d[i] = loop.d[-1]
        d[i, :2], d[i, 2:end], force[i, 2:end] = loop.before(at_rest), loop.d[at], loop.force[at]
        weight[i, 2:end] = 1.0 / deviation if i < fitted else 0.0
        step = loop.dt or 1.0
        # What leads to a loop is run through slowly, and so is what follows it.
        dt[i] = loop.d.size * step
        dt[i, 3:end] = np.diff(at) * step
        for name, u in channels.items():
            u[i] = loop.channels[name][[0, 0, *at, *[-1] * (length - end)]]
    timed = all(loop.dt is not None for loop in loops)
    times = [[loop.period for loop in loops], [loop.duration for loop in loops]]
    return LoopHistories(
        jnp.asarray(d),
        jnp.asarray(force),
        jnp.asarray(weight),
        jnp.asarray(dt) if timed else None,
        jnp.asarray(times) if timed else None,
        {name: jnp.asarray(u) for name, u in channels.items()},
    )


def _drawing(d: np.ndarray, most: float) -> np.ndarray:
    """Values that draw a path: the outermost ones of equal parts, in their order."""
    every = np.arange(d.size)
    if d.size <= most:
        return every
    parts = np.array_split(every, int(most) // 2 - 1)
    ends = [part[each(d[part])] for part in parts for each in (np.argmin, np.argmax)]
    return np.unique([0, *ends, d.size - 1])
