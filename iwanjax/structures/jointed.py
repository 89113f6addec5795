"""A linear structure with joints at named deflection rows."""

from collections.abc import Mapping
from typing import Literal, TypeGuard

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.files import nearest
from iwanjax.joints import AbstractJoint
from iwanjax.joints.force_law import AbstractForceLaw, PlaceMotion
from iwanjax.structures.checks import finite_array
from iwanjax.structures.linear import LinearStructure, Modes
from iwanjax.structures.model_file import Model
from iwanjax.types import ArrayLike, is_traced

# What is left of a unit row that others explain to all but round-off.
_DEPENDENT = 1e-6


class ModalBasis(eqx.Module):
    """Elastic modes at a reference joint stiffness, and what the joints see of them.

    Parameters
    ----------
    omega2 : (modes,) array
        Squared natural frequencies, (rad/s)^2.
    Phi : (n, modes) array
        Mass-normalised shapes.
    P : (joints, modes) array
        Joint deflections per unit modal displacement, rows @ Phi.
    stiffness : (joints,) array
        Tangent stiffness of each joint that ``omega2`` includes, force/length.
    independent : tuple of int
        Joints whose rows are linearly independent; the others' deflections follow.
    """

    omega2: Float[Array, " modes"]
    Phi: Float[Array, "n modes"]
    P: Float[Array, "joints modes"]
    stiffness: Float[Array, " joints"]
    independent: tuple[int, ...] = eqx.field(static=True)


