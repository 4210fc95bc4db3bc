"""The wire between two namespaces: IP packets over the impairment tool's core, with a count of their bytes."""

import asyncio
import contextlib
import os
import time

from mock_autopilot.impairment import ImpairedDirection, Impairment
from mock_autopilot.impairment.delivery import TimedDelivery

_MOST_BYTES = 65_536
_IPV4 = 4


class Wire:
    """Passes the packets of two file descriptors on; `set` impairs both directions."""

    def __init__(self, ground: int, vehicle: int, seed: int) -> None:
        self._ends = ground, vehicle
        clean = Impairment()
        begin_s = time.monotonic()
        self.up: ImpairedDirection[bytes] = ImpairedDirection(clean, 2 * seed, seed)
        self.down: ImpairedDirection[bytes] = ImpairedDirection(clean, 2 * seed + 1, seed)
        self._deliveries = (
            TimedDelivery(self.up, lambda packet: _write(vehicle, packet), begin_s),
            TimedDelivery(self.down, lambda packet: _write(ground, packet), begin_s),
        )
        loop = asyncio.get_running_loop()
        for end, direction, delivery in zip(self._ends, (self.up, self.down), self._deliveries, strict=True):
            loop.add_reader(end, self._pass_on, end, direction, delivery)

    def set(self, impairment: Impairment) -> None:
        """Impair both directions from now on."""
        for delivery in self._deliveries:
            delivery.set(impairment)

    @property
    def sent_bytes(self) -> tuple[int, int]:
        """Return the bytes of all packets up and down so far."""
        return self.up.counts.sent_bytes, self.down.counts.sent_bytes

    def close(self) -> None:
        """Pass nothing more on."""
        for delivery, end in zip(self._deliveries, self._ends, strict=True):
            delivery.close()
            asyncio.get_running_loop().remove_reader(end)
            os.close(end)

    def _pass_on(self, end: int, direction: ImpairedDirection[bytes], delivery: TimedDelivery[bytes]) -> None:
        with contextlib.suppress(BlockingIOError):
            while packet := os.read(end, _MOST_BYTES):
                if packet[0] >> 4 == _IPV4:  # IPv6 looks for its neighbours by itself
                    direction.put(delivery.now_s, packet)
        delivery.look()


def _write(end: int, packet: bytes) -> None:
    with contextlib.suppress(OSError):  # the other end has gone
        os.write(end, packet)
