"""Worker processes: each computes in one thread, leaves Ctrl-C to its parent, and ends with it."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

from companion.core.interfaces import CompanionError

Task = TypeVar("Task")
Result = TypeVar("Result")
_P = ParamSpec("_P")

SPAWN = multiprocessing.get_context("spawn")
"""Start method of workers. Not fork: the thread of a progress bar may hold any lock at that instant."""

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@contextmanager
def workers(
    jobs: int, advice: str, begin: Callable[..., None] | None = None, given: tuple[Any, ...] = ()
) -> Iterator[Executor]:
    """Provide `jobs` processes, each initialised by `begin(*given)`. Their tasks must be functions of a module.

    An exception inside the block, also Ctrl-C or the end of a generator, ends the processes at once. Raises
    CompanionError, with the advice in its message, when a process dies by itself.
    """
    pool = _Workers(jobs, SPAWN, _begin, (begin, given))
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


def in_parallel(
    work: Callable[[Task], Result], tasks: Sequence[Task], jobs: int, advice: str
) -> Iterator[tuple[int, Result]]:
    """Yield each task's number and result as they complete, or raise its error; one job stays in this process."""
    if jobs == 1 or len(tasks) < 2:
        yield from ((number, work(task)) for number, task in enumerate(tasks))
        return
    with workers(min(jobs, len(tasks)), advice) as pool:
        numbers = {pool.submit(work, task): number for number, task in enumerate(tasks)}
        for future in as_completed(numbers):
            yield numbers[future], future.result()


class _Workers(ProcessPoolExecutor):
    """Process pool; every submission may start a process, which inherits signal mask and environment."""

    def submit(self, fn: Callable[_P, Result], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[Result]:
        with _as_children_need_it():
            return super().submit(fn, *args, **kwargs)


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


def _begin(begin: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin(*given)


def _end_with_parent() -> None:
    """End this worker when its parent has ended, also if that was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
