"""Background damping of a mode beside its joints."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import ParameterInfo, named
from iwanjax.joints.power import power
from iwanjax.types import ArrayLike, real

_PARAMETERS = (
    ParameterInfo("c_1", "length^-(chi+1)", "coefficient", lower=0.0, closed="lower"),
    ParameterInfo("chi", "1", "exponent less one", lower=-1.0),
    ParameterInfo("zeta_0", "1", "damping ratio at rest", lower=0.0, closed="lower"),
)


class PowerLawDamping(eqx.Module):
    r"""Damping ratio of a mode as a power law of its amplitude (thesis Eq. 3.32).

    .. math:: \zeta(Q) = c_1 Q^{\chi+1} + \zeta_0

    Usable wherever a background damping ratio ``zeta0`` is asked for.

    Parameters
    ----------
    c_1 : float
        Coefficient, amplitude^-(chi+1).
    chi : float
        Exponent, 1; above -1.
    zeta_0 : float
        Damping ratio at vanishing amplitude, 1.

    Raises
    ------
    InputError
        For a negative c_1 or zeta_0, or chi at or below -1.
    """

    c_1: Array = eqx.field(converter=named("c_1"))
    chi: Array = eqx.field(converter=named("chi"))
    zeta_0: Array = eqx.field(converter=named("zeta_0"))

    def __check_init__(self) -> None:
        """Hold the parameters against their bounds."""
        for info in _PARAMETERS:
            info.check(getattr(self, info.name), type(self).__name__)

    def __call__(self, amplitude: ArrayLike) -> Float[Array, "..."]:
        """Damping ratio at the given modal amplitude(s)."""
        Q = jnp.abs(real(amplitude))
        return self.c_1 * power(Q, self.chi + 1.0) + self.zeta_0
