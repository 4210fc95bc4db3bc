"""Flies all vehicles of one seed for some minutes of simulated time, and judges them."""

import asyncio
import gc
import random
import time
from collections import Counter
from dataclasses import dataclass, field

import uvloop

from companion.config.companion_config import CompanionConfig
from companion.flight.tick import Tick
from companion.geometry.frames import flip_yz
from mock_autopilot.config import MockConfig
from tests.flights.command import ROOT
from tests.flights.fleet.judge import DEADLOCK_S, STEP_S, Blocked, Closest, Judge, Limit
from tests.flights.fleet.operator import Operator, Place
from tests.flights.fleet.plan import LOST_S, REST_S, SILENT_S, Incident, Trouble, incidents_of
from tests.flights.simulated import BRISK, Flight, Step
from tests.flights.simulated_fleet import FleetFlight, fly_fleet

WIND = MockConfig.load(ROOT / "config" / "mock.toml").disturbance.model_dump()
"""The demo's forces, 1.5 N and more."""


@dataclass(frozen=True)
class Order:
    """The flights of one seed: vehicles, time, incidents."""

    seed: int
    vehicles: int
    for_s: float
    faults: bool = True
    keeps_trail: bool = False
    incidents: tuple[Incident, ...] = ()
    """Instead of those of the seed."""


@dataclass
class Outcome:
    """Measurements and problems of the flights of one seed."""

    seed: int
    vehicles: int
    for_s: float
    closest: Closest
    lost: list[Closest]
    collisions: list[str]
    blocked: Blocked
    stood_s: float
    """Longest time in which a takeoff was refused again and again."""
    incidents: list[str]
    counts: dict[str, int]
    refusals: dict[str, int]
    faults: dict[str, int]
    """Number of times that each row of the fault table began, over all vehicles."""
    flown_m: float
    cpu_s: float
    raised: str = ""
    trail: list[str] = field(default_factory=list)

    @property
    def problems(self) -> list[str]:
        """Return what must not be; empty when all is well."""
        found = [f"collision of {pair}" for pair in self.collisions]
        for one in self.lost:
            found.append(
                f"separation of {' and '.join(one.pair)} lost by {-one.clearance_m:.2f} m at {one.time_s:.1f} s "
                f"({one.beside_m:.2f} m beside, {one.above_m:.2f} m above; {', '.join(one.phases)})"
            )
        if self.blocked.for_s > DEADLOCK_S:
            b = self.blocked
            found.append(f"{b.body} blocked for {b.for_s:.1f} s until {b.time_s:.1f} s in {b.phase}: {b.reason}")
        return [*found, self.raised] if self.raised else found


@dataclass
class _Watched:
    """Counters that every tick adds to."""

    faults: Counter[str] = field(default_factory=Counter)
    flown_m: float = 0.0
    _before: dict[int, frozenset[str]] = field(default_factory=dict)
    _speed_sum: float = 0.0

    def tick(self, flight: Flight, tick: Tick) -> None:
        """Count the faults that begin."""
        key = id(flight)
        if tick.events or key in self._before:
            now = frozenset(str(event.fault) for event in tick.events)
            for fault in now - self._before.get(key, frozenset()):
                self.faults[fault] += 1
            self._before[key] = now
        vehicle = tick.vehicle
        if vehicle is not None and tick.flight.airborne:
            vx, vy, vz = vehicle.velocity_w_mps.tolist()
            self.flown_m += 0.01 * (vx * vx + vy * vy + vz * vz) ** 0.5


def fly_seed(order: Order) -> Outcome:
    """Fly and judge one seed; in a process of its own, or in this one."""
    usual = gc.get_threshold()
    gc.set_threshold(50_000, 20, 100)  # most of a flight's many small values are freed by their counts
    try:
        with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            return runner.run(_fly(order))
    finally:
        gc.set_threshold(*usual)


async def _fly(order: Order) -> Outcome:
    begun_s, watched = time.process_time(), _Watched()
    room: list[FleetFlight] = []
    judges: list[Judge] = []
    operators = [_operator(order, number, room) for number in range(order.vehicles)]
    drawn = incidents_of(order.seed, order.vehicles, order.for_s) if order.faults else []
    incidents = list(order.incidents) or drawn
    happened: list[str] = []
    config = CompanionConfig(flight=BRISK)

    def made(fleet: FleetFlight) -> None:
        room.append(fleet)
        judge = Judge(fleet, operators, limit_of(config), keeps_trail=order.keeps_trail)
        judges.append(judge)
        fleet.room.fleet.observers.append(judge.look)
        for vehicle in fleet.room.vehicles:
            vehicle.bench.skips_wire = True

    due = list(incidents)

    def incident(_: Flight) -> bool:
        while due and room[0].room.now_s() >= due[0].at_s:
            happened.append(_let_happen(due.pop(0), room[0], operators, judges[0]))
        return False

    def script(operator: Operator) -> list[Step]:
        return [lambda flight: incident(flight) or operator(flight)]

    raised = ""
    try:
        await fly_fleet(
            [script(operator) for operator in operators],
            config=config,
            seed=order.seed,
            tables={"disturbance": WIND},
            step_s=STEP_S,
            watch=watched.tick,
            made=made,
            longest_s=order.for_s + 10.0,
        )
    except Exception as error:
        raised = f"{type(error).__name__}: {error}"
    judge, fleet = judges[0], room[0]
    return Outcome(
        seed=order.seed,
        vehicles=order.vehicles,
        for_s=order.for_s,
        closest=judge.closest,
        lost=judge.lost,
        collisions=[str(met) for met in fleet.room.fleet.collisions],
        blocked=judge.blocked,
        stood_s=judge.longest_stood_s,
        incidents=happened,
        counts=dict(sum((operator.counts for operator in operators), Counter[str]())),
        refusals=dict(sum((operator.refusals for operator in operators), Counter[str]())),
        faults=dict(watched.faults),
        flown_m=watched.flown_m,
        cpu_s=time.process_time() - begun_s,
        raised=raised,
        trail=list(judge.trail),
    )


def _operator(order: Order, number: int, room: list[FleetFlight]) -> Operator:
    rng = random.Random(f"operator {order.seed} {number}")
    return Operator(rng, lambda: _others(room[0], number), order.for_s)


def limit_of(config: CompanionConfig) -> Limit:
    """Return the cylinder that is judged by: the one that the vehicles keep."""
    separation = config.separation
    return Limit(separation.radius_m, separation.height_m, separation.parked_height_m)


def _others(fleet: FleetFlight, number: int) -> list[Place]:
    places = []
    for other, world in enumerate(fleet.room.fleet.worlds):
        if other != number:
            x, y, z = flip_yz(world.truth.position_ned_m).tolist()
            places.append((x, y, z))
    return places


def _let_happen(incident: Incident, fleet: FleetFlight, operators: list[Operator], judge: Judge) -> str:
    """Let a trouble begin; return it as a line."""
    number = incident.vehicle
    flight, operator = fleet.flights[number], operators[number]
    phase = flight.phase
    if incident.trouble is Trouble.LANDS:
        operator.land(flight, REST_S)
    elif incident.trouble is Trouble.FREEZES:
        fleet.freeze(number)
        operator.retired = True
        judge.excused.add(number)
    elif incident.trouble is Trouble.SILENT:
        flight.room.inject(f"link off for {SILENT_S:g} s")
    else:
        flight.room.inject(f"mocap wrong (lost) for {LOST_S:g} s")
    return f"{incident.at_s:.1f} s: {fleet.room.fleet.names[number]} {incident.trouble} in {phase}"
