"""The element types that files may name; one's own joins by ``register_joint``."""

import dataclasses
import difflib
import inspect
import re

from iwanjax.errors import InputError
from iwanjax.joints.abstract import AbstractJoint
from iwanjax.joints.attached_oscillator import AttachedOscillator
from iwanjax.joints.backlash import Backlash
from iwanjax.joints.bouc_wen import BoucWen
from iwanjax.joints.changing_stiffness import ChangingStiffness
from iwanjax.joints.dashpot import Dashpot
from iwanjax.joints.drag import QuadraticDrag
from iwanjax.joints.force_law import AbstractForceLaw
from iwanjax.joints.inertia import Inertia
from iwanjax.joints.iwan4 import Iwan4
from iwanjax.joints.iwan5 import Iwan5
from iwanjax.joints.jenkins import Jenkins
from iwanjax.joints.maxwell import Maxwell
from iwanjax.joints.springs import (
    BilinearSpring,
    CubicSpring,
    Gap,
    LinearSpring,
    QuadraticSpring,
)
from iwanjax.joints.tanh_spring import TanhSpring
from iwanjax.joints.unnamed import UnnamedLaw

JOINTS: dict[str, type[AbstractJoint]] = {
    "iwan4": Iwan4,
    "iwan5": Iwan5,
    "linear_spring": LinearSpring,
    "inertia": Inertia,
    "dashpot": Dashpot,
    "cubic_spring": CubicSpring,
    "quadratic_spring": QuadraticSpring,
    "gap": Gap,
    "bilinear_spring": BilinearSpring,
    "jenkins": Jenkins,
    "quadratic_drag": QuadraticDrag,
    "maxwell": Maxwell,
    "tanh_spring": TanhSpring,
    "bouc_wen": BoucWen,
    "backlash": Backlash,
    "changing_stiffness": ChangingStiffness,
    "attached_oscillator": AttachedOscillator,
    "unnamed_law": UnnamedLaw,
}


def register_joint(name: str, kind: type[AbstractJoint]) -> None:
    """Make an element of one's own known by name.

    It is then a ``type:`` of study files and a line of ``iwanjax laws``; a force law
    (:class:`AbstractForceLaw`, of which :class:`AbstractStepped` needs least) is a hypothesis at
    every place of a diagnosis too.

    Parameters
    ----------
    name : str
        Of the type and of the hypothesis.
    kind : type
        A final subclass of :class:`AbstractJoint`.

    Raises
    ------
    InputError
        When the name is taken by another element, the class is not a joint, or a search would
        not know where to begin with its parameters.

    Examples
    --------
    >>> import equinox as eqx
    >>> import jax
    >>> import jax.numpy as jnp
    >>> import iwanjax as ij
    >>> from iwanjax.joints import AbstractStepped, ParameterInfo
    >>> class Softening(AbstractStepped):
    ...     parameters = (ParameterInfo("k_s", "force/length", "stiffness at rest"),)
    ...     k_s: jax.Array = eqx.field(converter=jnp.asarray)
    ...     def follow(self, motion, memory):
    ...         return self.k_s * jnp.tanh(motion.d), memory
    >>> ij.register_joint("example_softening", Softening)
    >>> float(ij.hysteresis(Softening(k_s=2.0), [0.0, 100.0], dt=1.0)[-1])
    2.0
    """
    if not (isinstance(kind, type) and issubclass(kind, AbstractJoint)):
        raise InputError(f"register_joint({name!r}): expected a subclass of AbstractJoint")
    if issubclass(kind, AbstractForceLaw):
        _check_searched(name, kind)
    if JOINTS.setdefault(name, kind) is not kind:
        raise InputError(f"register_joint: {name!r} already names {JOINTS[name].__name__}")


def _check_searched(name: str, kind: type[AbstractForceLaw]) -> None:
    """Refuse a law that a search would not know where to begin with."""
    moved = {info.name for info in kind.searched()}
    if len(moved) not in (1, 2):
        raise InputError(
            f"register_joint({name!r}): {kind.__name__}.searched names {len(moved)} parameters; "
            "expected a size, and a shape at most"
        )
    if len(moved) == 2 and kind.starts.__func__ is AbstractForceLaw.starts.__func__:
        raise InputError(
            f"register_joint({name!r}): {kind.__name__} has a shape; give it starts(seen), the "
            "values to begin a search with"
        )
    bare = {f.name for f in dataclasses.fields(kind) if f.default is dataclasses.MISSING}
    if kind.scaled.__func__ is AbstractForceLaw.scaled.__func__ and bare - moved:
        raise InputError(
            f"register_joint({name!r}): {', '.join(sorted(bare - moved))} of {kind.__name__} "
            "needs a default, which a search leaves as it is"
        )


def described(kind: type[AbstractJoint]) -> str:
    """What an element is: the first sentence of its docstring, its name without one."""
    first = inspect.cleandoc(kind.__doc__ or "").partition("\n")[0]
    return re.split(r"\.(?= [A-Z][a-z]|$)", first, maxsplit=1)[0] or kind.__name__


def joint_type(name: str) -> type[AbstractJoint]:
    """The element class of a name in a file.

    Raises
    ------
    InputError
        For an unknown name, with the nearest known one.
    """
    if name in JOINTS:
        return JOINTS[name]
    near = difflib.get_close_matches(name, JOINTS, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else f"; known: {', '.join(JOINTS)}"
    raise InputError(f"joint type {name!r} is unknown{hint}")
