"""The mocks as a child process for the duration of a demo."""

import asyncio
import re
import socket
import sys
import tempfile
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from companion.adapters.system import child_process
from companion.core.interfaces import CompanionError

_START_S = 20.0
_STOP_S = 5.0
_TOLD = re.compile(r"fault (?P<turn>begins|ends|never began)(?: at (?P<at_s>[\d.]+) s \(monotonic\))?: (?P<what>.*)")
_COLLISION = re.compile(r"collision at (?P<at_s>[\d.]+) s \(monotonic\): (?P<who>.*)")
COLLISION = "collision"
"""Turn of the notice that two vehicles have met."""
_WHEN = re.compile(r" (?:at [\d.e+]+ s|(?:on the ground|armed|in the air|landing)(?: after [\d.e+]+ s)?)(?= for |$)")


class MockError(CompanionError):
    """Error of mocks that did not start, with their message."""


@dataclass(frozen=True)
class FaultTold:
    """Notice of the mocks about an injected fault."""

    turn: str
    """begins, ends, never began; or collision, of the vehicles in `sentence`."""
    sentence: str
    """The fault; without its time when that has come."""
    at_s: float
    """Monotonic time; 0 for a fault that never began."""


def _fault_told(line: str) -> FaultTold | None:
    met = _COLLISION.fullmatch(line)
    if met is not None:
        return FaultTold(COLLISION, met["who"], float(met["at_s"]))
    said = _TOLD.fullmatch(line)
    if said is None:
        return None
    sentence = said["what"] if said["at_s"] is None else _WHEN.sub("", said["what"])
    return FaultTold(said["turn"], sentence, float(said["at_s"] or 0.0))


def _unheard(_: FaultTold) -> None:
    """Ignore a notice about a fault."""


@dataclass(frozen=True)
class MockPorts:
    """Ports of the mocks; None leaves one to their configuration."""

    client: int | None = None
    autopilot: int | None = None
    qualisys: int | None = None
    servo_link: str | None = None
    """Path of the servo bus's device link."""
    vehicles: int = 1
    """Vehicles in the room; the ports are the first one's."""

    def arguments(self) -> list[str]:
        """Return the arguments for the mocks' command line."""
        named = (
            ("--port", self.client),
            ("--listen", self.autopilot),
            ("--qualisys-port", self.qualisys),
            ("--servo-link", self.servo_link),
            ("--vehicles", self.vehicles if self.vehicles > 1 else None),
        )
        return [text for name, value in named if value is not None for text in (name, str(value))]


def free_ports() -> MockPorts:
    """Return ports that are free at this moment, so that several demos can run at the same time."""
    udp = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    tcp = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        for end in (*udp, tcp):
            end.bind(("127.0.0.1", 0))
        client, autopilot, qualisys = (end.getsockname()[1] for end in (*udp, tcp))
        link = Path(tempfile.gettempdir()) / f"dauam-servo-bus-{client}"
        return MockPorts(client, autopilot, qualisys, str(link))
    finally:
        for end in (*udp, tcp):
            end.close()


def free_udp_ports(count: int) -> list[int]:
    """Return UDP ports of this computer that are free at this moment."""
    ends = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    try:
        for end in ends:
            end.bind(("127.0.0.1", 0))
        return [int(end.getsockname()[1]) for end in ends]
    finally:
        for end in ends:
            end.close()


def is_free_tcp_port(port: int) -> bool:
    """Return whether a program could listen on this port of the loopback interface now."""
    with socket.socket() as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            end.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def free_tcp_port() -> int:
    """Return a TCP port of this computer that is free at this moment."""
    with socket.socket() as end:
        end.bind(("127.0.0.1", 0))
        return int(end.getsockname()[1])


def usual_tcp_port(port: int, free: bool) -> int:
    """Return this TCP port; another one that is free where it is taken, or where `free` asks for one."""
    return free_tcp_port() if free or not is_free_tcp_port(port) else port


@asynccontextmanager
async def mock_process(
    config: Path,
    seed: int,
    ports: MockPorts,
    faults: Sequence[str] = (),
    hear: Callable[[FaultTold], None] = _unheard,
) -> AsyncIterator[asyncio.subprocess.Process]:
    """Start the mocks, wait until they are ready, stop them at the end; MockError with what they said.

    `faults` are sentences, see docs/faults.md; `hear` is called when one begins, ends, or never began.
    """
    command = [sys.executable, "-m", "mock_autopilot", "--config", str(config), "--seed", str(seed)]
    process = await asyncio.create_subprocess_exec(
        *command,
        "--exit-with-stdin",
        *ports.arguments(),
        *(f"--fault={sentence}" for sentence in faults),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,  # Ctrl-C must reach only the companion, which still has to land
    )
    listening: list[asyncio.Task[None]] = []
    try:
        await _ready(process)
        listening = [
            asyncio.create_task(_listen(process.stdout, hear), name="companion.mocks_say"),
            asyncio.create_task(_listen(process.stderr, _unheard), name="companion.mocks_complain"),
        ]
        yield process
    finally:
        await child_process.end(process, _STOP_S)
        await asyncio.gather(*listening)


async def _listen(stream: asyncio.StreamReader | None, hear: Callable[[FaultTold], None]) -> None:
    """Read to the end: a full pipe would stop the mocks."""
    while stream is not None and (line := await stream.readline()):
        told = _fault_told(line.decode(errors="replace").strip())
        if told is not None:
            hear(told)


async def _ready(process: asyncio.subprocess.Process) -> None:
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        async with asyncio.timeout(_START_S):
            line = await process.stdout.readline()
    except TimeoutError as error:
        raise MockError(f"the mocks were not ready within {_START_S:g} s") from error
    if not line:
        said = (await process.stderr.read()).decode(errors="replace").strip()
        raise MockError(said.removeprefix("mock autopilot: ") or "the mocks ended without a word")