class JointedStructure(eqx.Module):
    r"""M u'' + C u' + K u + sum_j b_j f_j(b_j^T u) = f (thesis Eqs. 2.1, 3.1).

    Its modes at low amplitude, where every joint contributes its initial stiffness, are
    worked out once. Joints given later by :meth:`with_joints` (batches of them, or the
    traced ones of a gradient) are treated as modifications of this reference, exactly
    and without another eigenproblem.

    Parameters
    ----------
    structure : LinearStructure or Model
        The structure without joints, or a model of it whose rows have names.
    joints : mapping of str to (row, joint) or joint
        For each label the (n,) row with deflection d = row @ u, and the element; the element alone
        sits at the model's row of that name. None at all
        is a linear structure, of which modes, time integration and a diagnosis are to be had.
        An inertia is no joint among the others: it is added to the mass matrix,
        :math:`M + m\,b b^T`, and moves with every mode from then on.
    zeta : float or (k,) array_like, optional
        Damping ratio of all elastic modes at low amplitude, where every joint sticks, or of the
        first k (Eqs. 2.25, 3.19), for a structure without damping of its own.

    Raises
    ------
    InputError
        For rows of wrong length, zero or not finite, for things that are not joints, where
        the joints' stiffness makes the structure unstable, for a batch of inertias, a joint
        without a row, and for zeta beside a damping matrix.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> masses = ij.LinearStructure(np.eye(2), None, [[2.0, -1.0], [-1.0, 1.0]])
    >>> joint = ij.Iwan4(F_S=1.0, K_T=0.5, chi=-0.5, beta=1.0)
    >>> bolted = ij.JointedStructure(masses, {"J1": ([-1.0, 1.0], joint)})  # between the masses
    >>> bolted.modes().omega.round(4).tolist()
    [0.6472, 1.8924]
    >>> damped = ij.JointedStructure(masses, {"J1": ([-1.0, 1.0], joint)}, zeta=0.01)
    >>> bool((damped.structure.C != 0.0).all())
    True
    """

    structure: LinearStructure
    labels: tuple[str, ...] = eqx.field(static=True)
    rows: Float[Array, "joints n"]
    elements: tuple[AbstractJoint, ...]
    basis: ModalBasis

    def __init__(
        self,
        structure: LinearStructure | Model,
        joints: Mapping[str, tuple[ArrayLike, AbstractJoint] | AbstractJoint],
        zeta: ArrayLike | None = None,
    ):
        known: Mapping[str, np.ndarray] = {}
        if isinstance(structure, Model):
            known, structure = structure.rows, structure.structure
        if not isinstance(structure, LinearStructure):
            raise InputError(
                "JointedStructure expects a LinearStructure or a model that has one, got "
                f"{type(structure).__name__}"
            )
        if not isinstance(joints, Mapping):
            raise InputError("JointedStructure expects a mapping {label: (row, joint)}")
        entries = {
            label: _entry(label, entry, structure.size, known) for label, entry in joints.items()
        }
        if is_traced(list(entries.values()), structure):
            raise InputError(
                "JointedStructure cannot be built from what is being traced: build it once outside "
                "jit, grad or vmap, and use with_joints inside"
            )
        M = np.array(structure.M)
        rows, elements, labels = [], [], []
        for label, (row, element) in entries.items():
            if _inertial(element):
                M += _mass(label, element) * np.outer(row, row)
                continue
            rows.append(row)
            elements.append(element)
            labels.append(label)
        if len(labels) < len(joints):
            structure = LinearStructure(M, structure.C, structure.K)
        B = np.array(rows).reshape(len(rows), structure.size)
        # A batch of parameter sets is referred to its middle.
        stiffness = np.array([float(np.median(joint.initial_stiffness)) for joint in elements])
        stuck = LinearStructure(
            structure.M, structure.C, np.asarray(structure.K) + (B.T * stiffness) @ B
        )
        omega, Phi = stuck.modes()
        if zeta is not None:
            if np.any(structure.C):
                raise InputError("zeta: the structure has a damping matrix C; expected one of both")
            structure = LinearStructure(structure.M, stuck.damping_matrix(zeta), structure.K)
        self.structure = structure
        self.labels = tuple(labels)
        self.rows = jnp.asarray(B)
        self.elements = tuple(elements)
        P = B @ np.asarray(Phi)
        self.basis = ModalBasis(
            jnp.asarray(np.asarray(omega) ** 2),
            Phi,
            jnp.asarray(P),
            jnp.asarray(stiffness),
            _independent_rows(P, B, np.asarray(structure.M), np.asarray(omega), self.labels),
        )

    @property
    def joints(self) -> dict[str, AbstractJoint]:
        """The elements by label."""
        return dict(zip(self.labels, self.elements, strict=True))

    def require_joints(self, what: str) -> None:
        """Refuse a structure without joints where amplitude is what matters.

        Parameters
        ----------
        what : str
            Who asks, for the message.

        Raises
        ------
        InputError
        """
        if not self.labels:
            raise InputError(
                f"{what}: the structure has no joints; it is linear, the same at every amplitude "
                "(see LinearStructure.modes); expected at least one joint"
            )

    def with_joints(self, joints: Mapping[str, AbstractJoint]) -> "JointedStructure":
        """The same structure with some elements replaced, keeping the modal reference.

        Parameters
        ----------
        joints : mapping of str to joint
            New elements for existing labels; parameters may be batched or traced.

        Raises
        ------
        InputError
            For a label the structure does not have, and an inertia.
        """
        for label, element in joints.items():
            if _inertial(element):
                raise InputError(
                    f"with_joints: {label!r} is an inertia, part of the mass matrix; build a "
                    "JointedStructure with it, or vary the mass by an AffineStructure"
                )
            if label not in self.labels:
                raise InputError(
                    f"with_joints: no joint is called {label!r}; there are {', '.join(self.labels)}"
                )
        elements = tuple(joints.get(label, old) for label, old in self.joints.items())
        return eqx.tree_at(lambda js: js.elements, self, elements)

    def modes(self, limit: Literal["low", "high"] = "low") -> Modes:
        """Elastic modes at vanishing or at very large amplitude (thesis Eq. 2.4).

        Parameters
        ----------
        limit : {"low", "high"}
            Joints as springs of their initial stiffness, or of their stiffness at large
            amplitude (none for an Iwan element: all its sliders slip).

        Returns
        -------
        Modes
            Circular frequencies in rad/s and mass-normalised shapes, rigid-body modes
            taken out.

        Raises
        ------
        InputError
            For a batch of parameter sets, or a joint whose stiffness has no limit.
        """
        return self.linearised(limit).modes()

    def linearised(self, limit: Literal["low", "high"] = "low") -> LinearStructure:
        """The linear structure that the joints leave at one end of the amplitude range.

        Parameters and errors as for :meth:`modes`.
        """
        if not self.elements:
            return self.structure
        stiffness = np.stack(
            [
                np.asarray(joint.initial_stiffness if limit == "low" else joint.limit_stiffness)
                for joint in self.elements
            ]
        )
        if stiffness.ndim != 1:
            raise InputError(
                f"modes: the joints carry a batch of shape {stiffness.shape[1:]}; take one "
                "parameter set, or use qsma, which follows the modes through a batch"
            )
        if not np.all(np.isfinite(stiffness)):
            label = self.labels[int(np.argmin(np.isfinite(stiffness)))]
            raise InputError(
                f"modes: joint {label!r} has no stiffness at large amplitude: its force "
                "outgrows its deflection"
            )
        B, K = np.asarray(self.rows), np.asarray(self.structure.K)
        return LinearStructure(self.structure.M, self.structure.C, K + (B.T * stiffness) @ B)


