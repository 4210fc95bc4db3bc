"""Several flight loops in one room, in simulated time: lockstep, frames, downwash, collisions."""

import math

import numpy as np
import pytest

from companion.supervisor.flight_state import Phase, TakeoffRequest, TrackRequest
from companion.trajectories.reference import Hold
from tests.flights.simulated import Step
from tests.flights.simulated_fleet import fleet_config, fly_fleet
from tests.flights.test_simulated_flights import QUICK_ARM, QUICK_UP, ask, until, wait

pytestmark = pytest.mark.slow


def go_to(x_m: float, y_m: float, z_m: float) -> Step:
    return ask(TrackRequest(Hold(np.array([x_m, y_m, z_m])), 0.0))


async def test_all_loops_tick_with_the_same_frames_and_the_same_seed_flies_the_same() -> None:
    scripts = [[*QUICK_ARM, ask(TakeoffRequest(1.2)), wait(2.7)], [*QUICK_ARM, wait(1.0)]]
    fleets = [await fly_fleet(scripts, seed=4) for _ in range(2)]
    first, again = (np.array([flight.truths_w_m for flight in fleet.flights]) for fleet in fleets)
    assert np.array_equal(first, again)
    one, two = fleets[0].flights
    assert first[0, -1, 2] > 0.03
    assert len(one.ticks) == len(two.ticks)
    for mine, yours in zip(one.ticks, two.ticks, strict=True):
        if mine.frame is not None and yours.frame is not None:
            assert mine.frame.frame == yours.frame.frame
            (other,) = mine.frame.others
            assert other.body == "dauam-2"
            assert other.position_w_m == tuple(yours.frame.position_w_m)
    assert one.ticks[-1].frame is not None


def test_each_vehicle_knows_the_order_and_its_own_body() -> None:
    config = fleet_config(("dauam-1", "dauam-2"), 1)
    assert config.mocap.body == "dauam-2"
    assert config.separation.order == ("dauam-1", "dauam-2")
    assert fleet_config(("dauam-1", "dauam-2"), 1, separated=False).separation.order == ()


async def test_two_that_meet_stop_their_motors() -> None:
    ended = [until(Phase.DISARMED), wait(0.5)]
    scripts = [[*QUICK_UP, *ended], [*QUICK_UP, go_to(0.0, -0.6, 1.2), *ended]]
    fleet = await fly_fleet(scripts, separated=False, tables={"fleet": {"spacing_m": 1.2}}, longest_s=30.0)
    assert [met.bodies for met in fleet.room.fleet.collisions] == [("dauam-1", "dauam-2")]
    for flight in fleet.flights:
        assert flight.room.bench.world.truth.on_ground
        assert not flight.ticks[-1].status.armed
        assert "motors stopped" in " ".join(text for _, text in flight.room.bench.texts())


async def test_one_that_hovers_in_the_wash_of_another_sinks_and_recovers() -> None:
    above = [*QUICK_UP, go_to(0.0, -0.8, 2.9), until(Phase.HOLD), go_to(0.0, 0.8, 2.9), until(Phase.HOLD), wait(2.5)]
    fleet = await fly_fleet([above, [*QUICK_UP, wait(11.5)]], separated=False, step_s=0.004, longest_s=30.0)
    upper, lower = fleet.flights
    hover = [n for n, tick in enumerate(lower.ticks) if tick.flight.phase is Phase.HOLD]
    height_m = np.array([lower.truths_w_m[n][2] for n in hover])
    beside_m = np.array([math.dist(upper.truths_w_m[n][:2], lower.truths_w_m[n][:2]) for n in hover])
    assert beside_m[-1] < 0.1
    calm, washed = height_m[beside_m > 1.5], height_m[beside_m < 1.0]
    assert np.abs(calm - 1.2).max() < 0.02
    assert 0.05 < 1.2 - washed.min() < 0.4
    assert abs(washed[-50:].mean() - 1.2) < 0.1
