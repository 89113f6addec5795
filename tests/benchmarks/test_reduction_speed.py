"""A Brake-Reuss mesh of 49 000 degrees of freedom, from its geometry to 84 coordinates.

Run by ``make bench``. Time, share of assembly and peak memory are printed and kept in the
benchmark's ``extra_info``; the promise is 60 s on two cores and 4 GB.
"""

import resource
import time

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem (extra fem) is not installed")

from iwanjax.structures.fem.brake_reuss import (
    brake_reuss_full,
    brake_reuss_springs,
)
from iwanjax.structures.full_model import check_reduction

SPRINGS = brake_reuss_springs()


def build():
    start = time.perf_counter()
    full = brake_reuss_full(size=7.0)
    assembled = time.perf_counter()
    return full, full.reduce(24), assembled - start


def test_build_and_reduce(benchmark):
    full, reduced, assembly = benchmark.pedantic(build, rounds=1)
    seconds = benchmark.stats.stats.min
    gigabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    size = full.M.shape[0]
    figures = {"dofs": size, "seconds": seconds, "assembly_s": assembly, "peak_GB": gigabytes}
    benchmark.extra_info.update(figures)
    print("\n" + "  ".join(f"{k} {v:.4g}" for k, v in figures.items()))
    assert size >= 49_000
    assert gigabytes < 4.0
    check = check_reduction(full, reduced, SPRINGS, 2000.0)
    print(check)
    assert check.enough(1.5e-3)
    bending = check.full[[1, 2, 6, 7]]
    np.testing.assert_allclose(bending, [175.06, 589.99, 1196.0, 1651.6], rtol=6e-3)
