"""What the Iwan elements share: their slider distribution and its two sets of parameters."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.joints.abstract import AbstractJoint, ParameterInfo
from iwanjax.joints.discrete import AbstractDiscrete
from iwanjax.joints.sliders import SLIDERS, SliderBank, iwan_sliders
from iwanjax.types import ArrayLike, Scalar, as_real

_CHI = ParameterInfo(
    "chi",
    "1",
    "exponent of the slider distribution",
    lower=-1.0,
    transform="logit",
    usual=(-1.0, 0.0),
)
IWAN_PARAMETERS = (
    ParameterInfo("F_S", "force", "force at macroslip", lower=0.0, transform="log"),
    ParameterInfo("K_T", "force/length", "tangent stiffness at rest", lower=0.0, transform="log"),
    _CHI,
    ParameterInfo(
        "beta",
        "1",
        "Dirac share over power-law share of the stiffness",
        lower=0.0,
        closed="lower",
        transform="log",
    ),
)
"""What an Iwan element is made of by its force and stiffness."""

DISTRIBUTION_PARAMETERS = (
    ParameterInfo("R", "force/length^(chi+2)", "strength of the power law", lower=0.0),
    ParameterInfo("S", "force/length", "strength of the Dirac slider", 0.0, closed="lower"),
    _CHI,
    ParameterInfo("phi_max", "length", "deflection at macroslip", lower=0.0),
)
"""What it may be made of instead: its slider distribution."""


def phi_max_of(F_S: Array, K_T: Array, chi: Array, beta: Array) -> Array:
    """Deflection at macroslip, thesis Eq. (2.10)."""
    return F_S * (1.0 + beta) / (K_T * (beta + (chi + 1.0) / (chi + 2.0)))


def strength_of(phi_max: Scalar, K_T: Scalar, chi: Scalar, beta: Scalar) -> Scalar:
    """The inverse of :func:`phi_max_of` for F_S."""
    return phi_max * K_T * (beta + (chi + 1.0) / (chi + 2.0)) / (1.0 + beta)


def distribution_of(F_S: Array, K_T: Array, chi: Array, beta: Array) -> tuple[Array, Array]:
    """Strengths (R, S) of the power law and of the Dirac slider, thesis Eqs. (2.11), (A.5)."""
    phi_max = phi_max_of(F_S, K_T, chi, beta)
    power_law_share = K_T / (1.0 + beta)
    return power_law_share * (chi + 1.0) / phi_max ** (chi + 1.0), beta * power_law_share


def physical_of(
    owner: str, R: ArrayLike, S: ArrayLike, chi: ArrayLike, phi_max: ArrayLike
) -> dict[str, Array]:
    """Parameters F_S, K_T, chi, beta of a distribution, thesis Eqs. (A.3) to (A.5).

    Raises
    ------
    InputError
        For a value outside its bounds; ``owner`` is the element it names.
    """
    R, S = as_real(R, "R"), as_real(S, "S")
    chi, phi_max = as_real(chi, "chi"), as_real(phi_max, "phi_max")
    for info, value in zip(DISTRIBUTION_PARAMETERS, (R, S, chi, phi_max), strict=True):
        info.check(value, owner)
    power_law_share = R * phi_max ** (chi + 1.0) / (chi + 1.0)
    return {
        "F_S": phi_max * (power_law_share * (chi + 1.0) / (chi + 2.0) + S),
        "K_T": power_law_share + S,
        "chi": chi,
        "beta": S / power_law_share,
    }


class AbstractIwan(AbstractJoint):
    """An element with Segalman's four-parameter distribution of sliders (A.1)."""

    F_S: eqx.AbstractVar[Array]
    K_T: eqx.AbstractVar[Array]
    chi: eqx.AbstractVar[Array]
    beta: eqx.AbstractVar[Array]

    @property
    def phi_max(self) -> Array:
        """Deflection at macroslip, length (2.10)."""
        return phi_max_of(self.F_S, self.K_T, self.chi, self.beta)

    @property
    def R(self) -> Array:
        """Strength of the power law, force/length^(chi+2) (2.11)."""
        return distribution_of(self.F_S, self.K_T, self.chi, self.beta)[0]

    @property
    def S(self) -> Array:
        """Strength of the Dirac slider, force/length (A.5)."""
        return distribution_of(self.F_S, self.K_T, self.chi, self.beta)[1]

    def slider_bank(self, sliders: int = SLIDERS) -> SliderBank:
        """A bank of sliders with K_T and F_S of the element (thesis Sec. 4.2.3).

        Parameters
        ----------
        sliders : int
            The default is within 0.2 % of the element's dissipation for strokes from a
            thousandth of phi_max on, where kinetic and static friction are the same.
        """
        phi, k = iwan_sliders(self.K_T, self.chi, self.beta, self.phi_max, sliders)
        theta = self.kinetic_share
        return SliderBank(phi, k, None if theta is None else theta[..., None])

    def discrete(self, sliders: int | None = SLIDERS) -> AbstractDiscrete:
        """:meth:`slider_bank`; None asks for the default number."""
        return self.slider_bank(SLIDERS if sliders is None else sliders)

    @property
    def kinetic_share(self) -> Array | None:
        """Kinetic over static friction of the sliders, 1; None where there is no difference."""
        return None

    @property
    def initial_stiffness(self) -> Array:
        """K_T, force/length."""
        return self.K_T

    @property
    def limit_stiffness(self) -> Array:
        """Zero: in macroslip the force grows no more."""
        return jnp.zeros_like(self.K_T)
