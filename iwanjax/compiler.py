"""How JAX's compiler is set where a command's time is all that its user waits for."""

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version

_FLAGS = (
    # The older of two ways to emit a kernel: half the compile time.
    "--xla_cpu_use_fusion_emitters=false",
    # A loop is one function of machine code, however many bytes it goes through: to call each of
    # its dozens of small operations, step by step, takes two to four times as long.
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000",
    # Which a loop cannot be whose matrix products are calls of a library.
    "--xla_cpu_experimental_ynn_fusion_type=",
)
_LOOP = "xla_cpu_small_while_loop_byte_threshold"
# Versions that know the flags; others stop the process at one they do not know.
_KNOWN_BY = (0, 10)


def compile_quickly() -> None:
    """Ask for half the compile time, and for loops of small steps in one piece, where jaxlib can.

    Adds to ``XLA_FLAGS``, which XLA reads when JAX computes for the first time: call it before,
    in a notebook in the first cell. Large batches on many cores may do better without. Leaves
    alone what is set already; does nothing where jaxlib does not know the flags (from 0.11 on,
    whose loops are in one piece anyway).

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.compile_quickly()  # in the first cell, before anything is computed
    >>> float(ij.LinearSpring(k=2.0).backbone(3.0))
    6.0
    """
    if _jaxlib() != _KNOWN_BY:
        return
    given = os.environ.get("XLA_FLAGS", "")
    added = [flag for flag in _FLAGS if flag.split("=")[0] not in given]
    os.environ["XLA_FLAGS"] = " ".join([given, *added]).strip()


@contextmanager
def on_the_processor() -> Iterator[None]:
    """Compute on the processor, whatever JAX's default device is; as context or as decorator.

    For loops over time with little to do in each step, of which an accelerator spends nearly all
    on starting its kernels. All threads follow while it lasts. Does nothing where JAX was told to
    leave the processor alone (``JAX_PLATFORMS``).
    """
    import jax

    before = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    # Of other platforms than those that JAX may use it knows no device.
    with suppress(RuntimeError):
        jax.config.update("jax_default_device", jax.local_devices(backend="cpu")[0])
    try:
        yield
    finally:
        jax.config.update("jax_default_device", before)


def warn_of_slow_loops() -> None:
    """Say once a session that loops over time take up to 15 times as long as they could.

    jaxlib 0.10, the newest for Python 3.11, calls each operation of a loop on its own: three masses
    with 100 sliders take 5.6 microseconds a step, and 0.4 after :func:`compile_quickly` or with
    jaxlib 0.12.
    """
    global _warned
    if _warned or _jaxlib() != _KNOWN_BY or _LOOP in os.environ.get("XLA_FLAGS", ""):
        return
    _warned = True
    warnings.warn(
        "jaxlib 0.10 runs loops over time up to 15 times slower than it can: call "
        "iwanjax.compile_quickly() before the first computation, or use Python 3.12 and "
        "jax 0.12",
        stacklevel=3,
    )


_warned = False


def _jaxlib() -> tuple[int, ...]:
    """Its version's first two numbers."""
    return tuple(int(part) for part in version("jaxlib").split(".")[:2])
