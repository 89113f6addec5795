"""The joints' pseudo-forces at the end of a step: a few unknowns, whatever the structure's size."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwanjax.joints import AbstractDiscrete, Reaction
from iwanjax.structures.small import solve_general

_MOST_ITERATIONS = 60
# Halved this far, a Newton step is given up.
_LEAST_SHARE = 1.0 / 32.0
# Of the largest of the terms that the joints' forces are made of.
_TOLERANCE = 1e-12


class Joints(eqx.Module):
    """The elements of a structure, alike ones in one batch.

    Attributes
    ----------
    groups : tuple of AbstractDiscrete
        Each with a leading axis over its joints.
    order : tuple of tuple of int
        For each group the places of its joints among all.
    """

    groups: tuple[AbstractDiscrete, ...]
    order: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    @classmethod
    def of(cls, elements: tuple[AbstractDiscrete, ...]) -> "Joints":
        """Group the elements that have the same kind and shapes."""
        kinds: dict[Any, list[int]] = {}
        for i, element in enumerate(elements):
            leaves, structure = jax.tree.flatten(element)
            key = (structure, tuple(jnp.shape(leaf) for leaf in leaves))
            kinds.setdefault(key, []).append(i)
        groups = tuple(
            jax.tree.map(lambda *leaves: jnp.stack(leaves), *(elements[i] for i in places))
            for places in kinds.values()
        )
        return cls(groups, tuple(map(tuple, kinds.values())))

    @property
    def count(self) -> int:
        """Number of joints."""
        return sum(map(len, self.order))

    def init(self) -> tuple[Any, ...]:
        """States of the virgin joints."""
        return tuple(jax.vmap(lambda element: element.init())(group) for group in self.groups)

    def earlier(self, states: tuple[Any, ...], dt: Array) -> tuple[Any, ...]:
        """States of joints at rest so much earlier."""
        return tuple(
            jax.vmap(lambda element, own: element.earlier(own, dt))(group, state)
            for group, state in zip(self.groups, states, strict=True)
        )

    def step(self, d: Array, v: Array, dt: Array, states: tuple[Any, ...]) -> Reaction:
        """All joints, (joints,) each; states by group."""
        found = [
            jax.vmap(lambda e, d, v, s: e.step(d, v, dt, s))(
                group, _take(d, places), _take(v, places), state
            )
            for group, places, state in zip(self.groups, self.order, states, strict=True)
        ]
        return Reaction(
            self._merged([each.force for each in found]),
            self._merged([each.stiffness for each in found]),
            self._merged([each.damping for each in found]),
            tuple(each.state for each in found),
            self._merged([each.loss for each in found]),
        )

    def settled(
        self, states: tuple[Any, ...], by: Array, faster: Array, stiffness: Array
    ) -> tuple[Any, ...]:
        """States after a step that in the end led further and arrived faster, (joints,) each."""
        return tuple(
            jax.vmap(lambda e, s, *more: e.settled(s, *more))(
                group, state, *(_take(x, places) for x in (by, faster, stiffness))
            )
            for group, places, state in zip(self.groups, self.order, states, strict=True)
        )

    @property
    def rate_dependent(self) -> bool:
        """Whether the force of any depends on its rate, or on the time that a step takes."""
        return any(group.rate_dependent for group in self.groups)

    def haste(self, dt: Array, damping: Array, H: Array) -> Array:
        r"""Largest step over relaxation time: of an element, or of masses against dampers.

        A unit of pseudo-force that grows evenly over a step adds H to a rate, one that acts all
        along 2 H: :math:`2cH = c\Delta t/m` of a damper c against a mass m alone. The largest row
        sum bounds what several dampers do together.
        """
        relaxing = [
            jnp.max(jax.vmap(lambda element: element.haste(dt))(group)) for group in self.groups
        ]
        together = 2.0 * jnp.abs(damping) * jnp.sum(jnp.abs(H), axis=1)
        return jnp.max(jnp.stack([jnp.max(together), *relaxing]))

    @property
    def remember(self) -> Bool[Array, " joints"]:
        """Which joints follow another branch after each turn, whatever its rate."""
        return self._each(
            [
                bool(jax.tree.leaves(group.init())) and not group.rate_dependent
                for group in self.groups
            ]
        )

    @property
    def by_rate(self) -> Bool[Array, " joints"]:
        """Which joints' force depends on the rate, or on the time that a step takes."""
        return self._each([group.rate_dependent for group in self.groups])

    def energy(self, d: Array, states: tuple[Any, ...]) -> Array:
        """Energy stored in each joint, (joints,)."""
        return self._merged(
            [
                jax.vmap(lambda e, d, s: e.energy(d, s))(group, _take(d, places), state)
                for group, places, state in zip(self.groups, self.order, states, strict=True)
            ]
        )

    def _each(self, groups: list[bool]) -> Bool[Array, " joints"]:
        parts = [jnp.full(len(p), group) for group, p in zip(groups, self.order, strict=True)]
        return self._merged(parts) if parts else jnp.zeros(0, bool)

    def _merged(self, parts: list[Array]) -> Array:
        if not parts:
            return jnp.zeros(0)
        if len(parts) == 1:
            return parts[0]
        places = [i for group in self.order for i in group]
        back = sorted(range(len(places)), key=places.__getitem__)
        return jnp.concatenate(parts)[jnp.array(back)]


