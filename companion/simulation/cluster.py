"""Workers of an existing dask cluster; its scheduler gives the jobs of a worker that dies to another one."""

import asyncio
import itertools
import logging
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar
from uuid import uuid4

from companion.core.interfaces import CompanionError, ConfigError
from companion.simulation.build import Build, this_build
from companion.simulation.workers import reporting

try:
    from distributed import Client, KilledWorker, get_worker
    from distributed.core import connect
except ImportError:
    raise ConfigError(
        "--on needs the package distributed: install it with pip install 'dauam-companion[cluster]', or in a checkout "
        "pip install -e '.[cluster]'"
    ) from None

Result = TypeVar("Result")
_P = ParamSpec("_P")

_CONNECT_S = 5.0
_WORKERS_S = 5.0
"""Waits for the scheduler and for a first worker."""
_UPDATE = "install the same on all workers, and start them again"


@contextmanager
def cluster(scheduler: str, advice: str) -> "Iterator[ClusterPool]":
    """Provide the workers of the cluster whose scheduler is at HOST:PORT.

    Raises ConfigError when it cannot be used, CompanionError, with the advice in its message, when it is lost or a job
    ends the process of every worker it is given to.
    """
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what goes wrong is said here, once
    client = _connected(scheduler)
    try:
        _check(client, scheduler)
        yield ClusterPool(client)
    except KilledWorker:
        raise CompanionError(
            f"dask://{scheduler}: several workers ended on their own at the same job (was the memory full?): {advice}"
        ) from None
    except CancelledError:
        raise CompanionError(f"dask://{scheduler}: the connection to the scheduler is lost: {advice}") from None
    finally:
        client.close(timeout=_CONNECT_S)


def _connected(scheduler: str) -> Client:
    try:
        asyncio.run(_ask_scheduler(scheduler))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of versions: see _check
            return Client(f"tcp://{scheduler}", timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, ImportError):
        raise ConfigError(
            f"--on dask://{scheduler}: no dask scheduler answers there: start one with `dask scheduler` on that "
            "computer, or correct the address"
        ) from None


async def _ask_scheduler(scheduler: str) -> None:
    """Raise OSError unless a scheduler answers: a client would wait forever for a server that says nothing."""
    async with asyncio.timeout(_CONNECT_S):
        comm = await connect(f"tcp://{scheduler}", timeout=_CONNECT_S)
        try:
            await comm.write({"op": "identity", "reply": True})
            answer = await comm.read()
        finally:
            comm.abort()
    if answer.get("type") != "Scheduler":
        raise ConnectionError(f"a dask {answer.get('type')} is there")


def _check(client: Client, scheduler: str) -> None:
    """Raise ConfigError unless there are workers, all with our build."""
    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except TimeoutError:
        raise ConfigError(
            f"--on dask://{scheduler}: the cluster has no workers: start some with `dask worker {scheduler}`"
        ) from None
    for address, build in _builds(client).items():
        if isinstance(build, Build):
            _require_same(build, f"--on dask://{scheduler}: the worker at {address}")
            continue
        raise ConfigError(f"--on dask://{scheduler}: the worker at {address} has no companion ({build}): {_UPDATE}")


def _builds(client: Client) -> dict[str, Any]:
    """Return each worker's build, or the exception that this ended in there."""
    return dict(client.run(this_build, on_error="return"))


def _require_same(build: Build, who: str) -> None:
    if difference := this_build().difference(build):
        raise ConfigError(f"{who} {difference}, so results would not be the same: {_UPDATE}")


class ClusterPool(Executor):
    """Executor of jobs on a cluster."""

    def __init__(self, client: Client) -> None:
        self._jobs = client.get_executor(pure=False)
        self._topic, self._numbers = f"companion-{uuid4()}", itertools.count()
        self._told: dict[int, float] = {}
        client.subscribe_topic(self._topic, self._hear)

    def submit(self, work: Callable[_P, Result], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[Result]:
        """Begin a job; it is given to another worker when its own ends."""
        future: Future[Result] = self._jobs.submit(
            _on_worker, this_build(), (self._topic, next(self._numbers)), work, args, kwargs
        )
        return future

    @property
    def reported(self) -> float:
        """Sum of what all jobs have reported."""
        return sum(list(self._told.values()))

    def _hear(self, event: tuple[float, tuple[int, float]]) -> None:
        number, done = event[1]
        self._told[number] = max(done, self._told.get(number, 0.0))  # one that begins again takes nothing back


def _on_worker(
    build: Build, name: tuple[str, int], work: Callable[..., Result], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> Result:
    """Run a job; ConfigError when this worker, which may have come late, has another build."""
    worker, (topic, number) = get_worker(), name
    if difference := build.difference(this_build()):
        raise ConfigError(f"the worker at {worker.address} {difference}: {_UPDATE}")
    with reporting(lambda done: worker.log_event(topic, (number, done))):
        return work(*args, **kwargs)
