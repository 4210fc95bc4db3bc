"""Work on several processes. The functions are the standard library's, so that the processes start quickly."""

import math
import multiprocessing
import operator
import os
import signal
import time
from collections.abc import Iterator
from multiprocessing.process import BaseProcess

import pytest

from companion.core.interfaces import CompanionError
from companion.simulation.workers import Backend, Workers, in_parallel, processes, report

pytestmark = pytest.mark.slow

ADVICE = "try fewer"


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_comes_back_with_its_number(jobs: int) -> None:
    assert dict(in_parallel(operator.neg, [5, 6, 7], Backend(jobs), ADVICE)) == {0: -5, 1: -6, 2: -7}


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_goes_wrong_there_goes_wrong_here(jobs: int) -> None:
    with pytest.raises(ValueError, match="math domain error"):
        list(in_parallel(math.sqrt, [1.0, -1.0], Backend(jobs), ADVICE))


def test_a_process_that_dies_is_told_in_a_sentence() -> None:
    with pytest.raises(CompanionError, match=r"ended on its own .*: try fewer$"):
        list(in_parallel(os._exit, [1, 1], Backend(2), ADVICE))


def test_children_keep_to_one_thread_and_the_parent_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    names = ["OMP_NUM_THREADS", "MKL_NUM_THREADS"]
    assert dict(in_parallel(os.getenv, names, Backend(2), ADVICE)) == {0: "1", 1: "1"}
    assert (os.getenv("OMP_NUM_THREADS"), os.getenv("MKL_NUM_THREADS")) == ("7", None)


def test_in_one_process_nothing_is_done_before_it_is_asked_for() -> None:
    asked: list[int] = []
    results: Iterator[tuple[int, None]] = in_parallel(asked.append, [1, 2, 3], Backend(1), ADVICE)
    next(results)
    assert asked == [1]


def test_ctrl_c_is_the_parents_to_act_on_in_whatever_process_is_begun_late() -> None:
    with processes(2, ADVICE) as pool:
        assert pool.submit(operator.neg, 1).result() == -1
        masks = [pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ()) for _ in range(2)]
        assert all(signal.SIGINT in mask.result() for mask in masks)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_ctrl_c_ends_the_processes_in_the_middle_of_their_work() -> None:
    children: list[BaseProcess] = []

    def interrupted_at_work() -> None:
        with processes(1, ADVICE) as pool:
            pool.submit(time.sleep, 1e6)
            children.extend(multiprocessing.active_children())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted_at_work()
    (child,) = children
    child.join()


def test_what_jobs_report_adds_up() -> None:
    with processes(2, ADVICE) as pool:
        told = list[float]()
        Workers(pool).in_order(report, [2.0, 5.0], told.append)
        assert told[-1] == 7.0
