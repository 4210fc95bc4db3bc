"""Flies one row in simulated time: up, into its phase, the fault, and to whatever end comes of it."""

import asyncio
import contextlib
import zlib
from dataclasses import dataclass, replace

import numpy as np

from companion.supervisor.flight_state import LandRequest, Phase, ResumeRequest, TakeoffRequest, TrackRequest
from companion.trajectories.reference import Ellipse, LapTiming
from mock_autopilot.world import STEP_S
from tests.flights.faults.judge import Result, judged
from tests.flights.faults.rows import CONFIG, Conditions, Row, When
from tests.flights.faults.table import VIRTUAL
from tests.flights.faults.watch import Told, Watch, fence_of
from tests.flights.faults.watch_link import link_problems
from tests.flights.simulated import Flight, FlightTimeoutError, Step, fly
from tests.flights.test_simulated_arms import play, swing, torque
from tests.flights.test_simulated_flights import ARM, ask, until, wait

LAP = Ellipse(np.array([0.0, 0.0, 1.2]), timing=LapTiming(period_s=9.0, laps=2))
HEIGHT_M = 1.2
LONGEST_S = 150.0
_PATIENCE_S = 35.0
"""Who is not down then will not come down."""
_OVER_S = 1.5
"""Down for so long: what the autopilot says of it has come."""
_PILOT_FLIES_S = 2.0
"""So long the operator leaves the vehicle to its pilot before he takes it back."""


HALFWAY_S = 1.0
"""Through the approach to the swing."""
UP = [*ARM, ask(TakeoffRequest(HEIGHT_M)), until(Phase.HOLD)]
PRELUDES: dict[When, list[Step]] = {
    When.GROUND: [*ARM, wait(0.3)],
    When.LIFT_OFF: [*ARM, wait(0.3)],
    When.TAKEOFF: [*ARM, ask(TakeoffRequest(HEIGHT_M)), lambda flight: bool(flight.room.truth_w_m[2] > 0.5)],
    When.HOVER: [*UP, wait(1.0)],
    When.TRACK: [*UP, ask(TrackRequest(LAP, 0.5)), until(Phase.TRACK), wait(3.0)],
    When.LANDING: [*UP, ask(LandRequest()), lambda flight: bool(flight.room.truth_w_m[2] < 0.8)],
    When.HANDED_OVER: [*UP, wait(1.0)],
    When.SWINGING: [torque, *UP, play(swing()), wait(HALFWAY_S)],
}


@dataclass
class Operator:
    """Watches a faulty flight to its end, and does what an operator does: lands it if nothing else ends it."""

    patience_s: float
    planned_s: float | None = None
    """When he landed because nothing had come of the fault."""
    _since_s: float | None = None
    _piloted_s: float | None = None
    _over_s: float | None = None

    def __call__(self, flight: Flight) -> bool:
        """A Step."""
        now_s, vehicle = flight.room.now_s(), flight.room.bench.world.vehicle
        self._since_s = now_s if self._since_s is None else self._since_s
        if vehicle.mode.name == "POSITION":
            self._take_back(flight, now_s)
        elif flight.phase in {Phase.TAKEOFF, Phase.HOLD, Phase.TRACK, Phase.ARMED}:
            self._end_it(flight, now_s)
        if vehicle.armed or not flight.room.bench.world.truth.on_ground:
            self._over_s = None
            return now_s - self._since_s > _PATIENCE_S
        self._over_s = now_s if self._over_s is None else self._over_s
        return now_s - self._over_s > _OVER_S

    def _take_back(self, flight: Flight, now_s: float) -> None:
        self._piloted_s = now_s if self._piloted_s is None else self._piloted_s
        if now_s - self._piloted_s > _PILOT_FLIES_S and flight.phase is Phase.HANDED_OVER:
            flight.loop.submit(ResumeRequest())

    def _end_it(self, flight: Flight, now_s: float) -> None:
        assert self._since_s is not None
        if self._piloted_s is not None or now_s - self._since_s > self.patience_s:
            if self._piloted_s is None:
                self.planned_s = now_s if self.planned_s is None else self.planned_s
            flight.loop.submit(LandRequest())


def fly_row(row: Row) -> Result:
    """Fly it to the end, whatever that is, by an autopilot whose horizon errs as drawn for this row."""
    flight, watch, operator = asyncio.run(_fly(row, seed_of(row)))
    result = judged(row, watch.flown, told_in(flight), operator.planned_s)
    return replace(result, problems=(*result.problems, *link_problems(flight)))


def seed_of(row: Row) -> int:
    """Return a seed that stays with the row when others come and go; a row's errors are not its neighbour's."""
    return zlib.crc32(row.name.encode())


def fly_named(name: str) -> Result:
    """For a worker process: a row's acts cannot be sent to one, its name can."""
    return fly_row(next(row for row in VIRTUAL if row.name == name))


def told_in(flight: Flight) -> Told:
    """Return what the companion told in the ticks of this flight."""
    told = Told()
    for tick in flight.ticks:
        told(tick)
    return told


async def _fly(row: Row, seed: int) -> tuple[Flight, Watch, Operator]:
    operator = Operator(row.patience_s)
    seen: list[tuple[Flight, Watch]] = []

    def look_on(flight: Flight) -> bool:
        seen.append((flight, Watch(flight.room.bench.world, fence_of(CONFIG))))
        return True

    def break_it(flight: Flight) -> bool:
        seen[0][1].begin()
        for make in row.make:
            if isinstance(make, str):
                flight.room.inject(make)
            else:
                make(flight)
        return True

    await fly_to_the_end([look_on, *PRELUDES[row.when], break_it, operator], row.flown_with, seed)
    return (*seen[0], operator)


async def fly_to_the_end(script: list[Step], conditions: Conditions, seed: int) -> None:
    """Or for LONGEST_S: who looks on will say that it is still in the air."""
    with contextlib.suppress(FlightTimeoutError):
        await fly(
            script,
            controller=conditions.law,
            config=conditions.config,
            seed=seed,
            longest_s=LONGEST_S,
            step_s=STEP_S,  # the mock's own: times of reaction are measured
            **conditions.more,
        )
