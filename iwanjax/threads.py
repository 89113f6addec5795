"""How many threads to work with: the machine's, or as many as the user asks for."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager

# Flags of XLA that bound its threads: a number, or one thread where Eigen's pool is off.
_XLA_NUMBER = re.compile(r"intra_op_parallelism_threads=(\d+)")
_XLA_ONE = re.compile(r"xla_cpu_multi_thread_eigen=(?:false|0)\b", re.IGNORECASE)


def available_threads() -> int:
    """Threads that this process may keep busy at once.

    The processors that the process may run on (its affinity, which job schedulers and ``taskset``
    set; else those of the machine), and no more than the user's own settings allow:
    ``OMP_NUM_THREADS``, and in ``XLA_FLAGS`` ``intra_op_parallelism_threads`` and
    ``xla_cpu_multi_thread_eigen=false``.

    Returns
    -------
    int
        At least 1. A limit on processor time (a container's quota) is not seen.
    """
    # macOS and Windows have no affinity.
    affinity = getattr(os, "sched_getaffinity", None)
    machine = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, min([machine, *_asked_for()]))


def _asked_for() -> list[int]:
    """Bounds in the environment; what is no number bounds nothing, as for OpenMP."""
    # A list gives one number for each level of nested parallel regions.
    outermost = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    flags = os.environ.get("XLA_FLAGS", "")
    found = [*([outermost] if outermost.isdecimal() else []), *_XLA_NUMBER.findall(flags)]
    # Zero leaves the choice to the library.
    return [int(each) for each in found if int(each)] + [1] * bool(_XLA_ONE.search(flags))


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep BLAS and LAPACK to one thread, as context or as decorator.

    Matrices of a hundred rows gain nothing from more; the others then only wait, busily, and take
    the cores from the compiled kernels beside them (on two cores and 84 coordinates, symmetric
    eigenproblems are up to ten times slower with two).
    """
    # SciPy has a library of its own, which has to be there before it can be told.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
