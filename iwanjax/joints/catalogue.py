"""The element types that files may name; a user's own joins by ``register_joint``."""

import difflib

from iwanjax.errors import InputError
from iwanjax.joints.abstract import AbstractJoint
from iwanjax.joints.dashpot import Dashpot
from iwanjax.joints.drag import QuadraticDrag
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

JOINTS: dict[str, type[AbstractJoint]] = {
    "iwan4": Iwan4,
    "iwan5": Iwan5,
    "jenkins": Jenkins,
    "linear_spring": LinearSpring,
    "quadratic_spring": QuadraticSpring,
    "cubic_spring": CubicSpring,
    "bilinear_spring": BilinearSpring,
    "gap": Gap,
    "dashpot": Dashpot,
    "quadratic_drag": QuadraticDrag,
    "maxwell": Maxwell,
}


def register_joint(name: str, kind: type[AbstractJoint]) -> None:
    """Make an element of one's own known to study files by name.

    Parameters
    ----------
    name : str
        What a file's ``type:`` says.
    kind : type
        A final subclass of :class:`AbstractJoint`.

    Raises
    ------
    InputError
        When the name is taken by another element or the class is not a joint.
    """
    if not (isinstance(kind, type) and issubclass(kind, AbstractJoint)):
        raise InputError(f"register_joint({name!r}): expected a subclass of AbstractJoint")
    if JOINTS.setdefault(name, kind) is not kind:
        raise InputError(f"register_joint: {name!r} already names {JOINTS[name].__name__}")


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
