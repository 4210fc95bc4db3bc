"""After PX4 has taken the vehicle, a law on the ground flies it again when the operator says so, and not before."""

import pytest

from companion.core.types import FlightMode
from companion.supervisor.faults import Fault
from companion.supervisor.flight_state import LandRequest, Phase, ResumeRequest, TakeoffRequest
from tests.flights.faults import acts_link
from tests.flights.faults.rows import Act
from tests.flights.faults.table_link import SPLIT
from tests.flights.faults.watch_link import link_problems
from tests.flights.simulated import Flight, Step, fly
from tests.flights.test_simulated_flights import ARM, ask, inject, until, wait

pytestmark = pytest.mark.slow

UP: list[Step] = [*ARM, ask(TakeoffRequest(2.0)), until(Phase.HOLD)]
AGAIN: list[Step] = [ask(ResumeRequest()), until(Phase.HOLD), wait(1.0), ask(LandRequest()), until(Phase.DISARMED)]


def happens(act: Act) -> Step:
    def step(flight: Flight) -> bool:
        act(flight)
        return True

    return step


def refused(because: str) -> Step:
    def step(flight: Flight) -> bool:
        assert because in flight.loop.refusal(ResumeRequest())
        return True

    return step


def links_well(flight: Flight) -> bool:
    return not flight.loop.refusal(ResumeRequest())


async def flown(*script: Step) -> Flight:
    flight = await fly([*UP, *script, *AGAIN], config=SPLIT.config, **SPLIT.more)
    assert flight.phases()[-5:] == [Phase.HANDED_OVER, Phase.RESUME, Phase.HOLD, Phase.LAND, Phase.DISARMED]
    assert link_problems(flight) == ()
    assert not flight.loop.flight.reason, "the landing was the operator's"
    return flight


async def test_a_ground_law_that_was_out_of_reach_is_used_again_after_resume() -> None:
    flight = await flown(
        inject("network off for 0.5 s"),
        until(Phase.HANDED_OVER),
        wait(0.1),
        refused("nothing from the ground law on ground for"),
        links_well,
        wait(0.3),
    )
    heard = flight.ground
    assert heard is not None
    landing = [tick for tick in flight.ticks if tick.flight.phase is Phase.HANDED_OVER]
    assert landing[-1].flight.cause is Fault.GROUND_LAW_SILENT
    assert landing[-1].status.mode is FlightMode.LAND, "until the operator resumed, although the link was back"
    assert landing[-1].time_s - max(at_s for at_s, one in heard.heard if at_s < landing[-1].time_s) < 0.05


async def test_a_ground_law_that_was_restarted_is_used_after_resume() -> None:
    flight = await flown(
        happens(acts_link.law_restarts(0.2)),
        until(Phase.HANDED_OVER),
        wait(0.1),
        refused("nothing from the ground law on ground for"),
        links_well,
    )
    assert flight.ground is not None
    assert len(flight.ground.all_grounds) == 2
    ended, begun = (ground.law for ground in flight.ground.all_grounds)
    assert ended is not begun
    back_s = next(tick.time_s for tick in flight.ticks if tick.flight.phase is Phase.RESUME)
    assert not any(tick.flown for tick in flight.ground.ground.ticks if tick.vehicle_s < back_s)
