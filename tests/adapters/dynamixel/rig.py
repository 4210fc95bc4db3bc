"""The mock servo bus on a pty and the driver at its other end; simulated time follows the wall clock as they talk."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from companion.adapters.dynamixel.bus import DynamixelBus, open_dynamixel
from companion.adapters.system.clock import MonotonicClock
from companion.arms.model import JOINT_NAMES
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ArmError
from companion.core.types import ArmFault, ArmFaultKind, Array
from mock_autopilot.servos.bus import ServoBus
from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind, ServoConfig
from mock_autopilot.servos.packets import Instruction, Packet
from mock_autopilot.servos.servo import Servo

CLOCK = MonotonicClock()
PATIENCE_S = 10.0
_STEP_S = 0.002
_ZERO_RAD = np.array([np.pi] * 3 + [np.radians(150.0)] + [np.pi] * 3 + [np.radians(150.0)])
"""Zero angles of the default servos."""


@dataclass
class BusRig:
    """The mock with ears: what came over the wire, and how far the joints ever were from where they began."""

    config: DynamixelConfig
    packets: list[Packet] = field(default_factory=list)
    strayed_rad: Array = field(default_factory=lambda: np.zeros(8))
    fastest_radps: Array = field(default_factory=lambda: np.zeros(8))
    load_nm: tuple[float, ...] = (0.0,) * 8
    _time_s: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        self.bus = ServoBus(self.config, self.catch_up)
        self.began_rad = self.bus.servos.positions_rad
        answer = self.bus.servos.answer

        def heard(packet: Packet, baud: int | None = None) -> Any:
            self.packets.append(packet)
            return answer(packet, baud)

        self.bus.servos.answer = heard  # type: ignore[method-assign]

    def catch_up(self) -> None:
        """Bring simulated time to the present."""
        now_s = time.monotonic()
        while self._time_s < now_s:
            self._time_s += _STEP_S
            self.bus.servos.step(_STEP_S, self.load_nm)
        self.strayed_rad = np.maximum(self.strayed_rad, abs(self.bus.servos.positions_rad - self.began_rad))
        self.fastest_radps = np.maximum(self.fastest_radps, np.abs(self.bus.servos.motion()[1]))

    async def keep_up(self) -> None:
        """Let time pass also while nobody asks, or the first answer afterwards is a late one."""
        while True:
            await asyncio.sleep(0.005)
            self.catch_up()

    @property
    def joints_rad(self) -> Array:
        """True joint angles of the default assembly."""
        return np.asarray(self.bus.servos.positions_rad - _ZERO_RAD)

    def servo(self, servo_id: int) -> Servo:
        """Return a servo, to inspect its registers."""
        return self.bus.servos.servo(servo_id)

    def fault(self, kind: FaultKind, servo_id: int | None = None, **more: float) -> None:
        """Inject a fault into the mock's servos that begins now."""
        self.bus.inject(Fault.model_validate({"kind": kind, "id": servo_id} | more))

    def goals_sent(self, servo_id: int) -> list[int]:
        """Return the goal positions, counts, that sync writes carried for a servo, in order."""
        return [counts[servo_id] for counts in map(goals_of, self.packets) if servo_id in counts]


def goals_of(packet: Packet) -> dict[int, int]:
    """Return the goals, counts by ID, in a sync write of Goal Position; decoded without the driver."""
    if packet.code != Instruction.SYNC_WRITE:
        return {}
    head, size = (b"\x74\x00\x04\x00", 4) if packet.protocol == 2 else (b"\x1e\x02", 2)
    assert packet.params.startswith(head), packet.params.hex(" ")
    rest = packet.params[len(head) :]
    pieces = [rest[at : at + 1 + size] for at in range(0, len(rest), 1 + size)]
    return {piece[0]: int.from_bytes(piece[1:], "little", signed=True) for piece in pieces}


@asynccontextmanager
async def mock_bus(**settings: Any) -> AsyncIterator[BusRig]:
    """Run the mock's servos alone, on a pty."""
    rig = BusRig(DynamixelConfig.model_validate(settings))
    rig.bus.open()
    keeping_up = asyncio.create_task(rig.keep_up())
    try:
        yield rig
    finally:
        keeping_up.cancel()
        await asyncio.gather(keeping_up, return_exceptions=True)
        rig.bus.close()


@asynccontextmanager
async def connected(rig: BusRig, **settings: Any) -> AsyncIterator[DynamixelBus]:
    """Connect the driver to the mock's port."""
    async with open_dynamixel(ArmsConfig.model_validate({"port": rig.bus.path} | settings), CLOCK) as bus:
        yield bus


def servos(**changes: dict[str, Any]) -> tuple[ServoConfig, ...]:
    """Return the mock's default servos with changes: `servos(id2={"firmware": 30})`."""
    return tuple(
        ServoConfig.model_validate(servo.model_dump() | changes.get(f"id{servo.id}", {}))
        for servo in DynamixelConfig().servos
    )


async def refusal(rig: BusRig, **settings: Any) -> str:
    """Return the error with which connecting fails."""
    with pytest.raises(ArmError) as caught:
        async with connected(rig, **settings):
            pass
    return str(caught.value)


async def until(holds: Callable[[], object]) -> None:
    """Wait for something that has to come; fails when it does not."""
    async with asyncio.timeout(PATIENCE_S):
        while not holds():  # noqa: ASYNC110  # nobody signals: it is a status that is looked at
            await asyncio.sleep(0.002)


async def cycles(bus: DynamixelBus, count: int) -> None:
    """Let the bus complete so many more cycles."""
    goal = bus.status().cycles + count
    await until(lambda: bus.status().cycles >= goal)


async def fault_of(bus: DynamixelBus, joint: str) -> ArmFault:
    """Wait for a fault of this joint and return the first."""
    await until(lambda: any(fault.joint == joint for fault in bus.status().faults))
    return next(fault for fault in bus.status().faults if fault.joint == joint)


def kinds(bus: DynamixelBus) -> set[tuple[str, ArmFaultKind]]:
    """Return joint and kind of every latched fault."""
    return {(fault.joint, fault.kind) for fault in bus.status().faults}


def place(joint: str) -> int:
    """Return the joint's index in a joint vector."""
    return JOINT_NAMES.index(joint)
