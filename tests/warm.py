"""Programs of the project in processes of their own that begin at once: forked from one that has imported everything.

A second of imports is most of what starting one takes, and tests start hundreds. All else is as in a process that was
started anew: its standard streams, environment, signals, session and exit code. What a start itself is like (imports,
Ctrl-C before anything has begun) is tested with the interpreter, and so are demo and service as a whole.
"""

import asyncio
import asyncio.streams
import atexit
import contextlib
import io
import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from multiprocessing.context import ForkServerProcess
from multiprocessing.reduction import DupFd
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any
from unittest.mock import patch

from companion.cli.demo import mock_process as cold
from companion.cli.demo.mock_process import FaultTold, MockPorts

_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["tests.warm_modules"])

Begun = ForkServerProcess
"""A process; `exitcode` is None while it runs, and minus the number of the signal that killed it."""


def begin(
    module: str,
    *words: str,
    streams: tuple[int, int, int] = (0, 1, 2),
    environment: Mapping[str, str] = os.environ,
    folder: str | os.PathLike[str] = ".",
    new_session: bool = False,
) -> Begun:
    """`python -m MODULE WORDS` with these standard streams, which stay ours to close."""
    given, where = tuple(DupFd(stream) for stream in streams), str(Path(folder).resolve())
    process = _SERVER.Process(target=_become, args=(module, words, given, dict(environment), where, new_session))
    process.start()
    return process


@atexit.register
def _end_all() -> None:
    """Leave no process of a failed test behind, for which multiprocessing would wait."""
    for left in multiprocessing.active_children():
        if isinstance(left, ForkServerProcess):
            left.kill()


def _become(
    module: str, words: tuple[str, ...], streams: tuple[Any, ...], environment: dict[str, str], folder: str, new: bool
) -> None:
    """Run the program in the forked process, with its streams, environment and folder."""
    if new:
        os.setsid()
    for number, stream in enumerate(streams):
        os.dup2(stream.detach(), number)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.stdin = io.TextIOWrapper(io.BufferedReader(io.FileIO(0, closefd=False)))
    sys.stdout, sys.stderr = _written(1), _written(2)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = [module, *words]
    sys.modules.pop(module, None)  # it is to run as the program
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    finally:
        atexit._run_exitfuncs()


def _written(number: int) -> IO[str]:
    """Open a text stream without buffering, as with PYTHONUNBUFFERED."""
    return io.TextIOWrapper(io.FileIO(number, "w", closefd=False), encoding="utf-8", write_through=True)


