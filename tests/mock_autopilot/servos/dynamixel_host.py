"""The host's end in the tests of the servo bus: the real SDK, one worker thread, on a bus in this process."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import dynamixel_sdk as dxl

from mock_autopilot.servos.config import DynamixelConfig
from tests.mock_autopilot.servos.standalone_bus import StandaloneBus

Result = TypeVar("Result")

XM_IDS, AX_IDS = (1, 2, 3, 5, 6, 7), (4, 8)
"""IDs of the default bus."""
TORQUE, AX_TORQUE = 64, 24

SHIPPED_LATENCY_MS = 16
"""The SDK waits for an answer as long as its bytes take, and twice this, and 2 ms."""

OK, NO_ANSWER, BROKEN = dxl.COMM_SUCCESS, dxl.COMM_RX_TIMEOUT, dxl.COMM_RX_CORRUPT


@dataclass(frozen=True)
class Host:
    """An open port and the packet handlers of both protocols."""

    port: Any
    one: Any
    two: Any


@contextmanager
def opened(path: str, baud: int = 1_000_000) -> Iterator[Host]:
    """The SDK on that port."""
    port = dxl.PortHandler(path)
    port.setBaudRate(baud)
    # The SDK waits by reading over and over without a pause, and so keeps the interpreter, and with it the bus in the
    # other thread, from running; with a little patience in the reads it sleeps instead.
    port.ser.timeout = 0.002
    before_ms = dxl.port_handler.LATENCY_TIMER  # of the whole process: a driver that was imported may have changed it
    dxl.port_handler.LATENCY_TIMER = SHIPPED_LATENCY_MS
    try:
        yield Host(port, dxl.PacketHandler(1.0), dxl.PacketHandler(2.0))
    finally:
        dxl.port_handler.LATENCY_TIMER = before_ms
        port.closePort()


@asynccontextmanager
async def powered(config: DynamixelConfig | None = None) -> AsyncIterator[StandaloneBus]:
    """A bus whose servos live by the wall clock."""
    async with StandaloneBus(config) as bus:
        yield bus


async def talk(bus: StandaloneBus, what: Callable[[Host], Result], baud: int = 1_000_000) -> Result:
    """Call the SDK in a worker thread, while the bus runs on this loop."""

    def work() -> Result:
        with opened(bus.path, baud) as host:
            return what(host)

    return await asyncio.to_thread(work)


async def within(bus: StandaloneBus, what: Callable[[Host], bool], for_s: float = 10.0) -> bool:
    """Ask the bus again until the condition holds; return False after `for_s`."""

    def patiently(host: Host) -> bool:
        end_s = time.monotonic() + for_s
        while not what(host):
            if time.monotonic() > end_s:
                return False
            time.sleep(0.02)
        return True

    return await talk(bus, patiently)


def torque_on(host: Host) -> None:
    """Switch the torque of every default servo on."""
    for servo in XM_IDS:
        assert host.two.write1ByteTxRx(host.port, servo, TORQUE, 1) == (OK, 0)
    for servo in AX_IDS:
        assert host.one.write1ByteTxRx(host.port, servo, AX_TORQUE, 1) == (OK, 0)
