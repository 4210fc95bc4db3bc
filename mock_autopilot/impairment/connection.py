"""Both directions of a TCP connection, impaired inside of the server that has accepted it."""

import time
from collections.abc import Callable

from mock_autopilot.impairment.delivery import TimedDelivery
from mock_autopilot.impairment.sentences import Directions
from mock_autopilot.impairment.stream import ImpairedStream


class ImpairedConnection:
    """A connection on which bytes arrive late: `received` calls `take` later, `send` calls `write` later."""

    def __init__(
        self, link: Directions, seed: int, take: Callable[[bytes], None], write: Callable[[bytes], None]
    ) -> None:
        begin_s = time.monotonic()
        self._up, self._down = ImpairedStream(link.up, 2 * seed, seed), ImpairedStream(link.down, 2 * seed + 1, seed)
        self._upward, self._downward = TimedDelivery(self._up, take, begin_s), TimedDelivery(self._down, write, begin_s)
        self.set(link)

    @property
    def waiting_bytes(self) -> int:
        """Return the number of bytes that are on their way to the client."""
        return self._down.waiting_bytes

    def set(self, link: Directions) -> None:
        """Change the impairment."""
        for stream, delivery, there, back in (
            (self._up, self._upward, link.up, link.down),
            (self._down, self._downward, link.down, link.up),
        ):
            stream.set(there, back)
            delivery.look()

    def received(self, data: bytes) -> None:
        """Take bytes from the client's end of the link."""
        self._up.put(self._upward.now_s, data)
        self._upward.look()

    def send(self, data: bytes) -> None:
        """Take bytes for the client."""
        self._down.put(self._downward.now_s, data)
        self._downward.look()

    def close(self) -> None:
        """Deliver nothing more."""
        self._upward.close()
        self._downward.close()
