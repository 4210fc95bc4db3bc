"""The client for scripts without asyncio: the same names, each call returns when it is done.

Connections live in an event loop of their own, in a thread that ends with them.
"""

import asyncio
import functools
import threading
from collections.abc import AsyncGenerator, Callable, Coroutine, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import AbstractAsyncContextManager, AbstractContextManager, contextmanager
from types import TracebackType
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from companion.client import connecting
from companion.client import vehicle as asynchronous
from companion.client.connecting import results_of
from companion.client.tasks import end
from companion.client.vehicle import Progress
from companion.core.types import Array
from companion.protocol.telemetry import State

__all__ = ["Arms", "Vehicle", "connect", "connect_all", "together", "vehicles"]
V = TypeVar("V")
V_co = TypeVar("V_co", covariant=True)
P = ParamSpec("P")
T = TypeVar("T")


class _LoopThread:
    """Event loop in a thread of its own."""

    def __init__(self) -> None:
        self._loop: Future[asyncio.AbstractEventLoop] = Future()
        self._closing = asyncio.Event()
        self._thread = threading.Thread(target=asyncio.run, args=(self._run(),), name="companion.client", daemon=True)
        self._thread.start()

    async def _run(self) -> None:
        self._loop.set_result(asyncio.get_running_loop())
        await self._closing.wait()

    def wait_for(self, work: Coroutine[Any, Any, T]) -> T:
        """Return the result of a coroutine; cancel it, and wait for its end, if Ctrl-C comes first."""
        task = self._submit(_begin(work)).result()
        future = self._submit(_result_of(task))
        try:
            return future.result()
        finally:
            if not future.done():
                self._submit(end(task)).result()

    def close(self) -> None:
        """End the loop and its thread."""
        self._loop.result().call_soon_threadsafe(self._closing.set)
        self._thread.join()

    def _submit(self, work: Coroutine[Any, Any, T]) -> "Future[T]":
        return asyncio.run_coroutine_threadsafe(work, self._loop.result())


