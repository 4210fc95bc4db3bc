"""The arms' real driver in simulated time: dynamixel-sdk's packets to the mock's servos without a pseudo-terminal.

The driver's thread is not begun; its cycles run when simulated time has come to them. Waiting for an answer takes bus
time, as on the wire, and a cycle that waited for long lets the next ones fall out. So whatever the mock's servos can
suffer is noticed by the code that flies, and the same seed gives the same flight.
"""

from typing import TYPE_CHECKING

from companion.adapters.dynamixel.bus import DynamixelBus
from companion.adapters.dynamixel.bus_cycle import BusCycle
from companion.adapters.dynamixel.bus_thread import BusThread
from companion.adapters.dynamixel.joint import joints_of
from companion.adapters.dynamixel.wire import Wire
from companion.config.arms_config import ArmsConfig
from mock_autopilot.physics.truth import Truth
from tests.adapters.dynamixel.virtual_port import VirtualPort

if TYPE_CHECKING:
    from tests.flights.simulated import Room


class _BusClock:
    """interfaces.Clock: simulated time, and ahead of it while the bus waits for an answer."""

    def __init__(self, room: "Room") -> None:
        self._room, self._ahead_s = room, 0.0

    def now_s(self) -> float:
        return max(self._room.now_s(), self._ahead_s)

    def wait(self, for_s: float) -> None:
        self._ahead_s = self.now_s() + for_s


class _Worker(BusThread):
    """Driven by simulated time instead of by its thread."""

    def __init__(self, config: ArmsConfig, room: "Room") -> None:
        clock = _BusClock(room)
        super().__init__(config, clock)
        assert room.bench.world.servos is not None
        self._port = VirtualPort(config, room.bench.world.servos, clock)
        self._wire = Wire(self._port)
        self._bus_cycle = BusCycle(joints_of(config), self._wire, self._faults, config, clock)
        assert self._connect()
        self._period_s = 1.0 / config.rate_hz
        self._due_s = room.now_s() + self._period_s
        room.bench.world.observers.append(self._pass)

    def _pass(self, truth: Truth) -> None:
        if truth.time_s < self._due_s:
            return
        self._guarded_cycle()
        self._due_s = max(self._due_s + self._period_s, self._clock.now_s())


def simulated_bus(config: ArmsConfig, room: "Room") -> DynamixelBus:
    """Connected; every servo answers."""
    return DynamixelBus(_Worker(config, room))
