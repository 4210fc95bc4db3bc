"""Ticks of a made-up flight whose law is on the ground: real ends of the link, and a delay between them."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from random import Random

import numpy as np

from companion.control.pipeline import idle_setpoint
from companion.control.remote_law import RemoteLaw
from companion.flight.remote_step import RemoteStep
from companion.flight.tick import Tick
from companion.law_link.agreement import Introduction
from companion.law_link.ground_end import GroundEnd
from companion.law_link.messages import Command, UpFlags
from companion.law_link.vehicle_end import VehicleEnd
from tests.records.flown import flight

SECRET = b"the key of the tests"
GROUND_AHEAD_S = 1000.0
"""Ground's clock less the vehicle's."""
UP_S, DOWN_S = 0.003, 0.002
"""Time on the way."""
EVERY = 7
"""Cycles from one command to the next."""


def _introduction(law: str) -> Introduction:
    return Introduction(version="1", law=law, host="ground", agreed={})


@dataclass
class Pair:
    """Both ends, joined by a network with constant delays."""

    random: Random = field(default_factory=lambda: Random(1))
    down: list[tuple[float, bytes]] = field(default_factory=list)
    now_s: float = 0.0
    lose: int = 0
    """Every how many messages up one is lost; 0: none."""
    sent: int = 0

    def __post_init__(self) -> None:
        self.end = VehicleEnd(SECRET, _introduction(""), self.random.randbytes)
        self.ground = GroundEnd(SECRET, _introduction("etnn"), self.random.randbytes, 0.03)

    def send(self, datagram: bytes) -> None:
        """flight.remote_step.LawLink: send to the ground."""
        self.down.append((self.now_s + DOWN_S, datagram))

    def live(self, now_s: float) -> None:
        """Let the ground run a cycle that is heard by the vehicle at `now_s`."""
        self.now_s = now_s
        cycle_s = now_s - UP_S
        for arrival_s, datagram in self.down:
            self.ground.hear(datagram, arrival_s + GROUND_AHEAD_S)
        self.down.clear()
        for datagram in self.ground.tick(cycle_s + GROUND_AHEAD_S):
            self.sent += 1
            if self.lose and self.sent % self.lose == 0:
                continue
            reply = self.end.hear(datagram, now_s, "ground")
            if reply is not None:
                self.send(reply)


def flight_with_link(track_s: float = 0.5, lose: int = 0) -> Iterator[Tick]:
    """Yield the ticks of `flown.flight`, with the link as its vehicle would see it."""
    pair, step, used = Pair(lose=lose), None, 0
    for number, tick in enumerate(flight(track_s=track_s)):
        pair.ground.epoch, pair.ground.flags = int(tick.flight.airborne), UpFlags(int(tick.flight.airborne))
        if tick.flight.airborne and number % EVERY == 0:
            pair.ground.command(Command(accel_w_mps2=(0.25, -0.5, number / 64), yaw_rad=0.125, capture_ago=120))
        pair.live(tick.time_s)
        step = step or RemoteStep(pair, RemoteLaw())
        step.read(tick.time_s, tick.flight)
        if tick.limited is not None:
            step.show(tick.time_s, tick.flight, tick.limited.setpoint, tick.limited, None)
        else:
            step.show(tick.time_s, tick.flight, idle_setpoint(0.0), None, None)
        yield replace(_with_event(tick, step.tick.command.number != used), link=step.tick, law=step.law_name)
        used = step.tick.command.number


def _with_event(tick: Tick, event: bool) -> Tick:
    """Return the tick with an event where the vehicle has a new command."""
    if tick.pipeline is None:
        return tick
    output = replace(tick.pipeline.law_output, event=np.array([float(event)]))
    return replace(tick, pipeline=replace(tick.pipeline, law_output=output))
