"""How JAX's compiler is set where its time is most of what a user waits for."""

import os
from importlib.metadata import version

_QUICK = "--xla_cpu_use_fusion_emitters=false"
# Versions that know the flag; others stop the process at one they do not know.
_KNOWN_BY = (0, 10)


def compile_quickly() -> None:
    """Ask for half the compile time at up to half as slow kernels, where jaxlib can.

    Adds to ``XLA_FLAGS``, which XLA reads when JAX computes for the first time. The older of
    two ways to emit a kernel: for commands and tests, most of whose time is compilation. Does
    nothing where the flag is set already or jaxlib does not know it (from 0.11 on).
    """
    given = os.environ.get("XLA_FLAGS", "")
    if _jaxlib() == _KNOWN_BY and _QUICK.split("=")[0] not in given:
        os.environ["XLA_FLAGS"] = f"{given} {_QUICK}".strip()


def _jaxlib() -> tuple[int, ...]:
    """Its version's first two numbers."""
    return tuple(int(part) for part in version("jaxlib").split(".")[:2])
