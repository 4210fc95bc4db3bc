"""Two vehicles in one simulated room: head-on, crossing, over a parked one, and beside one whose service stops."""

import asyncio
import math
import pathlib
from dataclasses import replace

import numpy as np
import pytest

from companion.analysis.replay.laws import config_of, laws_of
from companion.analysis.replay.rerun import replay
from companion.analysis.report.charts import Medium
from companion.analysis.report.figures import charts_of
from companion.analysis.report.numbers import numbers_of
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.report.separation import separation_table
from companion.analysis.report.story import story_of
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_path
from companion.config.flight_config import RoomConfig
from companion.config.safety_config import FenceConfig
from companion.config.separation_config import SeparationConfig
from companion.core.types import Array
from companion.records.read import FlightRecord, read_flight
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import LandRequest, Phase, TrackRequest
from companion.supervisor.state_machine import reference_at
from companion.trajectories.reference import Hold
from tests.flights.faults.rows import RULES
from tests.flights.faults.table_traffic import OTHER, Path, another
from tests.flights.simulated import BRISK, Flight, Step, fly
from tests.flights.simulated_fleet import FleetFlight, fleet_config, fly_fleet
from tests.flights.test_simulated_flights import QUICK_UP, ask, until, wait
from tests.records.test_round_trip import written

pytestmark = pytest.mark.slow

CONFIG = CompanionConfig(flight=BRISK.model_copy(update={"climb_speed_mps": 1.5}))
RADIUS_M, HEIGHT_M, PARKED_M = CONFIG.separation.radius_m, 1.6, 1.0
LOW = SeparationConfig(order=(CONFIG.mocap.body, OTHER), height_m=HEIGHT_M, parked_height_m=PARKED_M)
MAY_CROSS_ABOVE = CONFIG.model_copy(update={"separation": LOW})


def go_to(x_m: float, y_m: float, z_m: float = 1.2) -> TrackRequest:
    return TrackRequest(Hold(np.array([x_m, y_m, z_m])), 0.0)


def at(time_s: float) -> Step:
    return lambda flight: flight.room.now_s() >= time_s


def flown(
    *scripts: list[Step], apart_m: float = 6.0, longest_s: float = 40.0, config: CompanionConfig = CONFIG
) -> FleetFlight:
    """Fly vehicles that start on a row along y, so far apart."""
    tables = {"fleet": {"spacing_m": apart_m}}
    return asyncio.run(fly_fleet(scripts, config=config, tables=tables, step_s=0.004, longest_s=longest_s))


def gaps_m(fleet: FleetFlight, height_m: float = CONFIG.separation.height_m) -> Array:
    """True distances of the first two vehicles to each other's cylinder, tick by tick; negative inside."""
    one, two = (np.array(flight.truths_w_m) for flight in fleet.flights)
    count = min(len(one), len(two))
    off = one[:count] - two[:count]
    return np.asarray(np.maximum(np.hypot(off[:, 0], off[:, 1]) - RADIUS_M, np.abs(off[:, 2]) - height_m))


def levels(flight: Flight) -> list[tuple[FailsafeAction, Fault | None]]:
    """Return the failsafe actions that were taken, in order."""
    return list(dict.fromkeys((t.flight.level, t.flight.cause) for t in flight.ticks if t.flight.level))


HELD = (FailsafeAction.HOLD, Fault.TRAFFIC)


@pytest.fixture(scope="module")
def head_on() -> FleetFlight:
    """Each to where the other one is, as far as it may; both begin at the same time."""
    first = [*QUICK_UP, at(8.0), ask(go_to(0.0, 1.45)), at(22.0)]
    second = [*QUICK_UP, at(8.0), ask(go_to(0.0, -1.45)), until(Phase.DISARMED), wait(0.2)]
    return flown(first, second)


def test_head_on_both_stop_and_the_one_that_yields_lands(head_on: FleetFlight) -> None:
    first, second = head_on.flights
    assert gaps_m(head_on).min() > 0.0
    assert levels(first) == [HELD]
    assert levels(second) == [HELD, (FailsafeAction.LAND, Fault.TRAFFIC_BLOCKED)]
    held_s = next(tick.time_s for tick in first.ticks if tick.flight.level is FailsafeAction.HOLD)
    down_s = next(tick.time_s for tick in second.ticks if tick.flight.touched_down)
    assert down_s - held_s < 10.0, "the way is free again"
    assert not any(event.fault is Fault.TRACKING_ERROR for tick in first.ticks for event in tick.events)


