"""What the link's faults make of its datagrams; pure, for UDP and for flights in simulated time."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from mock_autopilot.faults.catalogue import Kind, Part
from mock_autopilot.faults.schedule import ActiveFault, FaultSchedule

Item = TypeVar("Item")
_SLACK_S = 1e-6
_WRONG_BYTES = 3


class LinkFaults:
    """One direction of the link: what is sent goes in, what arrives comes out."""

    def __init__(self, schedule: FaultSchedule, rng: np.random.Generator, direction: str) -> None:
        """`direction` as in fault_ways.TO and FROM."""
        self._schedule, self._rng, self._direction = schedule, rng, direction
        self._queue: list[tuple[float, object]] = []
        self._count = 0

    def pass_on(self, sent: Sequence[Item], now_s: float) -> Sequence[Item]:
        """What arrives at `now_s` (s, simulated), given that this is sent now.

        Bytes may arrive damaged; anything else stands for a datagram that, damaged, is not understood and lost. Call it
        often, also with nothing: what is held back arrives later.
        """
        held = self._schedule.active(Part.LINK)
        if not held and not self._queue:
            return sent
        mine = [one for one in held if one.fault.how in {"", self._direction}]
        for item in sent:
            self._queue += [(now_s, one) for one in self._what_is_left(item, mine)]
        delay_s = sum(one.fault.magnitude for one in mine if one.fault.kind is Kind.DELAYED)
        due = [item for at_s, item in self._queue if at_s + delay_s <= now_s + _SLACK_S]
        self._queue = self._queue[len(due) :]
        return due  # type: ignore[return-value]  # what comes out went in

    def _what_is_left(self, item: Item, held: Sequence[ActiveFault]) -> list[Item]:
        self._count += 1
        for one in held:
            kind, magnitude = one.fault.kind, one.fault.magnitude
            regular = kind is Kind.SLOW and int(self._count * magnitude + 1e-9) > int(
                (self._count - 1) * magnitude + 1e-9
            )
            by_chance = kind in {Kind.INTERMITTENT, Kind.GARBAGE} and float(self._rng.random()) < magnitude
            if (
                kind is Kind.OFF
                or regular
                or (by_chance and (kind is Kind.INTERMITTENT or not isinstance(item, bytes)))
            ):
                return []
            if by_chance:
                item = self._damaged(item)
        return [item]

    def _damaged(self, item: Item) -> Item:
        assert isinstance(item, bytes)
        data = bytearray(item)
        for place in self._rng.integers(len(data), size=_WRONG_BYTES).tolist():
            data[place] ^= int(self._rng.integers(1, 256))
        return bytes(data)  # type: ignore[return-value]
