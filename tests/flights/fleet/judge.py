"""Judgement of several flights in one room: separation, collisions, and vehicles that do not get on."""

import math
from collections import deque
from dataclasses import dataclass, field

from companion.supervisor.faults import Fault
from companion.supervisor.flight_state import FlightRules, Phase
from mock_autopilot.mavlink.streams import TICK_S
from mock_autopilot.physics.truth import Truth
from tests.flights.fleet.operator import Operator, Place
from tests.flights.simulated_fleet import FleetFlight

STEP_S = TICK_S
"""Of the worlds: 4 ms, twice as long as the mock's own; a third less to compute."""
EVERY = 5
"""Steps between two looks."""
LIFT_OFF_M = FlightRules().lift_off_m
"""Height from which on a vehicle counts as flying, as the supervisor has it."""
STAYS_M = 0.3
"""A vehicle that stays within this for long is blocked, if it has something to do."""
WAITING = frozenset({Phase.HOLD, Phase.TRACK, Phase.TAKEOFF})
DEADLOCK_S = 10.0
KEPT = 400
"""Looks that are kept, to tell what led to a loss of separation."""


@dataclass(frozen=True)
class Limit:
    """The cylinder around a vehicle in which no other may be, and its height around one that is parked."""

    radius_m: float
    height_m: float
    parked_height_m: float


@dataclass
class Closest:
    """The least clearance that was seen: outside the cylinder it is positive, m."""

    clearance_m: float = math.inf
    time_s: float = math.nan
    pair: tuple[str, str] = ("", "")
    beside_m: float = math.nan
    above_m: float = math.nan
    phases: tuple[str, ...] = ()


@dataclass
class Blocked:
    """The longest time in which a vehicle with something to do stayed where it was."""

    for_s: float = 0.0
    time_s: float = math.nan
    body: str = ""
    phase: str = ""
    reason: str = ""


@dataclass
class _Anchor:
    place: Place
    waited_s: float = 0.0
    stood_s: float = 0.0


@dataclass
class Judge:
    """Looks at the truth of all vehicles; `look` is an observer of the fleet."""

    fleet: FleetFlight
    operators: list[Operator]
    limit: Limit
    closest: Closest = field(default_factory=Closest)
    lost: list[Closest] = field(default_factory=list)
    """Every time that a pair came inside, with the deepest point of it."""
    blocked: Blocked = field(default_factory=Blocked)
    longest_stood_s: float = 0.0
    """Longest time in which a takeoff was refused again and again."""
    trail: deque[str] = field(default_factory=lambda: deque(maxlen=KEPT))
    """Places and phases of the last seconds, for a person."""
    keeps_trail: bool = False
    excused: set[int] = field(default_factory=set)
    """Vehicles whose motion nobody commands any more: they are looked at, and not judged as blocked."""
    _steps: int = 0
    _anchors: dict[int, _Anchor] = field(default_factory=dict)
    _inside: dict[tuple[int, int], Closest] = field(default_factory=dict)

    def look(self, truths: tuple[Truth, ...]) -> None:
        """Take the truths of a step."""
        self._steps += 1
        if self._steps % EVERY:
            return
        time_s = truths[0].time_s
        places = [world.position_ned_m for world in self.fleet.room.fleet.worlds]
        for first in range(len(places)):
            for second in range(first + 1, len(places)):
                self._pair((first, second), places, truths)
        for number, place in enumerate(places):
            self._moves(number, place, time_s)
        if self.keeps_trail and self._steps % (5 * EVERY) == 0:
            self.trail.append(self.line(time_s))

    def _pair(self, pair: tuple[int, int], places: list[Place], truths: tuple[Truth, ...]) -> None:
        first, second = pair
        (x1, y1, z1), (x2, y2, z2) = places[first], places[second]
        beside_m, above_m = math.hypot(x1 - x2, y1 - y2), abs(z1 - z2)
        standing = [truth.on_ground or -truth.position_ned_m[2] < LIFT_OFF_M for truth in truths]
        if standing[first] and standing[second]:
            return
        stands = standing[second if z2 > z1 else first]  # the lower one: NED
        height_m = self.limit.parked_height_m if stands else self.limit.height_m
        clearance_m = max(beside_m - self.limit.radius_m, above_m - height_m)
        nearest = clearance_m < self.closest.clearance_m
        if not nearest and clearance_m >= 0.0 and pair not in self._inside:
            return
        names = self.fleet.room.fleet.names
        now = Closest(
            clearance_m,
            truths[0].time_s,
            (names[first], names[second]),
            beside_m,
            above_m,
            tuple(str(flight.phase) for flight in self.fleet.flights),
        )
        if nearest:
            self.closest = now
        self._track_inside(pair, now)

    def _track_inside(self, pair: tuple[int, int], now: Closest) -> None:
        deepest = self._inside.get(pair)
        if now.clearance_m >= 0.0:
            self._inside.pop(pair, None)
        elif deepest is None:
            self._inside[pair] = now
            self.lost.append(now)
        elif now.clearance_m < deepest.clearance_m:
            self.lost[self.lost.index(deepest)] = now
            self._inside[pair] = now

    def _moves(self, number: int, place: Place, time_s: float) -> None:
        """Note how long a vehicle that has something to do has waited in its place, in the air or for its takeoff.

        A landing, and what is done on the ground before a takeoff, is no waiting; nor is a hold while another vehicle
        is not seen, which the table of faults asks for. A takeoff that is refused because another one is too near is
        counted by itself: that is the rule, and both stand safely.
        """
        flight, operator = self.fleet.flights[number], self.operators[number]
        anchor = self._anchors.get(number)
        moved = anchor is None or math.dist(place, anchor.place) > STAYS_M
        if moved or operator.retired or number in self.excused:
            self._anchors[number] = _Anchor(place)
            return
        assert anchor is not None
        held = any(event.fault is Fault.OTHER_UNSEEN for event in flight.loop.events)
        if flight.phase is Phase.ARMED and operator.takeoff_refused:
            anchor.stood_s += EVERY * STEP_S
            self.longest_stood_s = max(self.longest_stood_s, anchor.stood_s)
        elif flight.phase in WAITING and not held and flight.loop.flight.airborne:
            anchor.waited_s += EVERY * STEP_S
        if anchor.waited_s > self.blocked.for_s:
            name, reason = self.fleet.room.fleet.names[number], flight.loop.flight.reason
            events = "; ".join(event.text for event in flight.loop.events)
            self.blocked = Blocked(anchor.waited_s, time_s, name, str(flight.phase), events or reason)

    def line(self, time_s: float) -> str:
        """Return what all vehicles do now, in a line."""
        words = [f"{time_s:8.2f}"]
        for flight, world in zip(self.fleet.flights, self.fleet.room.fleet.worlds, strict=True):
            x, y, z = world.position_ned_m
            vx, vy, vz = world.truth.velocity_ned_mps
            faults = ",".join(str(event.fault) for event in flight.loop.events)
            words.append(f"{x:6.2f} {-y:6.2f} {-z:5.2f} v {vx:5.2f} {-vy:5.2f} {-vz:5.2f} {flight.phase} {faults}")
        return " | ".join(words)
