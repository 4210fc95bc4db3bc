"""A scripted operator who flies one vehicle at random: goto and track, also across the others, on and on."""

import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from companion.core.types import Array, FlightMode
from companion.supervisor.flight_state import (
    ArmRequest,
    LandRequest,
    Phase,
    Request,
    TakeoffRequest,
    TrackRequest,
)
from companion.trajectories.reference import Ellipse, FigureEight, Hold, LapTiming
from tests.flights.simulated import Flight

HALF_M = 3.2
"""Half the side of the square in which places are drawn."""
HEIGHTS_M = (0.6, 2.6)
FASTEST_MPS = 1.2
"""Of a track."""
SPOT_M = 0.4
"""Largest distance per axis of a goto across another vehicle from it."""
AGAIN_S = 0.5
"""Time from a refusal to the next command."""
PATIENCE = 2
"""After so many refusals in a row it looks where the others are, and goes where they are not."""
CHOICES = 12
ARMING_S = 6.0
"""Longest time of one attempt to arm."""
GROUND = frozenset({Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED})

Place = tuple[float, float, float]


@dataclass
class Operator:
    """Flies one vehicle until it is told to stop; called at every tick, as a step of its script."""

    rng: random.Random
    places_of_others: Callable[[], list[Place]]
    """True places of the other vehicles, W, m."""
    until_s: float
    counts: Counter[str] = field(default_factory=Counter)
    refusals: Counter[str] = field(default_factory=Counter)
    """Reasons of refused commands, without their numbers."""
    rests_until_s: float = 0.0
    """Until then it gives no command to a vehicle on the ground."""
    retired = False
    """It gives no more commands: its service is gone."""
    takeoff_refused = False
    """It stands armed, and may not take off."""
    refused_in_a_row: int = 0
    _next_s: float = 0.0
    _arming_since_s: float | None = None

    def __call__(self, flight: Flight) -> bool:
        """Give a command if one is due; return True when the time is over."""
        now_s = flight.room.now_s()
        if now_s >= self.until_s:
            return True
        if self.retired or now_s < self._next_s:
            return False
        phase = flight.phase
        if phase in GROUND or self._arming_since_s is not None:
            self._get_up(flight, now_s)
        elif phase is Phase.HOLD and not _moves(flight, now_s):
            self._go_on(flight, now_s)
        return False

    @property
    def wants(self) -> bool:
        """Return True if it has something to do."""
        return not self.retired

    def land(self, flight: Flight, rest_s: float) -> None:
        """Land the vehicle and leave it for a while."""
        self.rests_until_s = flight.room.now_s() + rest_s
        self._say(flight, LandRequest("the operator lands"), "land")

    def _get_up(self, flight: Flight, now_s: float) -> None:
        """Arm and take off, in the steps of the service: stream, OFFBOARD, arm, climb."""
        phase, status = flight.phase, flight.autopilot.status()
        self.takeoff_refused = self.takeoff_refused and phase is Phase.ARMED
        if phase in GROUND:
            self._arming_since_s = None
            if now_s < self.rests_until_s or not _may_arm(flight):
                return
            if self._say(flight, ArmRequest(), "arm"):
                self._arming_since_s = now_s
            self._next_s = now_s + 0.3
        elif phase is Phase.ARMED:
            if self._say(flight, TakeoffRequest(self.rng.uniform(0.8, 1.8)), "takeoff"):
                self._arming_since_s = None
            self.takeoff_refused = self._arming_since_s is not None
            self._next_s = now_s + AGAIN_S
        elif phase is Phase.PREFLIGHT:
            assert self._arming_since_s is not None
            if now_s - self._arming_since_s > ARMING_S:
                flight.loop.submit(LandRequest())
                self._arming_since_s = None
            elif status.mode is not FlightMode.OFFBOARD:
                flight.autopilot.command(176, 1.0, 6.0, 0.0)
            else:
                flight.autopilot.command(400, 1.0)
            self._next_s = now_s + 0.3
        else:
            self._arming_since_s = None

    def _go_on(self, flight: Flight, now_s: float) -> None:
        stuck = self.refused_in_a_row >= PATIENCE
        taken = self._say(flight, self._away(flight) if stuck else self._something(), "move")
        self.refused_in_a_row = 0 if taken else self.refused_in_a_row + 1
        self._next_s = now_s + (self.rng.uniform(0.1, 1.0) if taken else AGAIN_S)

    def _away(self, flight: Flight) -> Request:
        """Return a goto to the one of some random places on whose straight way the others are farthest."""
        here, others = flight.room.truth_w_m, self.places_of_others()
        places = [np.array(self._place()) for _ in range(CHOICES)]
        best = max(places, key=lambda place: min((_beside_m(other, here, place) for other in others), default=0.0))
        return TrackRequest(Hold(best, self._yaw_rad()), 0.0)

    def _something(self) -> Request:
        """Return a random command, a third of them to a place next to another vehicle."""
        kind, others = self.rng.random(), self.places_of_others()
        if kind < 0.3 and others:
            x, y, z = self.rng.choice(others)
            near = [at + self.rng.uniform(-SPOT_M, SPOT_M) for at in (x, y, z)]
            return TrackRequest(Hold(np.array(_inside(near)), self._yaw_rad()), 0.0)
        if kind < 0.65:
            return TrackRequest(Hold(np.array(self._place()), self._yaw_rad()), 0.0)
        if kind < 0.97:
            return self._track()
        return LandRequest("the operator lands")

    def _track(self) -> TrackRequest:
        axes = self.rng.uniform(0.6, 1.8), self.rng.uniform(0.5, 1.5)
        eight = self.rng.random() < 0.5
        widest_m = max(axes[0], 2.0 * axes[1]) if eight else max(axes)
        period_s = max(6.0, 2.0 * np.pi * widest_m / self.rng.uniform(0.5 * FASTEST_MPS, FASTEST_MPS))
        x, y, z = self._place()
        centre = np.array([_within(x, HALF_M - axes[0]), _within(y, HALF_M - axes[1]), z])
        timing = LapTiming(period_s=period_s, laps=self.rng.choice((1, 2)), ramp_s=3.0)
        curve = FigureEight if eight else Ellipse
        return TrackRequest(curve(centre, axes, timing), self.rng.uniform(0.0, 1.0))

    def _place(self) -> Place:
        return (
            self.rng.uniform(-HALF_M, HALF_M),
            self.rng.uniform(-HALF_M, HALF_M),
            self.rng.uniform(*HEIGHTS_M),
        )

    def _yaw_rad(self) -> float:
        return self.rng.uniform(-np.pi, np.pi)

    def _say(self, flight: Flight, request: Request, what: str) -> bool:
        """Give a command; return True if it is accepted."""
        refused = flight.loop.submit(request)
        self.counts[f"{what} {'refused' if refused else 'accepted'}"] += 1
        if refused:
            self.refusals[_without_numbers(refused)] += 1
        return not refused


