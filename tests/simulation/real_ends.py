"""Both ends of the law's link as they fly, over the simulation's directions: what the model of them is held against."""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.flight.remote_step import REPORT_S
from companion.law_link import messages as wire
from companion.simulation.virtual_link import Direction
from companion.simulation.virtual_link_ends import BYTES, Kind
from mock_autopilot.impairment.sentences import Directions
from tests.law_link.ends import HOVER, Joined, shown

PERIOD_S = 0.01


@dataclass(frozen=True, kw_only=True)
class Flown:
    """Cycles (n,) of a flight."""

    kind: NDArray[np.int8]
    in_use: NDArray[np.int64]
    """Cycle in which the command in use was computed; -1 without one."""
    silence_s: NDArray[np.float64]
    bytes_up: int


class RealEnds:
    """Ground and vehicle with a session, in flight, and what is on the way between them."""

    def __init__(self, radio: Directions, seed: int, cycles: int) -> None:
        ways = np.random.SeedSequence(seed, spawn_key=(3,)).spawn(2)
        self._up, self._down = (
            Direction([one], [way], [seed], cycles, PERIOD_S)
            for one, way in zip((radio.up, radio.down), ways, strict=True)
        )
        joined = Joined()
        for _ in range(5):
            joined.cycle()
            joined.report(shown(0, airborne=False, epoch=0))
        joined.fly()
        self.vehicle, self.ground, self._zero_s = joined.vehicle, joined.ground, joined.now_s + PERIOD_S
        self._way: list[tuple[float, int, bytes]] = []
        self._back: list[tuple[float, int, bytes]] = []
        self._count, self._shown, self._shown_s = 0, -1, -np.inf

    def fly(self, events: NDArray[np.bool_]) -> Flown:
        """Fly with new commands in the cycles of the mask (n,)."""
        before = self.ground.counts.bytes_up
        rows = [self._cycle(cycle, bool(event)) for cycle, event in enumerate(events)]
        kind, number, silence_s = (np.array(column) for column in zip(*rows, strict=True))
        computed = np.concatenate(([-1], np.flatnonzero(events)))
        return Flown(
            kind=kind, in_use=computed[number], silence_s=silence_s, bytes_up=self.ground.counts.bytes_up - before
        )

    def _cycle(self, cycle: int, event: bool) -> tuple[int, int, float]:
        now_s = self._zero_s + cycle * PERIOD_S
        for at_s, datagram in _due(self._back, now_s):
            self.ground.hear(datagram, at_s)
        if event:
            self.ground.command(HOVER)
        again = self.ground.counts.again
        datagrams = self.ground.tick(now_s)
        kind = _kind_of(datagrams, event, self.ground.counts.again > again)
        self._send(self._up, self._way, cycle, datagrams, int(BYTES[kind]))
        for at_s, datagram in _due(self._way, now_s):
            self.vehicle.hear(datagram, at_s, "ground")
        held = self.vehicle.use(now_s)
        number = 0 if held is None else held.number
        if number != self._shown or self.vehicle.unreported or now_s - self._shown_s >= REPORT_S - 1e-6:
            self._shown, self._shown_s = number, now_s
            report = self.vehicle.report(shown(number), now_s)
            assert report is not None
            self._send(self._down, self._back, cycle, [report], len(report))
        return kind, number, self.vehicle.status(now_s).silence_s

    def _send(
        self, way: Direction, on_it: list[tuple[float, int, bytes]], cycle: int, datagrams: list[bytes], size: int
    ) -> None:
        way.send(cycle, np.array([bool(datagrams)]), float(size))
        arrival_s = float(way.arrival_s[cycle, 0])
        for datagram in datagrams if np.isfinite(arrival_s) else ():
            self._count += 1
            heapq.heappush(on_it, (self._zero_s + arrival_s, self._count, datagram))


def _due(on_the_way: list[tuple[float, int, bytes]], now_s: float) -> list[tuple[float, bytes]]:
    out = []
    while on_the_way and on_the_way[0][0] <= now_s + 1e-6:
        at_s, _, datagram = heapq.heappop(on_the_way)
        out.append((min(at_s, now_s), datagram))
    return out


def _kind_of(datagrams: list[bytes], event: bool, again: bool) -> Kind:
    if event or again:
        return Kind.EVENT if event else Kind.AGAIN
    if not datagrams:
        return Kind.NOTHING
    return Kind.CLOCK if datagrams[-1][0] == wire.Kind.CLOCK else Kind.BEAT
