"""The flights in simulated time end when their script fails, and say why."""

import asyncio
from typing import Never

import pytest

from companion.supervisor.flight_state import Phase
from tests.flights.simulated import Flight, FlightTimeoutError, fly
from tests.flights.test_simulated_flights import QUICK_UP, until, wait

pytestmark = pytest.mark.slow

PROMPTLY_S = 120.0
"""Real time within which it must end: three seconds on an idle computer, more beside other tests."""


async def test_a_script_that_does_not_end_in_the_air_ends_the_flight() -> None:
    async with asyncio.timeout(PROMPTLY_S):
        with pytest.raises(FlightTimeoutError, match=r"2 steps of the script are left, phase hold"):
            await fly([*QUICK_UP, until(Phase.TRACK), wait(1.0)], longest_s=9.0)


async def test_a_script_that_fails_in_the_air_ends_the_flight() -> None:
    def fail(_: Flight) -> Never:
        raise AssertionError("the test's own")

    async with asyncio.timeout(PROMPTLY_S):
        with pytest.raises(AssertionError, match="the test's own"):
            await fly([*QUICK_UP, fail])


async def test_a_loop_that_has_failed_and_cannot_land_ends_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def hang(flight: Flight) -> bool:
        monkeypatch.setattr(type(flight.loop._giving_up), "_waits", lambda *_: True)
        return True

    async with asyncio.timeout(PROMPTLY_S):
        with pytest.raises(FlightTimeoutError, match="the loop has failed and is not done with it, phase handed over"):
            await fly([*QUICK_UP, hang, wait(60.0)], mocap_lost_at_s=9.0, longest_s=10.0)
