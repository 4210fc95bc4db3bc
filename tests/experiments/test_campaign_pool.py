"""Work on several processes. The functions are the standard library's, so that the processes start quickly."""

import math
import operator
import os
from collections.abc import Iterator

import pytest

from companion.experiments.campaign_pool import in_parallel
from companion.ports import CompanionError


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_comes_back_with_its_number(jobs: int) -> None:
    assert dict(in_parallel(operator.neg, [5, 6, 7], jobs)) == {0: -5, 1: -6, 2: -7}


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_goes_wrong_there_goes_wrong_here(jobs: int) -> None:
    with pytest.raises(ValueError, match="math domain error"):
        list(in_parallel(math.sqrt, [1.0, -1.0], jobs))


def test_a_process_that_dies_is_told_in_a_sentence() -> None:
    with pytest.raises(CompanionError, match=r"ended on its own .* try fewer --jobs"):
        list(in_parallel(os._exit, [1, 1], 2))


def test_children_keep_to_one_thread_and_the_parent_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    names = ["OMP_NUM_THREADS", "MKL_NUM_THREADS"]
    assert dict(in_parallel(os.getenv, names, 2)) == {0: "1", 1: "1"}
    assert (os.getenv("OMP_NUM_THREADS"), os.getenv("MKL_NUM_THREADS")) == ("7", None)


def test_in_one_process_nothing_is_done_before_it_is_asked_for() -> None:
    asked: list[int] = []
    results: Iterator[tuple[int, None]] = in_parallel(asked.append, [1, 2, 3], 1)
    next(results)
    assert asked == [1]