async def _begin(work: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
    return asyncio.create_task(work)


async def _result_of(task: asyncio.Task[T]) -> T:
    return await task


class _Connection:
    """Open connections to vehicles, and the thread that they live in."""

    def __init__(self, opening: AbstractAsyncContextManager[tuple[asynchronous.Vehicle, ...]]) -> None:
        self.thread, self._opening = _LoopThread(), opening
        try:
            self.vehicles = self.thread.wait_for(opening.__aenter__())
        except BaseException:
            self.thread.close()
            raise

    def leave(self, error: BaseException | None) -> None:
        """Make the vehicles safe because of an error, and close the connections."""
        kind, trace = (None, None) if error is None else (type(error), error.__traceback__)
        try:
            self.thread.wait_for(self._opening.__aexit__(kind, error, trace))
        finally:
            self.thread.close()


class _Twin(Generic[V_co]):
    """Synchronous twin of an object of the asyncio client."""

    def __init__(self, inner: V_co, thread: _LoopThread) -> None:
        self._inner, self._thread = inner, thread


def _waiting(method: Callable[Concatenate[V, P], Coroutine[Any, Any, T]]) -> Callable[Concatenate[_Twin[V], P], T]:
    """Return a method with the same parameters that waits for the result."""

    @functools.wraps(method)
    def call(twin: _Twin[V], /, *args: P.args, **kwargs: P.kwargs) -> T:
        return twin._thread.wait_for(method(twin._inner, *args, **kwargs))

    return call


def _iterating(
    method: Callable[Concatenate[V, P], AsyncGenerator[T, None]],
) -> Callable[Concatenate[_Twin[V], P], Iterator[T]]:
    """Return a method with the same parameters that iterates without `async`."""

    @functools.wraps(method)
    def call(twin: _Twin[V], /, *args: P.args, **kwargs: P.kwargs) -> Iterator[T]:
        stream = method(twin._inner, *args, **kwargs)
        try:
            while True:
                yield twin._thread.wait_for(stream.asend(None))
        finally:
            twin._thread.wait_for(stream.aclose())

    return call


class _Same(Generic[T]):
    """Attribute that is the asyncio object's."""

    def __set_name__(self, _: type, name: str) -> None:
        self._name = name

    def __get__(self, twin: _Twin[Any], _: type | None = None) -> T:
        value: T = getattr(twin._inner, self._name)
        return value

    def __set__(self, twin: _Twin[Any], value: T) -> None:
        setattr(twin._inner, self._name, value)


class Arms(_Twin[asynchronous.Arms]):
    """Commands for the arms of one vehicle; from `Vehicle.arms`."""

    ready = _waiting(asynchronous.Arms.ready)
    stow = _waiting(asynchronous.Arms.stow)
    play = _waiting(asynchronous.Arms.play)
    hold = _waiting(asynchronous.Arms.hold)
    limp = _waiting(asynchronous.Arms.limp)
    clear = _waiting(asynchronous.Arms.clear)


class Vehicle(_Twin[asynchronous.Vehicle]):
    """One vehicle that a script commands and follows; from `connect`. Usable from several threads."""

    def __init__(self, connection: _Connection, inner: asynchronous.Vehicle) -> None:
        super().__init__(inner, connection.thread)
        self._connection = connection
        self.arms = Arms(inner.arms, connection.thread)

    name = _Same[str]()
    state = _Same[State]()
    state_age_s = _Same[float]()
    position_w_m = _Same[Array]()
    velocity_w_mps = _Same[Array]()
    reference_w_m = _Same[Array]()
    timeout_s = _Same[float]()
    progress = _Same[Callable[[Progress], None] | None]()
    preflight = _waiting(asynchronous.Vehicle.preflight)
    arm = _waiting(asynchronous.Vehicle.arm)
    takeoff = _waiting(asynchronous.Vehicle.takeoff)
    goto = _waiting(asynchronous.Vehicle.goto)
    track = _waiting(asynchronous.Vehicle.track)
    controller = _waiting(asynchronous.Vehicle.controller)
    hold = _waiting(asynchronous.Vehicle.hold)
    land = _waiting(asynchronous.Vehicle.land)
    abort = _waiting(asynchronous.Vehicle.abort)
    resume = _waiting(asynchronous.Vehicle.resume)
    disarm = _waiting(asynchronous.Vehicle.disarm)
    kill = _waiting(asynchronous.Vehicle.kill)
    params = _waiting(asynchronous.Vehicle.params)
    execute = _waiting(asynchronous.Vehicle.execute)
    wait_until = _waiting(asynchronous.Vehicle.wait_until)
    states = _iterating(asynchronous.Vehicle.states)
    events = _iterating(asynchronous.Vehicle.events)

    def close(self) -> None:
        """End the connection; nothing is commanded. After `with` it is closed."""
        self._connection.leave(None)

    def __enter__(self) -> "Vehicle":
        return self

    def __exit__(self, _: type[BaseException] | None, error: BaseException | None, __: TracebackType | None) -> None:
        self._connection.leave(error)


def _connecting(function: Callable[P, connecting.Connecting]) -> Callable[P, Vehicle]:
    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> Vehicle:
        connection = _Connection(function(*args, **kwargs).opening)
        return Vehicle(connection, connection.vehicles[0])

    return call


def _connecting_all(
    function: Callable[P, AbstractAsyncContextManager[tuple[asynchronous.Vehicle, ...]]],
) -> Callable[P, AbstractContextManager[tuple[Vehicle, ...]]]:
    @contextmanager
    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> Iterator[tuple[Vehicle, ...]]:
        connection = _Connection(function(*args, **kwargs))
        try:
            yield tuple(Vehicle(connection, inner) for inner in connection.vehicles)
        except BaseException as error:
            connection.leave(error)
            raise
        else:
            connection.leave(None)

    return call


def _running(function: Callable[P, Coroutine[Any, Any, T]]) -> Callable[P, T]:
    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        thread = _LoopThread()
        try:
            return thread.wait_for(function(*args, **kwargs))
        finally:
            thread.close()

    return call


connect = _connecting(connecting.connect)
connect_all = _connecting_all(connecting.connect_all)
vehicles = _running(connecting.vehicles)


def together(*calls: Callable[[], T]) -> list[T]:
    """Make calls at the same time, each in a thread, such as `together(left.takeoff, right.takeoff)`.

    Return their results in their order; if some fail, wait for the others and raise the errors.
    """
    pool = ThreadPoolExecutor(max(1, len(calls)))
    futures = [pool.submit(call) for call in calls]
    try:
        wait(futures)
    finally:
        pool.shutdown(wait=False)  # Ctrl-C: the calls end when their vehicles have landed
    return results_of([future.exception() or future.result() for future in futures])