def run(module: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `python -m MODULE WORDS` to its end; return exit code and output."""
    with (
        TemporaryFile("w+", encoding="utf-8") as out,
        TemporaryFile("w+", encoding="utf-8") as err,
        Path(os.devnull).open() as nothing,
    ):
        begun = begin(module, *words, streams=(nothing.fileno(), out.fileno(), err.fileno()))
        begun.join()
        for file in (out, err):
            file.seek(0)
        said, complained = out.read(), err.read()
    assert begun.exitcode is not None
    return subprocess.CompletedProcess([module, *words], begun.exitcode, said, complained)


class Warm(asyncio.subprocess.Process):
    """A process that was started here, with the interface of asyncio.subprocess.Process."""

    def __init__(self, begun: Begun) -> None:
        assert begun.pid is not None
        self._begun, self.pid = begun, begun.pid
        self.stdin = self.stdout = self.stderr = None

    @property
    def returncode(self) -> int | None:
        """Return the exit code; None while it runs."""
        return self._begun.exitcode

    def send_signal(self, signal: int) -> None:
        """Send a signal to the process, not to its group."""
        if self.returncode is None:
            os.kill(self.pid, signal)

    def terminate(self) -> None:
        """Send SIGTERM to the process."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL to the process."""
        self.send_signal(signal.SIGKILL)

    async def wait(self) -> int:
        """Wait for the end of the process; return its exit code."""
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        seen = os.dup(self._begun.sentinel)  # others may wait as well
        loop.add_reader(seen, ended.set)
        try:
            await ended.wait()
        finally:
            loop.remove_reader(seen)
            os.close(seen)
        self._begun.join()
        if self.stdin is not None:
            self.stdin.close()
        assert self.returncode is not None
        return self.returncode

    async def communicate(self, input: bytes | bytearray | memoryview | None = None) -> tuple[bytes, bytes]:  # noqa: A002 - as asyncio has it
        """Write `input`, wait for the end, and return the rest of both output streams."""
        if self.stdin is not None:
            self.stdin.write(input or b"")
            self.stdin.close()
        out, err = await asyncio.gather(_rest_of(self.stdout), _rest_of(self.stderr))
        await self.wait()
        return out, err


async def _rest_of(stream: asyncio.StreamReader | None) -> bytes:
    return b"" if stream is None else await stream.read()


class Piped:
    """`python -m MODULE WORDS` with the interface of subprocess.Popen with three text pipes, for short outputs."""

    def __init__(self, module: str, *words: str) -> None:
        pipes = [os.pipe() for _ in range(3)]
        (in_, ours), (out, out_end), (err, err_end) = pipes
        self._begun = begin(module, *words, streams=(in_, out_end, err_end))
        for end in (in_, out_end, err_end):
            os.close(end)
        assert self._begun.pid is not None
        self.pid = self._begun.pid
        self.stdin, self.stdout, self.stderr = os.fdopen(ours, "w"), os.fdopen(out), os.fdopen(err)

    @property
    def returncode(self) -> int | None:
        """Return the exit code; None while it runs."""
        return self._begun.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal to the process, not to its group."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def wait(self, timeout: float) -> int:
        """Wait for the end of the process; return its exit code. Raise TimeoutError when it does not end."""
        self._begun.join(timeout)
        if self.returncode is None:
            raise TimeoutError(f"{self._begun} does not end")
        return self.returncode

    def communicate(self, timeout: float) -> tuple[str, str]:
        """Close standard input, wait for the end, and return the rest of both output streams."""
        with self.stdin, self.stdout, self.stderr:
            self.stdin.close()
            self.wait(timeout)
            return self.stdout.read(), self.stderr.read()


async def create_process(
    _python: str,
    _module: str,
    module: str,
    *words: str,
    stdin: int | IO[Any] | None = None,
    stdout: int | IO[Any] | None = None,
    stderr: int | IO[Any] | None = None,
    env: Mapping[str, str] | None = None,
    cwd: str | os.PathLike[str] = ".",
    start_new_session: bool = False,
) -> Warm:
    """Stand in for asyncio.create_subprocess_exec of `python -m MODULE WORDS`."""
    theirs, ours, close = [0, 1, 2], [-1, -1, -1], []
    for number, wanted in enumerate((stdin, stdout, stderr)):
        if wanted == asyncio.subprocess.PIPE:
            ends = os.pipe()
            theirs[number], ours[number] = ends if number == 0 else ends[::-1]
            close.append(theirs[number])
        elif wanted == asyncio.subprocess.DEVNULL:
            theirs[number] = os.open(os.devnull, os.O_RDWR)
            close.append(theirs[number])
        elif wanted == asyncio.subprocess.STDOUT:
            theirs[number] = theirs[1]
        elif wanted is not None:
            theirs[number] = wanted if isinstance(wanted, int) else wanted.fileno()
    environment = os.environ if env is None else env
    in_, out, err = theirs
    try:
        begun = begin(
            module, *words, streams=(in_, out, err), environment=environment, folder=cwd, new_session=start_new_session
        )
    finally:
        for end in close:
            os.close(end)
    process = Warm(begun)
    process.stdin = None if ours[0] < 0 else await _write_to(ours[0])
    process.stdout, process.stderr = [None if end < 0 else await _read_from(end) for end in ours[1:]]
    return process


async def _read_from(end: int) -> asyncio.StreamReader:
    """The pipe is closed once its last writer has closed it."""
    reader, pipe = asyncio.StreamReader(), os.fdopen(end, "rb")
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), pipe)
    return reader


async def _write_to(end: int) -> asyncio.StreamWriter:
    loop = asyncio.get_running_loop()
    transport, protocol = await loop.connect_write_pipe(asyncio.streams.FlowControlMixin, os.fdopen(end, "wb"))
    return asyncio.StreamWriter(transport, protocol, None, loop)


@asynccontextmanager
async def mock_process(
    config: Path, seed: int, ports: MockPorts, faults: Sequence[str] = (), hear: Callable[[FaultTold], None] = print
) -> AsyncIterator[asyncio.subprocess.Process]:
    """Start the mocks as companion.cli.demo.mock_process does."""
    async with contextlib.AsyncExitStack() as stack:
        with patch.object(asyncio, "create_subprocess_exec", create_process):
            process = await stack.enter_async_context(cold.mock_process(config, seed, ports, faults, hear))
        yield process