def _entry(
    label: str, entry: object, n: int, known: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, AbstractJoint]:
    """One checked (row, joint) pair, of a joint alone with the row of its name."""
    if not isinstance(label, str):
        raise InputError(f"joint label {label!r} is not a string")
    if isinstance(entry, AbstractJoint):
        if label not in known:
            raise InputError(
                f"joint {label!r} has no row: expected (row, joint)"
                + (f", or one of the model's rows {', '.join(known)}" if known else "")
                + nearest(label, known)
            )
        entry = (known[label], entry)
    if not isinstance(entry, tuple | list) or len(entry) != 2:
        raise InputError(f"joint {label!r}: expected (row, joint), got {type(entry).__name__}")
    row = finite_array(entry[0], f"row of joint {label!r}")
    if row.shape != (n,):
        raise InputError(f"row of joint {label!r} has shape {row.shape}; expected ({n},) like M")
    if not np.any(row):
        raise InputError(f"row of joint {label!r} is all zeros: the joint connects nothing")
    if not isinstance(entry[1], AbstractJoint):
        raise InputError(
            f"joint {label!r}: expected a joint element such as Iwan4(...), got "
            f"{type(entry[1]).__name__}"
        )
    return row, entry[1]


def _inertial(element: object) -> TypeGuard[AbstractForceLaw]:
    return isinstance(element, AbstractForceLaw) and element.inertial


def _mass(label: str, element: AbstractForceLaw) -> float:
    """Force of an inertial element at unit acceleration."""
    zero, one = jnp.zeros(()), jnp.ones(())
    force = element.follow(PlaceMotion(zero, zero, one, zero, one), zero)[0]
    if jnp.ndim(force):
        raise InputError(
            f"joint {label!r} is a batch of {jnp.shape(force)} inertias; expected one: it is added "
            "to the mass matrix"
        )
    return float(force)


def _independent_rows(
    P: np.ndarray, B: np.ndarray, M: np.ndarray, omega: np.ndarray, labels: tuple[str, ...]
) -> tuple[int, ...]:
    """Joints whose deflections span those of all, the first come first."""
    # All modes together, rigid ones too, would give b^T M^-1 b.
    whole = np.sum(B * np.linalg.solve(M, B.T).T, axis=1)
    directions: list[np.ndarray] = []
    kept = []
    for i, row in enumerate(P / omega):
        if np.sum(P[i] ** 2) < _DEPENDENT**2 * whole[i]:
            raise InputError(
                f"joint {labels[i]!r} does not deflect in any elastic mode: its row sees only "
                "rigid-body motion"
            )
        size = np.linalg.norm(row)
        rest = row / size
        for direction in directions:
            rest = rest - (rest @ direction) * direction
        if np.linalg.norm(rest) > _DEPENDENT:
            directions.append(rest / np.linalg.norm(rest))
            kept.append(i)
    return tuple(kept)
