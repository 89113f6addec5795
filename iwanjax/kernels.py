"""Compiled kernels that outlive the process, beside those that JAX's own cache keeps.

JAX's cache spares a second process the compiler, not the tracing of a function and its lowering,
which for kernels of a thousand operations take longer than most of what they compute.
"""

import hashlib
import os
import pickle
import platform
from collections.abc import Callable, Sequence
from functools import cache, update_wrapper
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from iwanjax.files import whole_file


class Kept:
    """A function of arrays and modules, compiled once for all processes.

    Where JAX has a folder for its compilation cache (``jax_compilation_cache_dir``), compiled
    kernels are kept there too; without one, or without a name, as by ``equinox.filter_jit``.

    Parameters
    ----------
    function : function
        Pure, of positional arguments; gives a tuple of arrays.
    name : function
        Arguments -> what of them is compiled in beside numbers, words and the shapes of arrays,
        in words that are the same in every process; None where there are none.
    """

    def __init__(
        self,
        function: Callable[..., Sequence[Any]],
        name: Callable[..., str | None],
    ) -> None:
        self._function, self._name = function, name
        self._compiled = eqx.filter_jit(function)
        self._kernels: dict[str, Callable[..., tuple[Any, ...]]] = {}
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Sequence[Any]:
        """The function's results, by a kernel that may be older than this process."""
        folder, name = jax.config.values["jax_compilation_cache_dir"], self._name(*arguments)
        if not folder or name is None:
            return self._compiled(*arguments)
        dynamic, static = eqx.partition(arguments, lambda x: isinstance(x, (jax.Array, np.ndarray)))
        leaves, structure = jax.tree.flatten(dynamic)
        shapes = [(x.shape, str(x.dtype)) for x in leaves]
        values = [x for x in jax.tree.leaves(static) if isinstance(x, (bool, int, float, str))]
        told = f"{self._function.__qualname__} {name} {values} {shapes} {_surroundings()}"
        key = hashlib.sha256(told.encode()).hexdigest()
        if key not in self._kernels:

            def flat(*leaves: Any) -> tuple[Any, ...]:
                given = eqx.combine(jax.tree.unflatten(structure, leaves), static)
                return tuple(self._function(*given))

            # A name of its own in JAX's cache too: what was loaded from there cannot be kept again.
            flat.__name__ = f"iwanjax_{key}"
            place = Path(folder) / f"iwanjax-{key}.kernel"
            self._kernels[key] = _read(place) or _made(flat, leaves, place)
        return self._kernels[key](*leaves)


def _read(place: Path) -> Callable[..., tuple[Any, ...]] | None:
    """The kernel that is kept there, if it can be loaded."""
    try:
        return _loaded(place.read_bytes())
    # Whatever is wrong with what was kept: it can be made again.
    except Exception:
        return None


def _loaded(whole: bytes) -> Callable[..., tuple[Any, ...]]:
    from jax.experimental.serialize_executable import deserialize_and_load

    return deserialize_and_load(*pickle.loads(whole))


def _made(
    flat: Callable[..., tuple[Any, ...]], leaves: Sequence[Any], place: Path
) -> Callable[..., tuple[Any, ...]]:
    """Compile a kernel, and keep it if it still runs after it was kept."""
    from jax.experimental.serialize_executable import serialize

    compiled = jax.jit(flat).lower(*leaves).compile()
    try:
        whole = pickle.dumps(serialize(compiled))
        jax.block_until_ready(_loaded(whole)(*leaves))
        with whole_file(place) as file:
            file.write(whole)
    # Not every backend can, nor every disk.
    except (ValueError, TypeError, OSError, NotImplementedError, jax.errors.JaxRuntimeError):
        pass
    return compiled


@cache
def _surroundings() -> str:
    """All that a kernel depends on beside what it computes: our code, versions, the machine."""
    source = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source.update(path.read_bytes())
    device = jax.devices()[0]
    return " ".join(
        [
            source.hexdigest(),
            jax.__version__,
            version("jaxlib"),
            device.device_kind,
            str(jax.device_count()),
            os.environ.get("XLA_FLAGS", ""),
            _processor(),
        ]
    )


def _processor() -> str:
    """What it can do: kernels are compiled for it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")
