"""The arms' real driver in simulated time: dynamixel-sdk's packets to the mock's servos without a pseudo-terminal.

The driver's thread is not begun; its cycles run when simulated time has come to them. Waiting for an answer takes bus
time, as on the wire, and a cycle that waited for long lets the next ones fall out. So whatever the mock's servos can
suffer is noticed by the code that flies, and the same seed gives the same flight.
"""

import heapq
from typing import TYPE_CHECKING

from companion.adapters.dynamixel.bus import DynamixelBus
from companion.adapters.dynamixel.chain import Chain
from companion.adapters.dynamixel.joint import joints_of
from companion.adapters.dynamixel.port import BusPort, PortGoneError
from companion.adapters.dynamixel.wire import Wire
from companion.adapters.dynamixel.worker import Worker
from companion.config_arms import ArmsConfig
from companion.ports import ArmError
from mock_autopilot.dynamixel_config import FaultKind
from mock_autopilot.dynamixel_packets import Parser
from mock_autopilot.truth import Truth

if TYPE_CHECKING:
    from tests.flights.simulated import Room

_INSTANT_S = 1e-6


class _BusClock:
    """ports.Clock: simulated time, and ahead of it while the bus waits for an answer."""

    def __init__(self, room: "Room") -> None:
        self._room, self._ahead_s = room, 0.0

    def now_s(self) -> float:
        return max(self._room.now_s(), self._ahead_s)

    def wait(self, for_s: float) -> None:
        self._ahead_s = self.now_s() + for_s


class _VirtualPort(BusPort):
    """What the driver writes goes to the mock's servos; what they say comes when its time has come."""

    def __init__(self, config: ArmsConfig, room: "Room", clock: _BusClock) -> None:
        super().__init__(config.port, config.baud)
        assert room.bench.world.servos is not None
        self._servos, self._clock = room.bench.world.servos, clock
        self._parser = Parser()
        self._coming: list[tuple[float, bytes]] = []

    def _check(self) -> None:
        if self._servos.holding(FaultKind.PORT_GONE):
            raise PortGoneError("the device is gone")

    def open(self) -> None:
        try:
            self.change_baud(self.baudrate)
        except PortGoneError as error:
            raise ArmError(f"no serial port {self.port_name}") from error
        self.is_open, self.is_using = True, False

    def change_baud(self, baud: int) -> None:
        self.baudrate, self.tx_time_per_byte = baud, 1000.0 / baud * 10.0
        self.clearPort()

    def clearPort(self) -> None:  # noqa: N802
        self._check()
        self._unread, self._taken = b"", 0
        self._arrived()

    def _arrived(self) -> bytes:
        come = b""
        while self._coming and self._coming[0][0] <= self._clock.now_s():
            come += heapq.heappop(self._coming)[1]
        return come

    def _receive(self, timeout_s: float) -> bytes:
        self._check()
        come = self._arrived()
        if come:
            return come
        next_s = self._coming[0][0] - self._clock.now_s() if self._coming else timeout_s
        self._clock.wait(min(next_s, timeout_s) + _INSTANT_S)
        return self._arrived()

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self._check()
        for heard in self._parser.feed(bytes(packet)):
            for said in self._servos.answer(heard, self.baudrate):
                heapq.heappush(self._coming, (self._clock.now_s() + said.late_s, said.data))
        return len(packet)

    def getCurrentTime(self) -> float:  # noqa: N802
        return self._clock.now_s() * 1e3


class _Worker(Worker):
    """Driven by simulated time instead of by its thread."""

    def __init__(self, config: ArmsConfig, room: "Room") -> None:
        clock = _BusClock(room)
        super().__init__(config, clock)
        self._port = _VirtualPort(config, room, clock)
        self._wire = Wire(self._port)
        self._chain = Chain(joints_of(config), self._wire, self._faults, config, clock)
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
