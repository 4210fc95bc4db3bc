"""Random fault schedules: one to three faults of the mock's vocabulary, at any time of a tracking flight.

Every second one is flown with both arms swinging, and their real driver; those from SPLIT_FROM on by a law on the
ground, with one or two faults of its link, of that law or of strangers as well.
"""

import asyncio
import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from companion.core.interfaces import ArmError
from companion.supervisor.faults import FailsafeAction
from companion.supervisor.flight_state import Phase, TrackRequest
from companion.trajectories.reference import Ellipse, LapTiming
from mock_autopilot.faults.catalogue import WAYS, Kind, Part, Way
from tests.flights.faults import acts, acts_link
from tests.flights.faults.judge import end_of
from tests.flights.faults.rows import ARMS, CONFIG, Act, Conditions, End
from tests.flights.faults.table_link import split
from tests.flights.faults.virtual import UP, Operator, fly_to_the_end, told_in
from tests.flights.faults.watch import Watch, fence_of
from tests.flights.faults.watch_link import link_problems
from tests.flights.simulated import Flight, Step
from tests.flights.test_simulated_arms import play, swing, torque

_SPOKEN = frozenset(way for way in WAYS if way.part is Part.BROKER and way.kind is not Kind.OFF)
"""Ways that only a reader of the broker's messages would notice."""
_HUNG = frozenset(way for way in WAYS if way.part is Part.AUTOPILOT and way.kind is Kind.STUCK)
"""Motors that keep their last signals and hear nobody: where it falls, and from which height, is chance and nobody's
reaction. The table flies it from a hover."""
_NETWORK = tuple(way for way in WAYS if way.part is Part.NETWORK)
_WAYS = tuple(way for way in WAYS if way not in _SPOKEN | _HUNG | {*_NETWORK})
_ACTS: dict[str, Act] = {
    "the ground law ends": acts_link.law_dies,
    "the ground law is stopped for 0.2 s": acts_link.law_stops(0.2),
    "the ground law is stopped for 2 s": acts_link.law_stops(2.0),
    "the ground law is started again within 0.2 s": acts_link.law_restarts(0.2),
    "a second ground law begins": acts_link.another_law,
    "a ground law with another key begins": acts_link.law_with_wrong_key,
    "the ground's frames end": acts_link.blind,
    "the ground's clock jumps by 0.05 s": acts_link.clock_jumps(0.05),
    "the ground's clock jumps by -5 s": acts_link.clock_jumps(-5.0),
    "this flight's messages come again": acts_link.this_flight_again,
    "an earlier flight's messages come": acts_link.earlier_flight_again,
    "datagrams of noise come": acts_link.garbage,
}
"""Faults of a law on the ground that the mock has no word for."""
SPLIT_FROM = 100
"""First seed of the schedules with a law on the ground."""
_LAP = TrackRequest(Ellipse(np.array([0.0, 0.0, 1.2]), timing=LapTiming(period_s=9.0, laps=1)), 0.5)
_LAST_S = 22.0
"""Take-off, approach, lap and landing: a fault begins at any time of it."""
_FOR_EVER = 0.4
"""Share of the faults that stay."""
_SHORTEST_S, _LONGEST_S = 0.03, 8.0


@dataclass(frozen=True)
class Outcome:
    """Outcome of one schedule."""

    seed: int
    faults: tuple[str, ...]
    end_state: str
    beyond_m: float
    """Furthest outside of the fence; negative: always inside."""
    says: str
    of_link: tuple[str, ...] = ()
    """Ways in which a law on the ground was followed although it must not be."""

    @property
    def problems(self) -> tuple[str, ...]:
        """Return what is not as it must be: down or with a pilot, and never outside of the fence."""
        up = (self.end_state,) if self.end_state == End.IN_THE_AIR else ()
        out = (f"{self.beyond_m:.2f} m outside of the fence",) if self.beyond_m > 0.0 else ()
        return (*up, *out, *self.of_link)


def faults_of(seed: int) -> tuple[str, ...]:
    """Return the mock's sentences, the same for the same seed."""
    rng = np.random.default_rng((2026, seed))
    ways = [way for way in _WAYS if has_arms(seed) or way.part is not Part.SERVOS]
    faults = tuple(_fault(ways, rng) for _ in range(int(rng.integers(1, 4))))
    return (*faults[:2], _fault(_NETWORK, rng)) if is_split(seed) else faults


