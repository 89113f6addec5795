"""Pieces of work: all are done, whoever is killed meanwhile, and the numbers are the same."""

import os
import signal
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from iwanjax.cluster import pieces
from iwanjax.errors import InputError

pytest.importorskip("distributed")


def square(number):
    time.sleep(0.05)
    return number**2, os.getpid()


@pytest.fixture(autouse=True)
def _workers_find_this_module(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), *sys.path]))


def test_a_killed_worker_of_three_loses_nothing_and_changes_no_number():
    found, workers = {}, []
    for i, (value, worker) in pieces(square, range(60), workers=3):
        found[i] = value
        workers.append(worker)
        if len(found) == 6:
            os.kill(worker, signal.SIGKILL)
    assert found == {i: i**2 for i in range(60)}
    assert len(set(workers)) >= 3


def test_a_scheduler_that_runs_is_used_and_one_that_does_not_answer_is_refused():
    from distributed import LocalCluster

    with closing(
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0")
    ) as cluster:
        found = dict(pieces(square, [3, 4], scheduler=cluster.scheduler_address))
        assert {i: value for i, (value, _) in found.items()} == {0: 9, 1: 16}
    with pytest.raises(InputError, match=r"--scheduler nowhere: .*expected local, or the address"):
        next(pieces(square, [1], scheduler="nowhere"))


def test_without_the_extra_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'iwanjax\[dist\]'"):
        next(pieces(square, [1]))