def test_crossing_the_one_that_yields_holds_and_the_first_one_flies_on() -> None:
    crossing = flown(
        [*QUICK_UP, at(8.0), ask(go_to(3.0, 2.2)), until(Phase.TRACK), wait(0.2)],
        [*QUICK_UP, at(8.0), ask(go_to(3.0, -2.2)), at(14.0)],
    )
    first, second = crossing.flights
    assert gaps_m(crossing).min() > 0.3, "the first one has nothing to brake for"
    assert levels(first) == []
    assert levels(second) == [HELD]
    assert not any(bool(t.limited.separation_cut) for t in first.ticks if t.limited)


def test_nobody_flies_above_another_one() -> None:
    """PX4's own landing goes straight down: in a random flight it came down on a vehicle that had landed below."""
    refused: list[str] = []

    def over(flight: Flight) -> bool:
        refused.append(flight.loop.submit(go_to(0.1, 0.8, 2.9)))
        return True

    flown([*QUICK_UP, over], [at(0.5)], apart_m=1.6)
    (sentence,) = refused
    assert sentence.startswith(
        "another vehicle is in the way: this way leads within 0.10 m of 'dauam-2', which stands at "
    )


def test_where_the_cylinder_is_low_a_parked_one_is_flown_over_and_landed_beside() -> None:
    refused: list[str] = []

    def onto(flight: Flight) -> bool:
        refused.append(flight.loop.submit(go_to(0.0, 0.8)))
        return True

    up, over = ask(go_to(0.0, -0.8, 2.2)), ask(go_to(0.1, 0.8, 2.2))
    lands = [at(13.5), ask(LandRequest()), until(Phase.DISARMED), wait(0.2)]
    script = [*QUICK_UP, onto, up, at(10.0), over, *lands]
    fleet = flown(script, [at(0.5)], apart_m=1.6, config=MAY_CROSS_ABOVE)
    (sentence,) = refused
    assert sentence.startswith(
        "another vehicle is in the way: this way leads within 0.00 m of 'dauam-2', which stands at "
    )
    assert gaps_m(fleet, PARKED_M).min() > 0.05
    end_w_m = fleet.flights[0].truths_w_m[-1]
    assert math.dist(end_w_m[:2], (0.0, 0.8)) == pytest.approx(RADIUS_M + 0.15, abs=0.05)
    assert levels(fleet.flights[0]) == []


def test_beside_one_whose_service_stops_the_other_backs_away() -> None:
    """It flies at the first one at full speed when it falls silent, and PX4 lands it half a second later."""

    def freeze(_: Flight) -> bool:
        fleets[0].lockstep.freeze(1)
        return True

    fleets: list[FleetFlight] = []
    first = [*QUICK_UP, at(18.0)]
    second = [*QUICK_UP, at(8.0), ask(go_to(0.0, -1.45)), at(9.9), freeze]
    tables = {"fleet": {"spacing_m": 6.0}}
    flying = fly_fleet([first, second], config=CONFIG, tables=tables, step_s=0.004, longest_s=40.0, made=fleets.append)
    fleet = asyncio.run(flying)
    assert fleet.room.fleet.collisions == []
    assert gaps_m(fleet).min() > -0.1


INTRUDER_M = 1.07
"""Height at which another body flies under a vehicle that lands from twice that, by a rule of its own."""


def flies_under(flight: Flight) -> Path:
    x, y, _ = flight.room.truth_w_m.tolist()
    return lambda t: (x + min(1.16 * t, 8.0) - 4.0, y + 0.09, INTRUDER_M)


@pytest.mark.parametrize("landing", [True, False])
def test_who_is_pushed_up_climbs_no_higher_than_the_guard_asks(landing: bool) -> None:
    """The guard tilts it away, which lifts it; its reference must not go up with it and lift it again."""

    def intrude(flight: Flight) -> bool:
        another(flies_under)(flight)
        return True

    up = [*QUICK_UP, ask(go_to(0.0, 0.0, 2.2)), wait(4.0), intrude, wait(2.3)]
    ends = [ask(LandRequest()), until(Phase.DISARMED)] if landing else [wait(6.0)]
    flight = asyncio.run(fly([*up, *ends], controller="practical", config=MAY_CROSS_ABOVE, longest_s=40.0))
    assert any(bool(tick.limited.separation_cut) for tick in flight.ticks if tick.limited)
    flies = [tick for tick in flight.ticks if tick.flight.airborne]
    clear_m = INTRUDER_M + HEIGHT_M
    assert max(reference_at(tick.flight, tick.time_s).position_w_m[2] for tick in flies) < clear_m
    assert max(truth_w_m[2] for truth_w_m in flight.truths_w_m) < clear_m + RULES.yield_margin_m
    assert all(tick.flight.level <= FailsafeAction.HOLD for tick in flight.ticks)


