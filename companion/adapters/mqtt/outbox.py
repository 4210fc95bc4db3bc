"""What waits to be said over a broker that may be gone."""

import asyncio
import logging
from collections import deque
from dataclasses import dataclass

from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

LOG = logging.getLogger(__name__)

_TRIES = 3
"""What breaks the connection every time is not to keep everything else from being said."""


@dataclass
class Letter:
    """One message at QoS 1."""

    topic: str
    payload: bytes
    correlation: bytes | None = None
    tries: int = 0

    def properties(self) -> Properties:
        """For MQTT 5."""
        said = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        if self.correlation is not None:
            said.CorrelationData = self.correlation
        return said


class Outbox:
    """First in, first out; of more than `most` the oldest is dropped. Never waits but in `next`."""

    def __init__(self, most: int) -> None:
        self._most, self._letters, self._there = most, deque[Letter](), asyncio.Event()

    def __len__(self) -> int:
        return len(self._letters)

    def put(self, letter: Letter) -> None:
        """To be said when its turn comes."""
        if len(self._letters) >= self._most:
            self._letters.popleft()
        self._letters.append(letter)
        self._there.set()

    def put_back(self, letter: Letter) -> None:
        """What could not be said comes first again."""
        letter.tries += 1
        if letter.tries < _TRIES and len(self._letters) < self._most:
            self._letters.appendleft(letter)
            self._there.set()

    async def next(self) -> Letter:
        """The oldest, once there is one; it is taken out."""
        while not self._letters:
            self._there.clear()
            await self._there.wait()
        return self._letters.popleft()
