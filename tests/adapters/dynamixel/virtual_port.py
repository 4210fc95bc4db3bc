"""A serial port in simulated time: the driver's bytes go straight to the mock's servos, without a pseudo-terminal."""

import heapq
from typing import Protocol

from companion.adapters.dynamixel.port import BusPort, PortGoneError
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ArmError
from mock_autopilot.servos.config import FaultKind
from mock_autopilot.servos.instructions import Answer
from mock_autopilot.servos.packets import Packet, Parser

_INSTANT_S = 1e-6


class PortClock(Protocol):
    """Simulated time as the port needs it."""

    def now_s(self) -> float:
        """Return the present virtual time, s."""

    def wait(self, for_s: float) -> None:
        """Let time pass while the port waits for an answer."""


class Servos(Protocol):
    """End of the wire, such as `ServoRack`."""

    def answer(self, packet: Packet, baud: int | None = None) -> list[Answer]:
        """Return what the servos answer to these bytes, as `ServoRack.answer` does."""

    def active(self, kind: FaultKind) -> bool:
        """Return True while a fault of this kind acts on the servos."""


class VirtualPort(BusPort):
    """Port whose answers come when simulated time has come to them."""

    def __init__(self, config: ArmsConfig, servos: Servos, clock: PortClock) -> None:
        super().__init__(config.port, config.baud)
        self._servos, self._clock = servos, clock
        self._parser = Parser()
        self._coming: list[tuple[float, bytes]] = []

    def _check(self) -> None:
        if self._servos.active(FaultKind.PORT_GONE):
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