def test_a_landing_without_a_free_place_waits_above_another_one_until_it_is_gone() -> None:
    """PX4, to which a landing is handed over that is overdue, would land on it."""
    narrow = {
        "fence": FenceConfig(x_m=(-1.2, 1.2), y_m=(-1.2, 1.2)),
        "room": RoomConfig(x_m=(-0.9, 0.9), y_m=(-0.9, 0.9)),
    }
    config = CompanionConfig.model_validate({**dict(MAY_CROSS_ABOVE), **narrow})
    leaves_s, left = 27.0, 0.0

    def hovers_below(flight: Flight) -> Path:
        x, y, z = flight.room.truth_w_m.tolist()
        return lambda t: (x + 0.1 + min(max(t - leaves_s, 0.0), 4.0), y, z - 2.0)

    def intrude(flight: Flight) -> bool:
        nonlocal left
        left = flight.room.now_s() + leaves_s
        another(hovers_below)(flight)
        return True

    script = [*QUICK_UP, ask(go_to(0.0, 0.0, 2.6)), wait(4.0), intrude, ask(LandRequest()), until(Phase.DISARMED)]
    flight = asyncio.run(fly(script, controller="practical", config=config, longest_s=60.0))
    assert Phase.HANDED_OVER not in flight.phases()
    due_s = next(tick.flight.landing_due_s for tick in flight.ticks if tick.flight.phase is Phase.LAND)
    assert left - due_s > RULES.landing_s, "it would have been handed over"
    heights_m = [where[2] for tick, where in zip(flight.ticks, flight.truths_w_m, strict=True) if tick.time_s < left]
    assert min(heights_m[-1500:]) > 0.6 + HEIGHT_M, "the guard keeps it above"


def test_a_landing_beside_a_vehicle_that_hovers_is_clear_of_it() -> None:
    """It lands from above it, goes aside first, and passes it on its way down."""
    first = [*QUICK_UP, ask(go_to(0.0, -3.0, 0.6)), at(30.0)]
    over = [ask(go_to(0.0, -0.5, 2.6)), at(12.0), ask(go_to(0.0, -2.2, 2.6)), at(17.0)]
    second = [*QUICK_UP, *over, ask(LandRequest()), until(Phase.DISARMED), wait(0.2)]
    fleet = flown(first, second, config=MAY_CROSS_ABOVE)
    assert gaps_m(fleet, HEIGHT_M).min() > 0.0
    hovers, landed = fleet.flights
    assert levels(hovers) == levels(landed) == []
    assert landed.truths_w_m[-1][2] < 0.05
    beside_m = math.dist(landed.truths_w_m[-1][:2], hovers.truths_w_m[-1][:2])
    assert beside_m == pytest.approx(RADIUS_M + 0.15, abs=0.05)
    lost = [event for flight in fleet.flights for tick in flight.ticks for event in tick.events]
    assert Fault.SEPARATION_LOST not in {event.fault for event in lost}


# --- its record ---


@pytest.fixture(scope="module")
def record(head_on: FleetFlight, tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    """The record of the one that yields."""
    config = fleet_config(head_on.room.fleet.names, 1, CONFIG)
    laws = {"practical": controller_path("practical").read_text(encoding="utf-8")}
    ticks = [replace(tick, law="practical") for tick in head_on.flights[1].ticks]
    begin = {"config": config.model_dump(mode="json"), "laws": laws, "unix_offset_s": 0.0}
    folder: pathlib.Path = tmp_path_factory.mktemp("records")
    (path,) = written(folder, ticks, begin)
    return read_flight(path)


def test_a_replay_among_others_is_identical_to_the_last_bit(record: FlightRecord) -> None:
    config = config_of(record)
    done = replay(record, config, laws_of(record, config))
    assert done.identical, [one for one in done.differences.values() if one.differ]
    assert record.columns["cut_separation"].any(), "the guard had something to do"
    assert done.differences["setpoint attitude"].compared > 500


def test_the_report_shows_how_near_the_other_one_came(record: FlightRecord, head_on: FleetFlight) -> None:
    flight = Flown(record)
    (one,) = numbers_of(flight).others
    assert one.body == "dauam-1"
    assert one.gap_m == pytest.approx(float(gaps_m(head_on).min()), abs=0.03)
    assert one.unseen_s < 0.1
    table = separation_table((one,))
    assert table is not None
    assert separation_table(()) is None
    charts = {chart.name: chart for chart in charts_of(flight, story_of(flight))}
    (above,) = charts["others"].figure(Medium.PAGE).axes
    assert {line.get_label() for line in above.lines} >= {"flown", "dauam-1"}
    assert len(charts["separation"].figure(Medium.PAGE).axes) == 2
