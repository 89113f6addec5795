"""Threads of the linear algebra library."""

from collections.abc import Iterator
from contextlib import contextmanager


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
