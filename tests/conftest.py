"""Set-up that every test shares: double precision, no display, no time limits under JIT."""

import gc
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

# JAX reads this when it is imported; a GPU in the machine must not change what the tests see.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Both cores are busy with tests: a second thread of BLAS in each process would wait, and spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Where the command line keeps compiled kernels: not in anybody's home, but shared by the tests, by
# both of their processes and by the notebooks' kernels, of which many compile the same.
os.environ.setdefault("IWANJAX_CACHE", str(Path(tempfile.gettempdir()) / "iwanjax-test-kernels"))
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", os.environ["IWANJAX_CACHE"])
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")

import hypothesis
import jax
import matplotlib as mpl
import pytest
from jaxlib.mlir import ir

from iwanjax.compiler import compile_quickly

# Fewer optimisations in notebooks' kernels and the tests' other processes, which inherit it: a
# tenth less here, while long runs lose a fifth. Each kernel in one piece: both cores are busy, and
# pieces cost memory mappings (below).
compile_quickly()
os.environ["XLA_FLAGS"] = (
    "--xla_backend_optimization_level=1 --xla_cpu_parallel_codegen_split_count=1 "
    + os.environ.get("XLA_FLAGS", "")
)
# Tracing makes many objects that stay: looking through them again and again took a twentieth.
gc.set_threshold(100_000, 20, 20)
jax.config.update("jax_enable_x64", True)
mpl.use("Agg")

# The first example of a test compiles, so no time per example is fair.
hypothesis.settings.register_profile("default", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "default")


# JAX keeps an MLIR context for every kernel, and each new one looks through what a thread keeps for
# all of them: a small kernel took 40 ms at first, 56 ms beside 1000 others, 39 ms beside as many
# without threads in these contexts.
ir.Context.set_thread_pool = lambda context, pool: context.enable_multithreading(False)

# Each kernel takes a dozen memory mappings, of which Linux gives a process 65 530 unless told
# otherwise. To forget 900 of them takes 2 s, and what comes after compiles again or is read from
# the cache on the disk.
_MOST_MAPPINGS = 40_000


@pytest.fixture(autouse=True, scope="module")
def _few_mappings() -> Iterator[None]:
    """Forget compiled kernels between modules where the process has many."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > _MOST_MAPPINGS:
        jax.clear_caches()
        gc.collect()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Optimise kernels only of tests that compute for longer than they compile.

    Most of the tests' time is compilation, of what runs once: without optimisation two fifths of
    what it takes with it, while loops over time run two to three times as long.
    """
    computes = any(item.get_closest_marker(name) for name in ("computes", "long"))
    jax.config.update("jax_disable_most_optimizations", not computes)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests marked long run with IWANJAX_LONG=1 only."""
    if os.environ.get("IWANJAX_LONG") == "1":
        return
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.skip(reason="long: IWANJAX_LONG=1 runs it"))


@pytest.fixture(scope="session")
def reference_data() -> Path:
    """Folder of measured and published data, which is not part of the repository."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("IWANJAX_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no reference data in {folder}; set IWANJAX_DATA to their folder")
    return folder