def _moves(flight: Flight, now_s: float) -> bool:
    """Return whether a vehicle in HOLD is still on its way: a goto, or the approach of a track, is flown in HOLD."""
    state = flight.loop.flight
    return len(state.legs) > 1 or (bool(state.legs) and now_s - state.leg_start_s < state.legs[0].trajectory.duration_s)


def _beside_m(point: Place, begin: Array, end: Array) -> float:
    """Return the horizontal distance of a point from a straight way."""
    way, to = (end - begin)[:2], np.array(point)[:2] - begin[:2]
    along = float(np.clip(way @ to / max(float(way @ way), 1e-9), 0.0, 1.0))
    return float(np.hypot(*(to - along * way)))


def _may_arm(flight: Flight) -> bool:
    """Return whether PX4's checks are over and it trusts its pose: what `companion arm` waits for."""
    vehicle = flight.room.bench.world.vehicle
    passed = vehicle.commander.checked(vehicle.failsafe_flags)
    return passed and vehicle.estimator.local_ok and not vehicle.armed and flight.room.frame is not None


def _within(value: float, half: float) -> float:
    return max(-half, min(half, value))


def _inside(place: list[float]) -> Place:
    x, y, z = place
    return _within(x, HALF_M), _within(y, HALF_M), max(HEIGHTS_M[0], min(HEIGHTS_M[1], z))


def _without_numbers(text: str) -> str:
    return " ".join("#" if any(letter.isdigit() for letter in word) else word for word in text.split())[:90]
