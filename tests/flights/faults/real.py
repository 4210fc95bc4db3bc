"""Flies a row in real time: the real MAVSDK and qtm-rt over sockets, the mock in a process of its own."""

import asyncio
import json
import signal
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass

import uvloop

from companion.cli.demo.mock_process import MockPorts
from companion.config.companion_config import CompanionConfig, load_config
from companion.config.controller_config import load_controller
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import AutopilotError, CompanionError
from companion.service.local_operator import LocalOperator, open_local_operator
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import FlightState, Phase
from tests import warm
from tests.broker import broker
from tests.flights.command import ROOT
from tests.flights.faults.judge import Result, judged
from tests.flights.faults.rows import Row
from tests.flights.faults.table_real import BLOCK, KILL, NO_BROKER, REAL, REFUSED, STOP, TWICE
from tests.flights.faults.watch import Flown, Told
from tests.flights.simulated import BRISK
from tests.flights.test_dead_man import companion, modes_after
from tests.mavlink_relay import Relay
from tests.watchdog_timer import NoWatchdogTimer

HEIGHT_M = 0.6
_PATIENCE_S, _LONGEST_S = 20.0, 120.0
"""Time that a landing may take, and a whole flight."""
_PILOT_FLIES_S = 1.5
_NOTHING_S = 3.0
"""If nothing has come of the fault after so long, the operator lands."""
_OVER = frozenset({Phase.DISARMED, Phase.TERMINATED})


class Mock:
    """tests.flights.faults.watched_mock in a process of its own."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    def tell(self, line: str) -> None:
        """A fault, or "begin"."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n".encode())

    async def begin(self) -> None:
        """Tell that the fault begins; return when the mock has noted the time."""
        assert self._process.stdout is not None
        self.tell("begin")
        await self._process.stdout.readline()

    async def flown(self) -> Flown:
        """Ends it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        out, _ = await self._process.communicate()
        return Flown(**json.loads(out.decode().splitlines()[-1]))


@asynccontextmanager
async def mock(ports: MockPorts) -> AsyncIterator[Mock]:
    """Ready, with its ports open."""
    process = await warm.create_process(
        sys.executable, "-m", "tests.flights.faults.watched_mock",
        str(ports.client), str(ports.autopilot), str(ports.qualisys),
        cwd=ROOT, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        async with asyncio.timeout(_PATIENCE_S):
            await process.stdout.readline()
        yield Mock(process)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


def configured(relay: Relay) -> CompanionConfig:
    """The demo's, without arms, briskly flown."""
    config = load_config(ROOT / "config" / "demo.toml")
    return config.model_copy(
        update={
            "px4": config.px4.model_copy(update={"url": relay.url}),
            "mocap": config.mocap.model_copy(update={"port": relay.ports.qualisys}),
            "arms": None,
            "flight": BRISK,
        }
    )


def fly_real_named(name: str) -> Result:
    """For a worker process."""
    row = next(row for row in REAL if row.name == name)
    return uvloop.run(_fly(row))


async def _fly(row: Row) -> Result:
    told = Told()
    [how] = row.make
    assert isinstance(how, str)
    with Relay() as relay:
        async with asyncio.timeout(_LONGEST_S), mock(relay.ports) as autopilot:
            planned_s = await _WAYS.get(how, _in_the_air)(how, Scene(relay, autopilot, told))
            flown = await autopilot.flown()
    return judged(row, flown, told, planned_s)


@dataclass(frozen=True)
class Scene:
    """Surroundings of a flight: the relay, the mock, and what the companion tells."""

    relay: Relay
    mock: Mock
    told: Told

    @asynccontextmanager
    async def service(self, **changes: object) -> AsyncIterator[LocalOperator]:
        """Open the real one, in this process; no timer watches it, which would end the tests."""
        config = configured(self.relay).model_copy(update=changes)
        law = load_controller("etnn", config.vehicle_model(), 0.01)
        async with open_local_operator(config, law, self.told, NoWatchdogTimer()) as operator:
            yield operator


async def _in_the_air(how: str, scene: Scene) -> float | None:
    """Hover, break it, and wait for what comes of it; when the operator had to land, if he had to."""
    async with scene.service() as operator:
        await hover(operator)
        scene.mock.tell(how)
        return await _to_the_end(operator)


async def hover(operator: LocalOperator) -> None:
    """Arm and climb."""
    await operator.do("arm")
    await operator.do("takeoff", height_m=HEIGHT_M)


async def _to_the_end(operator: LocalOperator) -> float | None:
    planned_s: float | None = None
    service, begun_s = operator.service, time.monotonic()
    while service.phase not in _OVER and time.monotonic() - begun_s < _PATIENCE_S:
        await asyncio.sleep(0.02)
        if service.phase is Phase.HOLD and time.monotonic() - begun_s > _NOTHING_S:
            planned_s = time.monotonic()
            await operator.do("land")
        if service.loop.flight.cause is Fault.MODE_CHANGED:
            await asyncio.sleep(_PILOT_FLIES_S)
            with suppress(CompanionError):  # the verdict is "still in the air"
                await operator.do("resume")
                await operator.do("land")
                continue
            break
    await asyncio.sleep(0.2)
    return planned_s


async def _refused(how: str, scene: Scene) -> None:
    async with scene.service() as operator:
        await operator.service.ready()
        scene.mock.tell(how)
        with suppress(CompanionError):
            await operator.do("arm")
        await asyncio.sleep(0.2)


async def _twice(_: str, scene: Scene) -> None:
    async with scene.service() as operator:
        await operator.service.ready()
        await scene.mock.begin()
        try:
            async with scene.service():
                pass
        except AutopilotError as error:
            stopped = FlightState(
                phase=Phase.DISARMED, level=FailsafeAction.DISARM, cause=Fault.SERVICE_TWICE, reason=str(error)
            )
            scene.told.take(time.monotonic(), stopped, frozenset())


async def _without_broker(_: str, scene: Scene) -> float | None:
    with broker() as server:
        async with scene.service(operator=OperatorConfig(port=server.port, embedded=True)) as operator:
            await hover(operator)
            scene.mock.tell("begin")
            await asyncio.to_thread(server.stop)
            return await _to_the_end(operator)


async def _stopped(how: str, scene: Scene) -> None:
    async with companion(scene.relay) as flying:
        flying.tell("open")
        await flying.says("hovering")
        since_s = time.monotonic()
        scene.mock.tell("begin")
        if how == BLOCK:
            flying.tell("block")
        else:
            flying.process.send_signal(signal.SIGSTOP if how == STOP else signal.SIGKILL)
        async with asyncio.timeout(_PATIENCE_S):
            await flying.process.wait()
            while not (beats := modes_after(scene.relay, since_s)) or beats[-1][1]:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.05)
        if flying.process.returncode == -signal.SIGKILL:
            gone = FlightState(
                phase=Phase.HANDED_OVER, level=FailsafeAction.RELEASE, cause=Fault.LOOP_STOPPED, reason="SIGKILL"
            )
            scene.told.take(time.monotonic(), gone, frozenset())


_WAYS: dict[str, Callable[[str, Scene], Awaitable[float | None]]] = {
    REFUSED: _refused,
    TWICE: _twice,
    NO_BROKER: _without_broker,
    BLOCK: _stopped,
    STOP: _stopped,
    KILL: _stopped,
}
