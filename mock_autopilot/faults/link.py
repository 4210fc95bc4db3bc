"""Faults of the MAVLink link, applied to its datagrams; pure, for UDP and for flights in simulated time."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from mock_autopilot.faults.catalogue import Kind, Part
from mock_autopilot.faults.schedule import ActiveFault, FaultSchedule

Item = TypeVar("Item")
_SLACK_S = 1e-6
_WRONG_BYTES = 3


class LinkFaults:
    """The faults of one direction of the link; takes datagrams sent, returns datagrams that arrive."""

    def __init__(self, schedule: FaultSchedule, rng: np.random.Generator, direction: str) -> None:
        """Take the faults of one `direction`, catalogue.TO or catalogue.FROM."""
        self._schedule, self._rng, self._direction = schedule, rng, direction
        self._queue: list[tuple[float, object]] = []
        self._count = 0

    def pass_on(self, sent: Sequence[Item], now_s: float) -> Sequence[Item]:
        """Return the datagrams that arrive at `now_s` (s, simulated) when `sent` is sent now.

        Bytes may arrive damaged; an item of another type is lost when it would be damaged. Call it
        often, also without datagrams: delayed ones arrive later.
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
