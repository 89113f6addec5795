"""Fitting the joints of a structure to curves of its modes, through quasi-static modal analysis."""

import math
import warnings
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.joints import AbstractJoint
from iwanjax.joints.iwan import AbstractIwan, phi_max_of, strength_of
from iwanjax.quasistatic import QsmaSolution, qsma
from iwanjax.signals.interpolate import cubic
from iwanjax.structures import JointedStructure
from iwanjax.structures.checks import finite_array
from iwanjax.types import ArrayLike
from iwanjax.updating.background import (
    modes_of,
    refuse_undamped,
    with_background,
)
from iwanjax.updating.joint_groups import owners
from iwanjax.updating.microslip import IwanPlace, drop_of, without_macroslip
from iwanjax.updating.problem import AbstractProblem, Measured, Reference, check_free

# Levels of each mode where curves have fewer, and how far loads reach beyond the amplitudes.
_LOADS = 40
_MARGIN = 1.3


class StructuralProblem(AbstractProblem):
    """The joints of a structure held against measured curves of its modes.

    Parameters are those of the joints, group by group, then the damping ratio of each curve's
    mode beside the joints.

    Attributes
    ----------
    structure : JointedStructure
        With the joints at their starting values.
    alpha : (curves, levels) array
        Load levels that reach over each curve's amplitudes.
    levels : (curves, levels) array
        Each curve's amplitudes, rising, with others between them.
    curve, level : (N,) array of int
        Where in ``levels`` each measured level stands.
    owners : tuple of tuple of str
        For each group its joints; they share the parameters that are next in theta.
    modes : tuple of int
        The mode of each curve.
    by_drop : tuple of int
        First parameter of each Iwan joint or group whose F_S is sought without bounds.
    deflection : (by_drop,) array
        About what those deflect in the curves, length.
    """

    measured: Measured
    chart: Chart
    structure: JointedStructure
    deflection: Float[Array, " by_drop"]
    alpha: Float[Array, "curves levels"]
    levels: Float[Array, "curves levels"]
    curve: Int[Array, " N"]
    level: Int[Array, " N"]
    names: tuple[str, ...] = eqx.field(static=True)
    owners: tuple[tuple[str, ...], ...] = eqx.field(static=True)
    modes: tuple[int, ...] = eqx.field(static=True)
    by_drop: tuple[int, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """Parameters of (drop, K_T, chi, beta) of each Iwan joint, each in its own transform.

        In microslip curves know F_S and beta only through chi and the drop of stiffness at some
        deflection, so that the parameters themselves lie on thin curved ridges.
        """
        return self.values_by(self.chart, z)

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        return self.variables_by(self.chart, theta)

    def values_by(self, chart: Chart, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """The same with other parameters free."""
        values = chart.to_values(z)
        for first, d in zip(self.by_drop, self.deflection, strict=True):
            drop, K_T, chi, beta = values[first : first + 4]
            unit = drop_of(K_T, jnp.ones_like(drop), chi, beta, d)
            phi_max = (unit / drop) ** (1.0 / (chi + 1.0))
            values = values.at[first].set(strength_of(phi_max, K_T, chi, beta))
        return values

    def variables_by(self, chart: Chart, theta: Float[Array, " parameters"]) -> Array:
        """The inverse of :meth:`values_by`."""
        values = theta
        for first, d in zip(self.by_drop, self.deflection, strict=True):
            F_S, K_T, chi, beta = theta[first : first + 4]
            phi_max = phi_max_of(F_S, K_T, chi, beta)
            values = values.at[first].set(drop_of(K_T, phi_max, chi, beta, d))
        return chart.to_variables(values)

    def model(self, theta: Float[Array, " parameters"]) -> JointedStructure:
        """The structure with these joints, and these damping ratios in its C."""
        return with_background(self.jointed(theta), self.modes, self.background(theta))

    def background(self, theta: Float[Array, " parameters"]) -> Float[Array, " curves"]:
        """Damping ratio of each curve's mode beside the joints."""
        return theta[-len(self.modes) :]

    def jointed(self, theta: Float[Array, " parameters"]) -> JointedStructure:
        """The structure with these joints and the C that it had."""
        joints: dict[str, AbstractJoint] = {}
        for _, labels, kind, first in self._groups():
            values = theta[first : first + len(kind.parameters)]
            # A joint lets traced values pass: where there is none, as at chi = -1, there are no
            # residuals, and no bound to rest on.
            given = {
                i.name: jnp.where(i.contains(v), v, jnp.nan)
                for i, v in zip(kind.parameters, values, strict=True)
            }
            joints |= {label: kind(**given) for label in labels}
        return self.structure.with_joints(joints)

    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """First-harmonic frequency and damping at the measured amplitudes.

        The analysis asks for loads, not amplitudes: a first pass over ``alpha`` tells which
        load makes each amplitude, to a part in a thousand; a second one at those loads is
        then off by that part of the curve's small slope.
        """
        structure, zeta_0, levels = (
            self.jointed(theta),
            self.background(theta),
            jnp.log(self.levels),
        )

        def towards(loads: Array, _: None) -> tuple[Array, tuple[Array, Array]]:
            found = self._solved(structure, loads, zeta_0)
            closer = jnp.exp(jax.vmap(cubic)(levels, jnp.log(found.q), jnp.log(loads)))
            return closer, (found.curves.frequency, found.curves.damping)

        # One pass compiled for both. Without the nothing its loads would have a derivative from the
        # second pass on only, and all of it would be traced once more to find out.
        begin = self.alpha + 0.0 * theta[0]
        _, (f, zeta) = jax.lax.scan(towards, begin, None, length=2)
        return f[-1, self.curve, self.level], zeta[-1, self.curve, self.level]

    def predict_sets(self, theta: Float[Array, "sets parameters"]) -> tuple[Array, Array]:
        """The same of many parameter sets, (sets, N) each, in one batch.

        One pass over ``alpha``, interpolated in the logarithm of the amplitude: with its 40 loads
        off by less than a thousandth of a curve's change in microslip. Where a joint begins to
        slip as a whole between two loads it may miss most of the damping.
        """
        nothing = jnp.zeros(len(self.modes))
        found = self._solved(self.jointed(theta.T), self.alpha, nothing)
        at = jnp.log(self.levels)

        def over_modes(q: Array, y: Array) -> Array:
            return jax.vmap(cubic)(at, jnp.log(q), y)

        f, zeta = (
            jax.vmap(over_modes)(found.q, y) for y in (found.curves.frequency, found.curves.damping)
        )
        beside = theta[:, -len(self.modes) :, None]
        return f[:, self.curve, self.level], (zeta + beside)[:, self.curve, self.level]

    def iwan_places(self, theta: Float[Array, " parameters"]) -> tuple[IwanPlace, ...]:
        """Iwan joints by group, and the largest deflection of any of a group in any curve."""
        with warnings.catch_warnings():
            # Of loads beyond the curves, which may have no equilibrium.
            warnings.simplefilter("ignore")
            found = self._solved(self.jointed(theta), self.alpha, self.background(theta), True)
        assert found.deflection is not None
        q, d = (np.nan_to_num(np.abs(np.asarray(x))) for x in (found.q, found.deflection))
        reach = np.zeros(d.shape[-1])
        for part, own, each in zip(self.measured.slices, q, d, strict=True):
            most = float(jnp.max(self.measured.q[part]))
            reach = np.maximum(reach, [np.interp(most, own, row) for row in each.T])
        labels = self.structure.labels
        return tuple(
            IwanPlace(
                owner,
                {
                    name: self.names.index(f"{owner}.{name}")
                    for name in ("F_S", "K_T", "chi", "beta")
                },
                max(float(reach[labels.index(label)]) for label in joints),
            )
            for owner, joints, kind, _ in self._groups()
            if issubclass(kind, AbstractIwan)
        )

    def restarts(self, theta: np.ndarray, count: int) -> np.ndarray | None:
        """Each joint that comes to macroslip as one that does not; None where there is none."""
        places = self.iwan_places(jnp.asarray(theta))
        low, high = np.asarray(self.chart.lower), np.asarray(self.chart.upper)
        rows = [
            each
            for place in places
            for each in without_macroslip(place, theta)
            if np.all((low <= each) & (each <= high))
        ]
        return np.stack([rows[i * len(rows) // count] for i in range(count)]) if rows else None

    def derived(self, theta: Float[Array, " parameters"]) -> Mapping[str, Array]:
        """Of each Iwan joint or group its slider distribution: phi_max, R and S."""
        structure = self.jointed(theta)
        found = {}
        for owner, labels, kind, _ in self._groups():
            joint = structure.joints[labels[0]]
            if issubclass(kind, AbstractIwan) and isinstance(joint, AbstractIwan):
                each = {"phi_max": joint.phi_max, "R": joint.R, "S": joint.S}
                found |= {f"{owner}.{name}": value for name, value in each.items()}
        return found

    def is_kind(self, owner: str, kind: type[AbstractJoint]) -> bool:
        """Whether the joints of a group are of a kind."""
        return any(name == owner and own is kind for name, _, own, _ in self._groups())

    def _groups(self) -> list[tuple[str, tuple[str, ...], type[AbstractJoint], int]]:
        """Name, joints, type and first parameter of each group."""
        found, first = [], 0
        for labels in self.owners:
            kind = type(self.structure.joints[labels[0]])
            found.append((self.names[first].rpartition(".")[0], labels, kind, first))
            first += len(kind.parameters)
        return found

    def _solved(
        self,
        structure: JointedStructure,
        alpha: Array,
        zeta_0: Array,
        deflections: bool = False,
    ) -> QsmaSolution:
        return qsma(
            structure,
            self.modes,
            alpha,
            zeta_0,
            frequency="first_harmonic",
            deflections=deflections,
        )


def structural_problem(
    structure: JointedStructure,
    curves: Sequence[ModalCurves],
    parameters: Sequence[Parameter],
    modes: Sequence[int] | None,
    sensors: Sequence[ArrayLike] | None,
    groups: Mapping[str, Sequence[str]] | None,
    reference: Reference,
) -> StructuralProblem:
    """The problem of a structure's joints and of its modes' damping beside them.

    ``parameters`` are all of :func:`structural_parameters`, in its order.

    Raises
    ------
    InputError
        For modes or sensors that do not match the curves, and a mode without damping of its own.
    """
    which = modes_of(structure, curves, modes)
    refuse_undamped(parameters[-len(which) :])
    measured = Measured.of(curves, _factors(structure, curves, which, sensors))
    if structure.labels:
        check_free(parameters, measured)
    omega2 = np.asarray(structure.basis.omega2)[list(which)]
    q = [np.asarray(measured.q[part]) for part in measured.slices]
    count = max(_LOADS, max(np.unique(x).size for x in q) + 1)
    levels = np.stack([_filled(np.unique(x), count) for x in q])
    alpha = np.stack(
        [
            np.geomspace(w * x[0], w * x[-1] * _MARGIN, count)
            for w, x in zip(omega2, levels, strict=True)
        ]
    )
    deflection = _deflections(structure, groups, parameters, which, measured)
    return StructuralProblem(
        measured=measured,
        chart=Chart(parameters),
        structure=structure,
        deflection=jnp.asarray(list(deflection.values())),
        alpha=jnp.asarray(alpha),
        levels=jnp.asarray(levels),
        curve=jnp.asarray(np.repeat(np.arange(len(q)), [x.size for x in q])),
        level=jnp.asarray(np.concatenate(list(map(np.searchsorted, levels, q)))),
        names=tuple(p.name for p in parameters),
        owners=tuple(owners(structure, groups).values()),
        modes=which,
        by_drop=tuple(deflection),
        reference=reference,
    )


def _filled(x: Float[np.ndarray, " rising"], count: int) -> Float[np.ndarray, " levels"]:
    """Amplitudes with one below them, and with middles of the widest intervals to a number."""
    x = np.insert(x, 0, x[0] / _MARGIN)
    while x.size < count:
        i = int(np.argmax(x[1:] / x[:-1]))
        x = np.insert(x, i + 1, math.sqrt(x[i] * x[i + 1]))
    return x


def _deflections(
    structure: JointedStructure,
    groups: Mapping[str, Sequence[str]] | None,
    parameters: Sequence[Parameter],
    modes: Sequence[int],
    measured: Measured,
) -> dict[int, float]:
    """Of each Iwan joint whose F_S is sought without bounds: its first parameter, and how far.

    By the shapes at the given stiffness, in the curve that moves it most.
    """
    positions = {p.name: i for i, p in enumerate(parameters)}
    q = [np.exp(np.mean(np.log(np.asarray(measured.q[part])))) for part in measured.slices]
    moved = np.abs(np.asarray(structure.basis.P)[:, list(modes)]) * q
    found = {}
    for owner, labels in owners(structure, groups).items():
        at = [structure.labels.index(label) for label in labels]
        d = float(moved[at].max())
        if d <= 0.0 or not isinstance(structure.joints[labels[0]], AbstractIwan):
            continue
        p = parameters[positions[f"{owner}.F_S"]]
        if not p.fixed and p.lower == 0.0 and np.isinf(p.upper):
            found[positions[p.name]] = d
    return found


def _factors(
    structure: JointedStructure,
    curves: Sequence[ModalCurves],
    modes: Sequence[int],
    sensors: Sequence[ArrayLike] | None,
) -> list[float]:
    """Modal displacement per displacement at the sensor, for each curve."""
    if sensors is None:
        for i, each in enumerate(curves):
            if each.quantity != "modal displacement":
                raise InputError(
                    f"curve {i} is against the {each.quantity} of a sensor; give sensors=, the "
                    "row of the sensor for each curve"
                )
        return [1.0] * len(curves)
    if len(sensors) != len(curves):
        raise InputError(f"fit: got {len(sensors)} sensors for {len(curves)} curves")
    factors = []
    for i, (row, mode) in enumerate(zip(sensors, modes, strict=True)):
        checked = finite_array(row, f"sensors[{i}]")
        Phi = np.asarray(structure.basis.Phi)
        if checked.shape != (Phi.shape[0],):
            raise InputError(
                f"sensors[{i}] has shape {checked.shape}; expected ({Phi.shape[0]},) like M"
            )
        seen = abs(float(checked @ Phi[:, mode]))
        if seen <= 1e-9 * np.max(np.abs(Phi[:, mode])) * np.linalg.norm(checked):
            raise InputError(f"sensors[{i}] sits on a node of mode {mode}: it does not see it")
        factors.append(1.0 / seen)
    return factors
