"""Array aliases and the few checks that every layer needs."""

import warnings
from collections.abc import Callable
from typing import Any, Literal, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jax import dtypes
from jax.core import Tracer
from jaxtyping import Array

from iwanjax.errors import InputError, PrecisionError

ArrayLike: TypeAlias = npt.ArrayLike | Array
"""What becomes an array: a number, nested sequences, a NumPy or a JAX array."""

_Function = TypeVar("_Function", bound=Callable[..., Any])

Initial: TypeAlias = Literal["rest", "unknown", "periodic"]
"""The state in which a recording begins; periodic is that of a steady cycle."""

Scalar: TypeAlias = float | Array
"""A number, or an array of numbers when a batch of parameter sets is carried."""

_SINGLE_PRECISION = (
    "JAX is in single precision, so {what} single precision (7 digits). Put "
    'jax.config.update("jax_enable_x64", True) before the first array is made, '
    "or set JAX_ENABLE_X64=1 in the environment."
)
_warned_single_precision = False


def double_precision() -> bool:
    """Whether JAX computes in float64 in this session."""
    return dtypes.canonicalize_dtype(float) == np.float64


def warn_single_precision() -> None:
    """Say once a session that results carry seven digits; the closed forms stay correct to them."""
    global _warned_single_precision
    if not _warned_single_precision and not double_precision():
        _warned_single_precision = True
        warnings.warn(_SINGLE_PRECISION.format(what="iwanjax results are"), stacklevel=4)


def require_double_precision(what: str) -> None:
    """Refuse a computation whose tolerance single precision cannot meet.

    Raises
    ------
    PrecisionError
        When ``jax_enable_x64`` is off.
    """
    if not double_precision():
        raise PrecisionError(
            _SINGLE_PRECISION.format(what=f"{what} cannot converge to 1e-9; it has only")
        )


def compiled_for_one_call(function: _Function) -> _Function:
    """``equinox.filter_jit`` without the compiler's optimisations.

    For kernels that are compiled and called about once: they compile in two thirds of the
    time, and a call takes twice as long.
    """
    # Equinox passes what jax.jit takes on; its annotations do not say so.
    jit: Any = eqx.filter_jit
    return jit(function, compiler_options={"xla_backend_optimization_level": 0})


def is_traced(*values: Any) -> bool:
    """Whether any leaf of the values is being traced by a JAX transformation (no number yet)."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values))


def as_real(value: ArrayLike, name: str) -> Array:
    """A real floating-point JAX array, or one clear error.

    Parameters
    ----------
    value : array_like
        A number, a sequence, a NumPy or a JAX array.
    name : str
        What the error calls it.

    Raises
    ------
    InputError
        When the value is not numeric, is complex, or holds NaN or infinity.
    """
    warn_single_precision()
    if is_traced(value):
        return jnp.asarray(value, dtype=dtypes.canonicalize_dtype(float))
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name}: {error}; expected a number or a rectangular array") from None
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name} is of type {array.dtype}; expected real numbers")
    if not np.all(np.isfinite(array)):
        bad = int(np.sum(~np.isfinite(array)))
        raise InputError(f"{name} holds {bad} NaN or infinite value(s); expected finite numbers")
    # A number stays a number inside a traced function too.
    with jax.ensure_compile_time_eval():
        return jnp.asarray(array, dtype=dtypes.canonicalize_dtype(float))


def real(value: ArrayLike) -> Array:
    """A real array of the session's precision; NaN passes, so that a missing point stays one."""
    return jnp.asarray(value, dtype=dtypes.canonicalize_dtype(float))
