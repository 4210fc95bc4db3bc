"""A law on the ground in simulated time: `companion law` and both ends of its link as they are, over a simulated radio.

The ground's clock is not the vehicle's. Datagrams are delivered in the order of their arrival.
"""

import heapq
import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import LawConfig
from companion.core.types import MocapFrame
from companion.flight.assembly import controller_of
from companion.ground.ground_law import GroundLaw, GroundTick
from companion.ground.ground_service import parts_of, with_link
from companion.law_link.agreement import Introduction
from companion.law_link.ground_end import GroundEnd
from companion.law_link.vehicle_end import VehicleEnd

SECRET = b"a key that both sides have"
PERIOD_S, WAITS_FOR_FRAME_S = 0.01, 0.014
CLOCKS_APART_S = 500.0


class Room(Protocol):
    """The room, as far as the ground has to do with it."""

    frame: MocapFrame | None
    new_frame: bool

    def now_s(self) -> float: ...

    def pass_time(self, for_s: float) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Radio:
    """What the air does to each datagram, in both directions."""

    delay_s: float = 0.003
    jitter_s: float = 0.0
    """Mean of what is added to it, exponential."""
    loss: float = 0.0


def ground_config(config: CompanionConfig, onboard_mocap: bool) -> CompanionConfig:
    """Return a configuration with the law on the ground; the key is given otherwise."""
    law = LawConfig().model_copy(update={"runs_on": "ground", "onboard_mocap": onboard_mocap})
    return config.model_copy(update={"law": law})


class SimulatedGround:
    """The ground law, the radio, and the vehicle's end of it: flight.remote_step.LawLink."""

    def __init__(
        self, config: CompanionConfig, law: str = "practical", radio: Radio | None = None, seed: int = 1
    ) -> None:
        self.radio, self._rng = radio or Radio(), np.random.default_rng(seed)
        me = Introduction(version="1", law=law, host="simulated", agreed={})
        self.end = VehicleEnd(SECRET, replace(me, law=""), self._rng.bytes)
        self.ground_end = GroundEnd(SECRET, me, self._rng.bytes, config.law.link.beat_s)
        late_s = self.radio.delay_s + self.radio.jitter_s  # as `companion law` measures before a flight
        made = controller_of(with_link(config, late_s), law).law
        self.law = GroundLaw(self.ground_end, replace(parts_of(config), delay_s=late_s), law, made)
        self.ticks: list[GroundTick] = []
        self.dies_at_s = math.inf
        """From then on the ground computes and sends nothing."""
        self.cut_off_s = (math.inf, math.inf)
        """Nothing arrives, either way, in this time."""
        self._now_s = 0.0
        self._cycle_s = 0.0
        self._on_the_way: list[tuple[float, int, bool, bytes]] = []
        self._count = 0
        self.last_arrival_s = -math.inf
        """Arrival of the newest datagram at the vehicle."""

    def send(self, datagram: bytes) -> None:
        """Send from the vehicle to the ground."""
        self._send(datagram, up=False)

    def pass_time(self, room: Room, for_s: float, until_frame: bool) -> bool:
        """Let time pass, for the ground and what is on its way, too; with `until_frame`, to a frame and True."""
        end_s = room.now_s() + for_s
        while True:
            due_s = min(end_s, self._cycle_s + WAITS_FOR_FRAME_S, *(one[0] for one in self._on_the_way[:1]))
            room.pass_time(max(due_s - room.now_s(), 0.0))
            self._now_s = room.now_s()
            self._deliver()
            fresh, room.new_frame = room.new_frame, False
            if fresh or self._now_s >= self._cycle_s + WAITS_FOR_FRAME_S - 1e-9:
                self._cycle(room.frame if fresh else None)
            if (fresh and until_frame) or self._now_s >= end_s - 1e-9:
                return fresh and until_frame

    def _cycle(self, frame: MocapFrame | None) -> None:
        """Run one cycle of the ground, as GroundLoop does."""
        self._cycle_s = self._now_s
        if self._now_s >= self.dies_at_s:
            return
        if frame is not None:
            self.law.take(replace(frame, received_s=frame.received_s - CLOCKS_APART_S))
        self.ticks.append(self.law.tick(self._ground_s, PERIOD_S))
        for datagram in self.ground_end.tick(self._ground_s):
            self._send(datagram, up=True)
        self.law.settle()

    @property
    def _ground_s(self) -> float:
        return self._now_s - CLOCKS_APART_S

    def _send(self, datagram: bytes, up: bool) -> None:
        radio, (begin_s, end_s) = self.radio, self.cut_off_s
        late_s = radio.delay_s + (self._rng.exponential(radio.jitter_s) if radio.jitter_s else 0.0)
        lost = radio.loss and self._rng.uniform() < radio.loss
        if lost or begin_s <= self._now_s < end_s:
            return
        self._count += 1
        heapq.heappush(self._on_the_way, (self._now_s + late_s, self._count, up, datagram))

    def _deliver(self) -> None:
        while self._on_the_way and self._on_the_way[0][0] <= self._now_s + 1e-9:
            _, _, up, datagram = heapq.heappop(self._on_the_way)
            if up:
                self.last_arrival_s = self._now_s
                reply = self.end.hear(datagram, self._now_s, "ground")
                if reply is not None:
                    self.send(reply)
            elif self._now_s < self.dies_at_s:
                self.ground_end.hear(datagram, self._ground_s)
