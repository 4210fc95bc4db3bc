"""Flights of the real service against the mocks: how long from a frame to its setpoint, and what the process takes."""

import asyncio
import json
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

import psutil  # type: ignore[import-untyped]

from benchmarks.figures import Answers, Spread, match, spread, within
from benchmarks.peer import LOOPBACK, RelayEnd, Stamps, relay_end, simulated_room
from benchmarks.subject import Task
from companion.cli.demo.mock_process import MockPorts, free_ports
from companion.config.companion_config import CompanionConfig
from companion.config.locations import default_config_path
from companion.core.interfaces import CompanionError
from mock_autopilot.config import MockConfig
from mock_autopilot.world import World

SETTLE_S = 0.5
_START_S = 60.0
_STOP_S = 20.0

Progress = Callable[[str], None]


class BenchError(CompanionError):
    """A flight of the bench came to nothing."""


@dataclass(frozen=True)
class FlightPlan:
    """One flight to be measured."""

    rate_hz: float
    every_cycle: bool
    with_relay: bool
    for_s: float


@dataclass(frozen=True)
class Latency:
    """Latency from a frame leaving motion capture to the setpoint's arrival at the autopilot, us."""

    rate_hz: float
    service_us: Spread
    relay_us: Spread
    arrival_us: Spread
    """Part of it until the service has the frame."""
    inside_us: Spread
    """Part of it from then until MAVSDK has sent the setpoint."""
    unanswered: int

    @property
    def ratio(self) -> float:
        """Median of the service over median of the relay."""
        return self.service_us.median / self.relay_us.median


@dataclass(frozen=True)
class Footprint:
    """Resources that the service's process uses while it flies."""

    rate_hz: float
    cpu_share: float
    """Share of one core."""
    memory_mb: float
    setpoints_per_s: float


@dataclass(frozen=True)
class _Measured:
    """Everything noted in one flight, all times in s, monotonic."""

    service: Stamps
    relay: Stamps | None
    inside_s: list[tuple[float, float]]
    start_s: float
    end_s: float
    cpu_s: float
    memory_bytes: int


async def measure_latency(rate_hz: float, for_s: float, say: Progress) -> Latency:
    """Hover under a law that sends in every cycle, with the relay beside it."""
    flown = await _fly(FlightPlan(rate_hz, True, True, for_s), say)
    assert flown.relay is not None
    frames_s = within(flown.service.frames_s, flown.start_s, flown.end_s)
    service = match(frames_s, flown.service.setpoints_s)
    relay = match(within(flown.relay.frames_s, flown.start_s, flown.end_s), flown.relay.setpoints_s)
    inside = [(got, left) for got, left in flown.inside_s if flown.start_s <= got < flown.end_s]
    arrival = match(frames_s, [got for got, _ in inside])
    return Latency(
        rate_hz, _us(service), _us(relay), _us(arrival), spread([1e6 * (b - a) for a, b in inside]), service.unanswered
    )


async def measure_footprint(rate_hz: float, for_s: float, say: Progress) -> Footprint:
    """Hover under the law as it flies, nothing else beside it."""
    flown = await _fly(FlightPlan(rate_hz, False, False, for_s), say)
    lasted_s = flown.end_s - flown.start_s
    sent = within(flown.service.setpoints_s, flown.start_s, flown.end_s)
    return Footprint(rate_hz, flown.cpu_s / lasted_s, flown.memory_bytes / 2**20, len(sent) / lasted_s)


def _us(answers: Answers) -> Spread:
    return spread([1e6 * delay_s for delay_s in answers.delays_s])


async def _fly(plan: FlightPlan, say: Progress) -> _Measured:
    ports, service = free_ports(), Stamps()
    async with _relay(plan) as relay, simulated_room(mock_config(plan, ports), service, relay):
        say("taking off")
        async with hovering("benchmarks.subject", task_of(plan, ports)) as process:
            await asyncio.sleep(SETTLE_S)
            say(f"hovering for {plan.for_s:g} s")
            program = psutil.Process(process.pid)
            start_s, used_s = time.monotonic(), _cpu_s(program)
            await asyncio.sleep(plan.for_s)
            end_s, used_s, memory = time.monotonic(), _cpu_s(program) - used_s, program.memory_info().rss
            said = await end(process)
    inside = [(float(got), float(left)) for got, left in json.loads(said)]
    return _Measured(service, relay.stamps if relay else None, inside, start_s, end_s, used_s, memory)


def _cpu_s(program: psutil.Process) -> float:
    times = program.cpu_times()
    return float(times.user + times.system)


def task_of(plan: FlightPlan, ports: MockPorts) -> Task:
    """The defaults; low and quick, because only the hover counts, and on a computer that nobody has prepared."""
    data = CompanionConfig.model_validate({}).model_dump()
    data["preflight"] |= {"realtime": False, "by_hand_within_h": 0.0, "mocap_hz": 50.0, "delay_apart_s": 0.05}
    data["control"]["rate_hz"] = plan.rate_hz
    data["px4"]["url"] = f"udpin://{LOOPBACK}:{ports.client}"
    data["mocap"] |= {"port": ports.qualisys, "transport": "udp"}
    data["flight"] |= {"takeoff_height_m": 0.5, "spool_up_s": 0.5, "climb_speed_mps": 1.0}
    return Task(config=CompanionConfig.model_validate(data), controller="practical", every_cycle=plan.every_cycle)


def mock_config(plan: FlightPlan, ports: MockPorts) -> MockConfig:
    """config/mock.toml on these ports, with motion capture at the plan's rate."""
    data = MockConfig.load(default_config_path("mock.toml")).model_dump()
    data["mavlink"] |= {"local_port": ports.autopilot, "remote_port": ports.client}
    data["qualisys"] |= {"port": ports.qualisys, "rate_hz": plan.rate_hz}
    data["arms"]["bus"]["link"] = ports.servo_link
    return MockConfig.from_dict(data)


@asynccontextmanager
async def hovering(module: str, task: Task) -> AsyncIterator[asyncio.subprocess.Process]:
    """The service in its own process, hovering."""
    async with python_process(module, task.model_dump_json()) as process:
        if await first_line(process) != "flying":
            assert process.stderr is not None
            raise BenchError(f"the service did not fly: {(await process.stderr.read()).decode()[-2000:]}")
        yield process


@asynccontextmanager
async def _relay(plan: FlightPlan) -> AsyncIterator[RelayEnd | None]:
    if not plan.with_relay:
        yield None
        return
    async with relay_end(World()) as end, python_process("benchmarks.relay", str(end.port)) as process:
        end.address = (LOOPBACK, int(await first_line(process)))
        yield end


@asynccontextmanager
async def python_process(module: str, *arguments: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """A module as a process of its own, killed at the end if it has not ended."""
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", module, *arguments, stdin=pipe, stdout=pipe, stderr=pipe
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def end(process: asyncio.subprocess.Process) -> bytes:
    """Close its standard input; what it still has to say."""
    assert process.stdin is not None
    process.stdin.close()
    try:
        async with asyncio.timeout(_STOP_S):
            said, _ = await process.communicate()
    except TimeoutError as error:
        raise BenchError(f"the service did not end within {_STOP_S:g} s") from error
    return said


async def first_line(process: asyncio.subprocess.Process) -> str:
    """The next line that it says; BenchError when none comes."""
    assert process.stdout is not None
    try:
        async with asyncio.timeout(_START_S):
            return (await process.stdout.readline()).decode().strip()
    except TimeoutError as error:
        raise BenchError(f"a process of the bench was not ready within {_START_S:g} s") from error