def acts_of(seed: int) -> dict[str, float]:
    """Return what happens to the ground law, and when (s); the same for the same seed."""
    rng = np.random.default_rng((2027, seed))
    if not is_split(seed) or rng.random() < _FOR_EVER:
        return {}
    return {list(_ACTS)[int(rng.integers(len(_ACTS)))]: float(rng.uniform(0.0, _LAST_S))}


def is_split(seed: int) -> bool:
    """Return True if the schedule of this seed is flown by a law on the ground."""
    return seed >= SPLIT_FROM


def has_arms(seed: int) -> bool:
    """Return True if the schedule of this seed is flown with arms."""
    return seed % 2 == 1


def _fault(ways: Sequence[Way], rng: np.random.Generator) -> str:
    way = ways[int(rng.integers(len(ways)))]
    begin_s = rng.uniform(0.0, _LAST_S)
    text = f"{way.words}{_amount(way, rng)} at {begin_s:.2f} s"
    if not way.lasts or rng.random() < _FOR_EVER:
        return text
    return f"{text} for {np.exp(rng.uniform(np.log(_SHORTEST_S), np.log(_LONGEST_S))):.2f} s"


def _amount(way: Way, rng: np.random.Generator) -> str:
    """Half to one and a half times the usual, as far as that is possible."""
    if way.amount is None:
        return ""
    value = way.amount.usual * rng.uniform(0.5, 1.5)
    return " " + way.amount.text(round(float(np.clip(value, way.amount.least, way.amount.most)), 3))


class _Mission:
    """An ellipse after take-off; a Step that is done when it is flown, or when something else has begun."""

    def __init__(self) -> None:
        self._asked = self._tracked = False

    def __call__(self, flight: Flight) -> bool:
        if flight.loop.flight.level > FailsafeAction.WARN or flight.phase not in {
            Phase.TAKEOFF,
            Phase.HOLD,
            Phase.TRACK,
        }:
            return True
        self._tracked = self._tracked or flight.phase is Phase.TRACK
        if flight.phase is Phase.HOLD and not self._asked:
            self._asked = not flight.loop.submit(_LAP)
        return self._tracked and flight.phase is Phase.HOLD


def _swing_once_up(flight: Flight) -> bool:
    """The arms begin with the hover, unless they, or the flight, already are at fault."""
    if flight.phase is not Phase.HOLD or flight.loop.flight.level > FailsafeAction.WARN:
        return flight.phase is not Phase.TAKEOFF
    with contextlib.suppress(ArmError):
        play(swing())(flight)
    return True


def fly_schedule(seed: int) -> Outcome:
    """One flight: up, a lap of the ellipse, down, unless something comes of the faults."""
    return asyncio.run(_fly(seed))


async def _fly(seed: int) -> Outcome:
    faults, happens, operator = faults_of(seed), acts_of(seed), Operator(0.0)
    seen: list[tuple[Flight, Watch]] = []

    def look_on(flight: Flight) -> bool:
        watch = Watch(flight.room.bench.world, fence_of(CONFIG))
        watch.begin()
        seen.append((flight, watch))
        acts.connect_broker(flight)
        for name, at_s in happens.items():
            acts_link.later(flight, at_s, partial(_ACTS[name], flight))
        return True

    conditions = ARMS if has_arms(seed) else Conditions()
    if is_split(seed):
        conditions = split(conditions, onboard_mocap=seed % 4 != 0)
    begin = [torque, *UP[:-1], _swing_once_up] if has_arms(seed) else UP[:-1]
    script: list[Step] = [look_on, *begin, _Mission(), operator]
    await fly_to_the_end(script, replace(conditions, more=conditions.more | {"faults": faults}), seed)
    flight, watch = seen[0]
    end = end_of(watch.flown, operator.planned_s, told_in(flight))
    if watch.flown.piloted:
        end = End.PILOT  # who keeps it, if it cannot be taken back
    down = watch.flown.on_ground or end is End.PILOT
    reason = flight.loop.flight.reason
    told = (*faults, *(f"{name} at {at_s:.2f} s" for name, at_s in happens.items()))
    end_state = end if down else End.IN_THE_AIR
    return Outcome(seed, told, end_state, watch.flown.beyond_m, reason, link_problems(flight))