def _take(values: Array, places: tuple[int, ...]) -> Array:
    return values if places == tuple(range(values.shape[0])) else values[jnp.array(places)]


class StepEnd(NamedTuple):
    """What the pseudo-forces at the end of a step have to balance.

    Attributes
    ----------
    joints : Joints
        The elements.
    states : pytree
        At the beginning of the step.
    d, v : (joints,) array
        Deflections and rates that the step would end with without pseudo-forces at its end.
    G, H : (joints, joints) array
        What a unit of them adds to d and v.
    stiffness : (joints,) array
        Reference stiffness.
    dt : array
        Length of the step.
    """

    joints: Joints
    states: tuple[Any, ...]
    d: Float[Array, " joints"]
    v: Float[Array, " joints"]
    G: Float[Array, "joints joints"]
    H: Float[Array, "joints joints"]
    stiffness: Float[Array, " joints"]
    dt: Array

    def ends(self, g: Array) -> tuple[Array, Array]:
        """Deflections and rates with the pseudo-forces g."""
        return self.d + self.G @ g, self.v + self.H @ g

    def react(self, g: Array) -> Reaction:
        """What the joints do with the pseudo-forces g."""
        return self.joints.step(*self.ends(g), self.dt, self.states)

    def residual(self, g: Array) -> Float[Array, " joints"]:
        """G - (K_ref d - F), zero in balance."""
        return g - self.stiffness * self.ends(g)[0] + self.react(g).force


class _Trial(NamedTuple):
    g: Array
    residual: Array
    step: Array
    share: Array
    size: Array
    balanced: Bool[Array, ""]
    iterations: Array


@eqx.filter_custom_jvp
def balance(guess: Float[Array, " joints"], end: StepEnd) -> Float[Array, " joints"]:
    """Pseudo-forces in balance at the end of a step, by Newton's method that cannot cycle.

    A step that does not make the residual smaller is halved until it does. Derivatives
    are those of the balance itself, by one linear solve; ``guess`` has none. NaN where no
    balance was found.
    """
    m = end.d.shape[0]
    if m == 0:
        return guess

    def proceed(trial: _Trial) -> Array:
        return ~trial.balanced & (trial.iterations < _MOST_ITERATIONS)

    def advance(trial: _Trial) -> _Trial:
        # Where a slider's force drops no step may help: the drop drives the joint on, so the
        # plain iteration g -> K_ref d - F does.
        stuck = trial.share < _LEAST_SHARE
        g = trial.g + jnp.where(stuck, -trial.residual, trial.share * trial.step)
        d, v = end.ends(g)
        reaction = end.joints.step(d, v, end.dt, end.states)
        elastic = end.stiffness * d
        r = g - elastic + reaction.force
        size = jnp.max(jnp.abs(r))
        # Near zero a force that relaxes is a small difference of what moves it.
        parts = reaction.stiffness * d, reaction.damping * v
        scale = jnp.max(jnp.abs(elastic) + jnp.abs(reaction.force) + sum(map(jnp.abs, parts)))
        better = (size < trial.size) | stuck
        newton = solved(end, reaction, -r)
        return _Trial(
            jnp.where(better, g, trial.g),
            jnp.where(better, r, trial.residual),
            jnp.where(better, newton, trial.step),
            jnp.where(better, 1.0, 0.5 * trial.share),
            jnp.where(better, size, trial.size),
            size <= _TOLERANCE * scale,
            trial.iterations + 1,
        )

    start = _Trial(
        guess,
        jnp.zeros(m, guess.dtype),
        jnp.zeros(m, guess.dtype),
        jnp.ones((), guess.dtype),
        jnp.full((), jnp.inf, guess.dtype),
        jnp.zeros((), bool),
        jnp.zeros((), jnp.int32),
    )
    found = jax.lax.while_loop(proceed, advance, start)
    return jnp.where(found.balanced, found.g, jnp.nan)


@balance.def_jvp
def _balance_jvp(primals: Any, tangents: Any) -> tuple[Array, Array]:
    (guess, end), (_, d_end) = primals, tangents
    g = balance(guess, end)
    if g.shape[0] == 0:
        return g, g
    moved = eqx.filter_jvp(lambda e: e.residual(g), (end,), (d_end,))[1]
    return g, -solved(end, end.react(g), moved)


def solved(end: StepEnd, reaction: Reaction, right: Array) -> Array:
    """Solve with the residual's derivative, I - diag(K_ref - K) G + diag(C) H."""
    if not right.shape[0]:
        return right
    softer = (end.stiffness - reaction.stiffness)[:, None] * end.G
    J = jnp.eye(right.shape[0]) - softer + reaction.damping[:, None] * end.H
    m = right.shape[0]
    rows = [[J[i, j] for j in range(m)] for i in range(m)]
    return jnp.stack(solve_general(rows, [right[i] for i in range(m)]))
