"""How JAX's compiler is set where a command's time is all that its user waits for."""

import os
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
# Versions that know the flags; others stop the process at one they do not know.
_KNOWN_BY = (0, 10)


def compile_quickly() -> None:
    """Ask for half the compile time, and for loops of small steps in one piece, where jaxlib can.

    Adds to ``XLA_FLAGS``, which XLA reads when JAX computes for the first time. For commands and
    tests: large batches on many cores may do better without. Leaves alone what is set already;
    does nothing where jaxlib does not know the flags (from 0.11 on).
    """
    if _jaxlib() != _KNOWN_BY:
        return
    given = os.environ.get("XLA_FLAGS", "")
    added = [flag for flag in _FLAGS if flag.split("=")[0] not in given]
    os.environ["XLA_FLAGS"] = " ".join([given, *added]).strip()


def _jaxlib() -> tuple[int, ...]:
    """Its version's first two numbers."""
    return tuple(int(part) for part in version("jaxlib").split(".")[:2])
