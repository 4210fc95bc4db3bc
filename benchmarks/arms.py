"""The arms' bus: how long a cycle of eight servos takes, and whether the 100 Hz tick beside it begins any later.

A tick is what the flight loop does with a frame, less estimator and flight phases: law, conversion, gate; with arms
the whole of their stage, both swinging, feed-forward on. Turns with the bus open and without it alternate, so both
see the same machine.
"""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import numpy as np
import psutil  # type: ignore[import-untyped]

from benchmarks.figures import Spread, spread
from benchmarks.flights import BenchError, first_line, python_process
from benchmarks.servo_end import RATE_HZ, STAMP
from benchmarks.steps import CYCLES, flying
from benchmarks.synthetic import motion
from companion.adapters.dynamixel.bus import DynamixelBus, open_dynamixel
from companion.adapters.dynamixel.bus_thread import THREAD_NAME
from companion.adapters.system.clock import MonotonicClock
from companion.arms.planning import plan
from companion.config.arm_files import motion_named
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.core.types import ArmStatus
from companion.flight.arm_step import ArmStep
from companion.supervisor.flight_state import FlightState, Phase

SETTLE_S = 0.3
LONGEST_S = 60.0
_HOVERING = FlightState(phase=Phase.HOLD, airborne=True)
_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])

Progress = Callable[[str], None]


@dataclass(frozen=True)
class ArmsCost:
    """Cost of the servo bus, and its effect on the tick."""

    cycle_ms: Spread
    """Goals out, state of all in."""
    rate_hz: float
    cpu_share: float
    """Share of one core that the bus thread takes."""
    bad_packets: int
    late_us: Spread
    """Time from the sending of a frame to the beginning of its tick, with the bus running."""
    late_without_us: Spread
    done_us: Spread
    """Time from the sending of a frame to the end of its tick, with the bus running."""
    done_without_us: Spread

    @property
    def late_ratio(self) -> float:
        """Median lateness with arms over that without."""
        return self.late_us.median / self.late_without_us.median


@dataclass
class _Turn:
    """Measurements of a flight with or without the bus."""

    late_s: list[float] = field(default_factory=list)
    done_s: list[float] = field(default_factory=list)
    cycles_s: list[float] = field(default_factory=list)
    lasted_s: float = 0.0
    cpu_s: float = 0.0
    cycles: int = 0
    bad_packets: int = 0


class _Ticking(asyncio.DatagramProtocol):
    """One tick for every datagram."""

    def __init__(self, config: CompanionConfig) -> None:
        self._fly = flying(motion((), 1.0 / RATE_HZ), config)
        self._count = 0
        self.turn = _Turn()
        self.bus: DynamixelBus | None = None
        self.stage: ArmStep | None = None
        self._last_cycle = 0

    def datagram_received(self, data: bytes, addr: object) -> None:  # noqa: ARG002
        """Take a datagram as a frame and run one tick."""
        (sent_s,) = STAMP.unpack(data)
        self.turn.late_s.append(time.monotonic() - sent_s)
        if self.stage is not None:
            self.stage.read(time.monotonic(), _HOVERING)
            self.stage.known_accel_w_mps2(_LEVEL)
        self._fly(self._count % CYCLES)
        self._count += 1
        if self.stage is not None:
            self.stage.tick(time.monotonic(), _HOVERING)
            self._note(self.stage.status)
        self.turn.done_s.append(time.monotonic() - sent_s)

    def _note(self, status: ArmStatus) -> None:
        if status.cycles != self._last_cycle:
            self._last_cycle = status.cycles
            self.turn.cycles_s.append(status.cycle_s)


async def measure_arms(turns: int, for_s: float, say: Progress) -> ArmsCost:
    """So many turns of `for_s` with the bus, and as many without; ArmError or BenchError when that fails."""
    loop, config = asyncio.get_running_loop(), CompanionConfig.model_validate({})
    transport, ticking = await loop.create_datagram_endpoint(lambda: _Ticking(config), local_addr=("127.0.0.1", 0))
    try:
        port = transport.get_extra_info("sockname")[1]
        async with python_process("benchmarks.servo_end", str(port)) as process:
            path = await first_line(process)
            without, beside = _Turn(), _Turn()
            for number in range(turns):
                say(f"turn {number + 1} of {turns}")
                await _take(ticking, without, for_s)
                async with _swinging(path, ticking):
                    await _take(ticking, beside, for_s)
    finally:
        transport.close()
    return _cost(beside, without)


async def _take(ticking: _Ticking, turn: _Turn, for_s: float) -> None:
    """Let the tick settle, then note."""
    await asyncio.sleep(SETTLE_S)
    begun_s, used_s, bus = time.monotonic(), _worker_cpu_s(), ticking.bus
    before = bus.status() if bus is not None else None
    ticking.turn = turn
    await asyncio.sleep(for_s)
    ticking.turn = _Turn()
    turn.lasted_s += time.monotonic() - begun_s
    turn.cpu_s += _worker_cpu_s() - used_s
    if bus is not None and before is not None:
        turn.cycles += bus.status().cycles - before.cycles
        turn.bad_packets += bus.status().bad_packets - before.bad_packets


@asynccontextmanager
async def _swinging(path: str, ticking: _Ticking) -> AsyncIterator[None]:
    """The bus open, torque on, goals with every tick."""
    arms, config = ArmsConfig(port=path), CompanionConfig()
    async with open_dynamixel(arms, MonotonicClock()) as bus:
        await bus.torque_on()
        stage = ArmStep(bus, arms, config.vehicle_model(), config.airframe(), 1.0 / RATE_HZ)
        ticking.bus, ticking.stage = bus, stage
        try:
            await asyncio.sleep(0.1)  # a few ticks, until the stage holds the joints
            _swing(stage, arms)
            yield
        finally:
            ticking.bus = ticking.stage = None
        faults = bus.status().faults
        if faults:
            raise BenchError(f"the arms failed: {faults[0].text}")


def _swing(stage: ArmStep, arms: ArmsConfig) -> None:
    held_rad = stage.held_rad
    if held_rad is None:
        raise BenchError(f"the arms do not hold still: they are {stage.state.phase} {stage.fault}")
    swing = motion_named("swing", LONGEST_S).trajectory(arms.model(), held_rad)
    stage.play(plan(arms.model(), swing, held_rad).trajectory, Phase.HOLD)


def _worker_cpu_s() -> float:
    workers = {thread.native_id for thread in threading.enumerate() if thread.name == THREAD_NAME}
    times = (thread for thread in psutil.Process().threads() if thread.id in workers)
    return float(sum(thread.user_time + thread.system_time for thread in times))


def _cost(beside: _Turn, without: _Turn) -> ArmsCost:
    return ArmsCost(
        cycle_ms=spread([1e3 * value for value in beside.cycles_s]),
        rate_hz=beside.cycles / beside.lasted_s,
        cpu_share=beside.cpu_s / beside.lasted_s,
        bad_packets=beside.bad_packets,
        late_us=_us(beside.late_s),
        late_without_us=_us(without.late_s),
        done_us=_us(beside.done_s),
        done_without_us=_us(without.done_s),
    )


def _us(values_s: list[float]) -> Spread:
    return spread([1e6 * value for value in values_s])
