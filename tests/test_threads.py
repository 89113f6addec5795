import os

import numpy as np
import pytest
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_info

import iwanjax as ij
from iwanjax.quasistatic import levels
from iwanjax.threads import available_threads, one_thread


def threads() -> list[int]:
    return [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]


def test_blas_keeps_to_one_thread_and_gets_its_own_back():
    before = threads()
    assert before
    with one_thread():
        assert set(threads()) == {1}
    assert threads() == before


def test_it_is_a_decorator_too():
    assert set(one_thread()(threads)()) == {1}


@pytest.fixture
def on_processors(monkeypatch):
    """A machine of 16 processors, of which this process may use as many, and no settings."""
    for name in ("OMP_NUM_THREADS", "XLA_FLAGS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 16)

    def some(count):
        if count is None:
            monkeypatch.delattr(os, "sched_getaffinity", raising=False)
        else:
            monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(count)), raising=False)

    return some


@pytest.mark.parametrize(("count", "expected"), [(1, 1), (2, 2), (12, 12), (None, 16)])
def test_threads_follow_the_affinity_else_the_machine(on_processors, count, expected):
    on_processors(count)
    assert available_threads() == expected


def test_a_machine_that_does_not_tell_has_one_processor(on_processors, monkeypatch):
    on_processors(None)
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert available_threads() == 1


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("OMP_NUM_THREADS", "3", 3),
        ("OMP_NUM_THREADS", "4,2", 4),
        ("OMP_NUM_THREADS", "99", 12),
        ("OMP_NUM_THREADS", "0", 12),
        ("OMP_NUM_THREADS", "", 12),
        ("OMP_NUM_THREADS", "many", 12),
        ("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=5", 1),
        ("XLA_FLAGS", "--xla_other=1 intra_op_parallelism_threads=5", 5),
        ("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=true", 12),
        ("XLA_FLAGS", "--xla_force_host_platform_device_count=8", 12),
    ],
)
def test_the_users_own_settings_count(on_processors, monkeypatch, name, value, expected):
    on_processors(12)
    monkeypatch.setenv(name, value)
    assert available_threads() == expected


def test_a_large_batch_uses_the_threads_that_there_are(on_processors, monkeypatch):
    on_processors(3)
    asked = []
    pool = levels.ThreadPoolExecutor
    monkeypatch.setattr(levels, "ThreadPoolExecutor", lambda n: asked.append(n) or pool(n))
    monkeypatch.setattr(levels, "BLOCK", 2)
    joint = ij.Iwan4(F_S=10.0, K_T=np.linspace(1.0, 2.0, 5), chi=-0.5, beta=5.0)
    chain = ij.LinearStructure(np.eye(2), None, [[2.0, -1.0], [-1.0, 2.0]])
    solution = ij.qsma(ij.JointedStructure(chain, {"J1": ([-1.0, 1.0], joint)}), 0, [0.1], 1e-3)
    assert asked == [3]
    assert np.all(solution.converged)
