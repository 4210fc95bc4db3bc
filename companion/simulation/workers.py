"""Workers that compute the jobs of a study: processes of this computer, or those of a dask cluster.

A local process computes in one thread, leaves Ctrl-C to its parent, and ends with it.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any, ParamSpec, Protocol, TypeVar

from companion.core.interfaces import CompanionError
from companion.simulation.kept_results import KeptResults

Task = TypeVar("Task")
Result = TypeVar("Result")
_P = ParamSpec("_P")
Progress = Callable[[float], None]

_SPAWN = multiprocessing.get_context("spawn")
"""Start method of workers. Not fork: the thread of a progress bar may hold any lock at that instant."""
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_POLL_S = 0.2


@dataclass(frozen=True)
class Backend:
    """Computers that a study runs on: the results are the same on every one."""

    jobs: int = 1
    """Number of processes of this computer."""
    scheduler: str | None = None
    """HOST:PORT of a dask cluster's scheduler, which decides the number; None: this computer."""


class Pool(Protocol):
    """Executor of jobs, and what they have reported so far."""

    def submit(self, work: Callable[[Task], Result], task: Task, /) -> "Future[Result]":
        """Begin a job."""

    @property
    def reported(self) -> float:
        """Sum of what all jobs have reported."""


class Workers:
    """Workers of a study, and the results that it has kept."""

    def __init__(self, pool: Pool | None, kept: KeptResults | None = None) -> None:
        self._pool, self._kept = pool, kept

    def each(
        self, work: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress = lambda _: None
    ) -> Iterator[tuple[int, Result]]:
        """Yield each task's number and result, kept ones first, then as they complete, or raise its error.

        `work` is a function of a module; tasks and results can be pickled. `progress` gets the sum of what the jobs
        have told `report` so far.
        """
        found = {} if self._kept is None else self._kept.found(work, tasks)
        yield from found.items()
        missing = {number: task for number, task in enumerate(tasks) if number not in found}
        for number, result in self._computed(work, missing, progress):
            if self._kept is not None:
                self._kept.write(work, missing[number], result)
            yield number, result

    def in_order(
        self, work: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress = lambda _: None
    ) -> list[Result]:
        """Return the results in the order of the tasks."""
        done = dict(self.each(work, tasks, progress))
        return [done[number] for number in range(len(tasks))]

    def _computed(
        self, work: Callable[[Task], Result], tasks: dict[int, Task], progress: Progress
    ) -> Iterator[tuple[int, Result]]:
        if self._pool is None:
            yield from _here(work, tasks, progress)
            return
        before = self._pool.reported
        numbers = {self._pool.submit(work, task): number for number, task in tasks.items()}
        pending = set(numbers)
        while pending:
            finished, pending = wait(pending, _POLL_S, FIRST_COMPLETED)
            progress(self._pool.reported - before)
            for future in finished:
                yield numbers[future], future.result()


@contextmanager
def workers(backend: Backend, advice: str, kept: Path | None = None, fresh: bool = False) -> Iterator[Workers]:
    """Provide a study's workers; results are kept in the folder `kept`, and `fresh` reuses none of them.

    An exception inside the block, also Ctrl-C or the end of a generator, ends the jobs; what is kept stays. Raises
    CompanionError, with the advice in its message, when a process dies by itself or the cluster is lost.
    """
    results = None if kept is None else KeptResults(kept, fresh)
    if backend.scheduler is not None:
        from companion.simulation.cluster import cluster  # noqa: PLC0415 - an optional package

        with cluster(backend.scheduler, advice) as pool:
            yield Workers(pool, results)
    elif backend.jobs == 1:
        yield Workers(None, results)
    else:
        with processes(backend.jobs, advice) as local:
            yield Workers(local, results)


def in_parallel(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    backend: Backend,
    advice: str,
    kept: Path | None = None,
    fresh: bool = False,
) -> Iterator[tuple[int, Result]]:
    """Yield results as `Workers.each` of the workers of one study, see `workers`."""
    enough = replace(backend, jobs=min(backend.jobs, max(len(tasks), 1)))
    with workers(enough, advice, kept, fresh) as crew:
        yield from crew.each(work, tasks)


_REPORT: ContextVar[Progress] = ContextVar("report")


def report(done: float) -> None:
    """Report from inside a job that `done` of it is done, in the study's own unit; outside of one it does nothing."""
    if tell := _REPORT.get(None):
        tell(done)


@contextmanager
def reporting(tell: Progress) -> Iterator[None]:
    """Give what the job in this block reports to `tell`."""
    token = _REPORT.set(tell)
    try:
        yield
    finally:
        _REPORT.reset(token)


def _here(work: Callable[[Task], Result], tasks: dict[int, Task], progress: Progress) -> Iterator[tuple[int, Result]]:
    """Compute in this process."""
    told: dict[int, float] = {}
    for number, task in tasks.items():

        def tell(done: float, number: int = number) -> None:
            told[number] = done
            progress(sum(told.values()))

        with reporting(tell):
            result = work(task)
        yield number, result


@contextmanager
def processes(jobs: int, advice: str) -> "Iterator[Processes]":
    """Provide `jobs` processes. Their tasks must be functions of a module."""
    pool = Processes(jobs)
    try:
        yield pool
    except BaseException as error:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():
            child.terminate()
        if isinstance(error, BrokenProcessPool):
            raise CompanionError(f"a worker process ended on its own (was the memory full?): {advice}") from None
        raise
    pool.shutdown()


class Processes(Executor):
    """Process pool; every submission may start a process, which inherits signal mask and environment."""

    def __init__(self, jobs: int) -> None:
        self._reported = _SPAWN.Value("d", 0.0)
        self._pool = ProcessPoolExecutor(jobs, _SPAWN, _begin, (self._reported,))

    def submit(self, work: Callable[_P, Result], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[Result]:
        """Begin a job."""
        with _as_children_need_it():
            return self._pool.submit(_in_child, work, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when their jobs are done."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    @property
    def reported(self) -> float:
        """Sum of what all jobs have reported."""
        return float(self._reported.value)


@contextmanager
def _as_children_need_it() -> Iterator[None]:
    """Start child processes that ignore Ctrl-C from their first instruction and compute in one thread."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    kept = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        yield
    finally:
        for name, value in kept.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Child:
    """Data that a worker process receives from its parent."""

    reported: "Synchronized[float]"


def _begin(reported: "Synchronized[float]") -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _Child.reported = reported


def _in_child(work: Callable[..., Result], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Result:
    told = 0.0

    def tell(done: float) -> None:
        nonlocal told
        with _Child.reported.get_lock():
            _Child.reported.value += done - told
        told = done

    with reporting(tell):
        return work(*args, **kwargs)


def _end_with_parent() -> None:
    """End this worker when its parent has ended, also if that was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
