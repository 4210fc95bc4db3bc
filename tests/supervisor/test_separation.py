"""Paths of this vehicle and of others: where they lead, how near they come, and what is said of a requested one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import OtherVehicle, Vec3, VehicleState
from companion.guard.geofence import Fence
from companion.guard.separation import Separation
from companion.supervisor.flight_state import (
    ArmRequest,
    FlightInputs,
    HoldRequest,
    LandRequest,
    Phase,
    ResumeRequest,
    TakeoffRequest,
    TrackRequest,
)
from companion.supervisor.landing_place import landing_place
from companion.supervisor.separation import (
    STEP_S,
    SeparationRules,
    ahead_of,
    least_gap_m,
    objection,
    stopped,
    stopping_path,
)
from companion.supervisor.state_machine import advance, reference_at, refusal
from companion.supervisor.way_ahead import NO_WAY, way_ahead
from companion.trajectories.reference import Ellipse, Hold
from tests.supervisor.flown import DT_S, GROUND, STATES, apply_request, facts, hovering
from tests.supervisor.flown import RULES as ALONE

CYLINDER = Separation(radius_m=1.2, height_m=1.6, parked_height_m=1.0, braking_mps2=2.0, reaction_s=0.4)
CLEAR = CYLINDER.widened(0.3)
FENCE = Fence((-4.0, -4.0), (6.0, 6.0, 3.5))
RULES = replace(ALONE, keep_clear=CLEAR, land_clear=CYLINDER.widened(0.1), land_inside=FENCE)
STILL: Vec3 = (0.0, 0.0, 0.0)


def other(place: Vec3, velocity: Vec3 = STILL, parked: bool = False, unseen_s: float = 0.0) -> OtherVehicle:
    return OtherVehicle(body="two", position_w_m=place, velocity_w_mps=velocity, parked=parked, unseen_s=unseen_s)


NEVER = other((math.nan,) * 3, (math.nan,) * 3, unseen_s=math.inf)

# --- paths ---


def test_a_vehicle_goes_on_or_stops() -> None:
    moves = other((1.0, 2.0, 3.0), (0.6, -0.8, 0.0))
    assert ahead_of(moves, 2.0) == pytest.approx((2.2, 0.4, 3.0))
    assert stopped(moves, CYLINDER) == pytest.approx((1.0 + 0.6 * 0.65, 2.0 - 0.8 * 0.65, 3.0))
    assert stopped(other((1.0, 2.0, 3.0)), CYLINDER) == (1.0, 2.0, 3.0)


def test_a_stop_is_as_long_as_reaction_and_brake_and_then_it_stands() -> None:
    path = stopping_path(STILL, (2.0, 0.0, -1.0), CYLINDER, 4.0)
    assert len(path) == round(4.0 / STEP_S) + 1
    assert path[0] == STILL
    stop_s = 0.8 + math.sqrt(5.0) / 2.0
    assert path[-1] == path[-2] == pytest.approx((stop_s, 0.0, -0.5 * stop_s))
    assert [x for x, _, _ in path] == sorted(x for x, _, _ in path)
    assert set(stopping_path(STILL, STILL, CYLINDER, 1.0)) == {STILL}


def test_the_least_gap_is_also_looked_for_between_two_points() -> None:
    """At 3 m/s towards each other two vehicles have passed between two points of the path."""
    path = tuple((3.0 * k * STEP_S, 0.0, 1.0) for k in range(11))
    comes = other((3.0 * STEP_S, 0.1, 1.0), (-3.0, 0.0, 0.0))
    assert least_gap_m(path, comes, CYLINDER) == pytest.approx(0.1 - 1.2)
    assert least_gap_m(path[:1], other((0.0, 2.0, 1.0)), CYLINDER) == pytest.approx(0.8)


def test_who_yields_to_whom() -> None:
    rules = SeparationRules(cylinder=CYLINDER, first=frozenset({"two"}))
    assert rules.yields_to(other(STILL))
    assert not SeparationRules(cylinder=CYLINDER).yields_to(other(STILL))
    assert SeparationRules(cylinder=CYLINDER).yields_to(other(STILL, parked=True))


# --- requested paths ---

LINE = tuple((0.1 * k, 0.0, 1.0) for k in range(101))
"""10 m along x, a point every 0.1 s."""


def said(there: OtherVehicle, path: tuple[Vec3, ...] = LINE) -> str:
    return objection(path, 0.1, [NEVER, there], CLEAR, 2.5)


@pytest.mark.parametrize(("y_m", "free"), [(1.51, True), (-1.51, True), (1.49, False), (-1.49, False)])
def test_a_path_keeps_away_from_one_that_stands(y_m: float, free: bool) -> None:
    assert (said(other((9.0, y_m, 1.0))) == "") is free


def test_the_objection_says_how_near_to_whom_and_what_to_do() -> None:
    assert said(other((5.0, 1.2, 1.0))) == (
        "this way leads within 1.20 m of 'two', which flies at 5.0 1.2 1.0; at least 1.50 m are needed: keep away from "
        "it, or wait until it is gone"
    )
    assert "which stands at" in said(other((5.0, 1.2, 0.1), parked=True))


def test_a_parked_one_may_be_flown_over() -> None:
    assert said(other((5.0, 0.0, -0.31), parked=True)) == ""
    assert said(other((5.0, 0.0, -0.29), parked=True)) != ""
    assert said(other((5.0, 0.0, -0.31))) != ""


def test_one_that_moves_is_only_foreseen_for_a_while() -> None:
    crosses = other((2.0, -2.0, 1.0), (0.0, 1.0, 0.0))
    assert said(crosses) != ""
    assert said(other((4.1, 0.0, 1.0), (0.0, 0.3, 0.0))) == "", "who knows where it will be then"
    assert said(other((4.1, 0.0, 1.0), (0.0, 0.1, 0.0))) != "", "it hovers"


def test_a_path_may_lead_out_of_the_margin_but_not_end_in_it() -> None:
    assert said(other((-1.3, 0.0, 1.0))) == ""
    assert said(other((1.3, 0.0, 1.0))) != "", "nearer first"
    assert said(other((-1.3, 0.0, 1.0)), LINE[:2]) != "", "it stays there"
    assert said(other((0.0, 1.3, 1.0)), ((0.0, 0.0, 1.0),)) != ""


# --- requests ---


def with_others(inputs: FlightInputs, *others: OtherVehicle, pushed: bool = False) -> FlightInputs:
    return replace(inputs, others=others, pushed=pushed)


def above_ground(x_m: float, y_m: float, z_m: float) -> Vec3:
    """A place relative to where the vehicle took off."""
    x, y, z = GROUND.tolist()
    return x + x_m, y + y_m, z + z_m


BESIDE = other(above_ground(1.4, 0.0, 0.0), parked=True)
AWAY = other(above_ground(1.6, 0.0, 0.0), parked=True)
ABOVE = other(above_ground(0.0, 0.5, 2.5))


@pytest.mark.parametrize(("there", "free"), [(BESIDE, False), (AWAY, True), (ABOVE, False), (NEVER, True)])
def test_a_takeoff_beside_or_below_another_one_is_rejected(there: OtherVehicle, free: bool) -> None:
    reason = refusal(STATES["armed"][0], TakeoffRequest(1.0), with_others(facts(9.0), there), RULES)
    assert (reason == "") is free
    assert free or reason.startswith("another vehicle is in the way: this way leads within ")
    assert refusal(STATES["armed"][0], TakeoffRequest(1.0), with_others(facts(9.0), there), ALONE) == ""


def test_a_takeoff_stays_below_one_that_is_high_enough() -> None:
    high = other(above_ground(0.0, 0.5, 3.0))
    assert refusal(STATES["armed"][0], TakeoffRequest(1.0), with_others(facts(9.0), high), RULES) == ""


@pytest.mark.parametrize(("x_m", "free"), [(1.4, False), (1.6, True)])
def test_a_trajectory_its_approach_and_its_end_keep_away_from_another_one(x_m: float, free: bool) -> None:
    flight, time_s = hovering()
    inputs = facts(time_s, 1.0)
    x, y, z = inputs.position_w_m.tolist()
    goal = TrackRequest(Hold(np.array([x + 3.0, y, z])), 0.0)
    for there in (other((x + 3.0 + x_m, y, z)), other((x + 1.5, y + x_m, z))):
        assert (refusal(flight, goal, with_others(inputs, there), RULES) == "") is free
    lap = TrackRequest(Ellipse(np.array([x, y, z])), 1.0)
    assert refusal(flight, lap, with_others(inputs, other((x, y, z + 3.0))), RULES) == ""


def test_only_the_begin_of_a_long_trajectory_is_looked_at() -> None:
    flight, time_s = hovering()
    x, y, z = facts(time_s, 1.0).position_w_m.tolist()
    far = TrackRequest(Hold(np.array([x + 20.0, y, z])), 0.0)
    assert refusal(flight, far, with_others(facts(time_s, 1.0), other((x + 20.0, y, z))), RULES) == ""
    assert refusal(flight, far, with_others(facts(time_s, 1.0), other((x + 1.6, y, z))), RULES) != ""


def test_a_vehicle_is_not_taken_back_beside_another_one_but_lands_and_holds_everywhere() -> None:
    near = other(above_ground(1.3, 0.0, 1.0))
    assert "at least 1.50 m" in refusal(
        STATES["handed over"][0], ResumeRequest(), with_others(facts(9.0, 1.0), near), RULES
    )
    flight, time_s = hovering()
    for request in (LandRequest(), HoldRequest()):
        assert refusal(flight, request, with_others(facts(time_s, 1.0), near), RULES) == ""
    assert refusal(STATES["standby"][0], ArmRequest(), with_others(facts(9.0), BESIDE), RULES) == ""


# --- the way ahead ---

SHARED = SeparationRules(cylinder=CYLINDER, first=frozenset({"two"}))


def vehicle_at(place: Vec3, velocity: Vec3 = STILL) -> VehicleState:
    return VehicleState(0.0, np.array(place), np.array(velocity), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))


def test_the_way_ahead_is_that_of_the_reference() -> None:
    flight, time_s = hovering()
    flight = apply_request(flight, TrackRequest(Hold(np.array([4.0, 2.0, 1.0])), 0.0), facts(time_s, 1.0), ALONE)
    at_s = time_s + 3.0
    x, y, z = reference_at(flight, at_s).position_w_m.tolist()
    way = way_ahead(flight, at_s, vehicle_at((x, y, z)), [other((x + 2.0, y, z))], SHARED, 2.5)
    assert len(way.path_w_m) == 11
    for index, point in enumerate(way.path_w_m):
        assert point == tuple(reference_at(flight, at_s + index * STEP_S).position_w_m.tolist())
    velocity = reference_at(flight, at_s).velocity_w_mps
    assert way.rest_w_m[0] - x == pytest.approx(0.4 * float(velocity[0]), abs=1e-9)
    first = way_ahead(
        flight, at_s, vehicle_at((x, y, z)), [other((x + 2.0, y, z))], replace(SHARED, first=frozenset()), 2.5
    )
    assert (first.path_w_m, first.rest_w_m) == ((), way.rest_w_m)
    pushed = way_ahead(flight, at_s, vehicle_at((x - 0.08, y, z)), [other((x + 2.0, y, z))], SHARED, 2.5)
    assert way.rest_w_m[0] - pushed.rest_w_m[0] == pytest.approx(0.08), "the guard has pushed it"
    assert pushed.path_w_m == way.path_w_m


@pytest.mark.parametrize(
    ("distance_m", "own", "theirs", "seen"),
    [
        (4.69, STILL, STILL, True),  # 1.2 m, 1 m, and 2.5 s at 1 m/s
        (4.71, STILL, STILL, False),
        (7.19, (2.0, 0.0, 0.0), STILL, True),
        (9.69, (2.0, 0.0, 0.0), (0.0, -1.0, 0.0), True),
        (9.71, (2.0, 0.0, 0.0), (0.0, -1.0, 0.0), False),
    ],
)
def test_others_out_of_reach_cost_nothing(distance_m: float, own: Vec3, theirs: Vec3, seen: bool) -> None:
    flight, time_s = hovering()
    there = other((distance_m, 0.0, 1.0), theirs)
    way = way_ahead(flight, time_s, vehicle_at((0.0, 0.0, 1.0), own), [NEVER, there], SHARED, 2.5)
    assert (way is not NO_WAY) is seen


# --- landing beside another one ---


def test_above_nobody_it_lands_where_it_is() -> None:
    here = (1.0, 2.0, 1.5)
    assert landing_place(here, [NEVER, other((3.0, 2.0, 0.1))], CYLINDER, FENCE, 0.3) == here


def test_above_a_parked_one_it_lands_straight_away_from_it() -> None:
    place = landing_place((1.3, 2.0, 1.5), [other((1.0, 2.0, 0.1), parked=True)], CYLINDER, FENCE, 0.3)
    assert place == pytest.approx((2.25, 2.0, 1.5))
    exactly = landing_place((1.0, 2.0, 1.5), [other((1.0, 2.0, 0.1), parked=True)], CYLINDER, FENCE, 0.3)
    assert math.dist(exactly[:2], (1.0, 2.0)) == pytest.approx(1.25)


@pytest.mark.parametrize(
    ("z_m", "parked", "aside"), [(0.69, False, True), (0.71, False, False), (0.99, True, True), (1.01, True, False)]
)
def test_beside_one_at_its_own_height_it_goes_straight_down(z_m: float, parked: bool, aside: bool) -> None:
    here = (1.3, 2.0, 1.5)
    place = landing_place(here, [other((1.0, 2.0, z_m), parked=parked)], CYLINDER, FENCE, 0.3)
    assert (place != here) is aside


def test_it_stays_clear_of_all_others_and_of_the_fence() -> None:
    here, below = (5.5, 0.0, 1.5), other((5.4, 0.0, 0.1), parked=True)
    third = other((5.4, 2.0, 0.1), parked=True)
    place = landing_place(here, [below, third], CYLINDER, FENCE, 0.3)
    assert place[0] <= 5.7
    assert place[1] < 0.0
    assert all(math.dist(place[:2], one.position_w_m[:2]) >= 1.2 for one in (below, third))


def test_it_does_not_go_to_where_another_one_hovers() -> None:
    """The guard would stop it beside that one, above the one below, until PX4 lands it there."""
    here, below = (1.0, 2.1, 2.2), other((1.0, 2.0, 0.1), parked=True)
    straight = landing_place(here, [below], CYLINDER, FENCE, 0.3)
    assert straight == pytest.approx((1.0, 3.25, 2.2))
    hovers, high = other((1.0, 3.7, 2.2)), other((1.0, 3.7, 3.85))
    assert landing_place(here, [below, high], CYLINDER, FENCE, 0.3) == straight
    place = landing_place(here, [below, hovers], CYLINDER, FENCE, 0.3)
    assert all(math.dist(place[:2], one.position_w_m[:2]) >= 1.2 for one in (below, hovers))
    assert math.dist(place, here) < 1.5
    around = [other((1.0 + 1.25 * math.cos(at), 2.0 + 1.25 * math.sin(at), 2.2)) for at in (0.0, 1.5, 3.0, 4.5)]
    assert landing_place(here, [below, *around], CYLINDER, FENCE, 0.3) != here, "anything but the way down onto it"


def test_where_there_is_no_place_it_lands_where_it_is() -> None:
    narrow = Fence((-1.0, -1.0), (1.0, 1.0, 3.5))
    assert landing_place((0.0, 0.0, 1.5), [other((0.1, 0.0, 0.1))], CYLINDER, narrow, 0.3) == (0.0, 0.0, 1.5)


def test_a_landing_leads_aside_first_and_takes_so_much_longer() -> None:
    flight, time_s = hovering()
    inputs = facts(time_s, 1.0)
    x, y, _ = inputs.position_w_m.tolist()
    alone = apply_request(flight, LandRequest(), inputs, RULES)
    below = other((x + 0.1, y, 0.1), parked=True)
    aside = apply_request(flight, LandRequest(), with_others(inputs, below), RULES)
    assert [leg.phase for leg in aside.legs] == [Phase.LAND, Phase.LAND]
    move, down = aside.legs
    assert aside.landing_due_s == pytest.approx(alone.landing_due_s + move.trajectory.duration_s)
    end = move.trajectory.at(move.trajectory.duration_s)
    assert end.position_w_m == pytest.approx(
        (x + 0.1 - 1.35, y, reference_at(flight, time_s).position_w_m[2]), abs=1e-6
    )
    assert down.trajectory.at(0.0).position_w_m == pytest.approx(end.position_w_m)
    assert down.trajectory.at(3.0).position_w_m[:2] == pytest.approx(end.position_w_m[:2])
    assert (
        apply_request(flight, LandRequest(), with_others(inputs, below), ALONE).legs[0].trajectory.at(0.0) is not None
    )
    beside = other((x + 1.4, y, 0.1), parked=True)
    assert len(apply_request(flight, LandRequest(), with_others(inputs, beside), RULES).legs) == 1
    unfenced = replace(RULES, land_inside=None)
    assert len(apply_request(flight, LandRequest(), with_others(inputs, below), unfenced).legs) == 1


# --- pushed away by the guard ---


def moved(inputs: FlightInputs, by_m: float, pushed: bool = True) -> FlightInputs:
    return replace(inputs, position_w_m=inputs.position_w_m + np.array([by_m, 0.0, 0.0]), pushed=pushed)


@pytest.mark.parametrize(("by_m", "pushed", "follows"), [(0.31, True, True), (0.29, True, False), (0.6, False, False)])
def test_a_hold_follows_a_vehicle_that_is_pushed_away(by_m: float, pushed: bool, follows: bool) -> None:
    flight, time_s = hovering()
    since_s = flight.since_s
    there = reference_at(flight, time_s + DT_S).position_w_m
    inputs = replace(facts(time_s + DT_S, 1.0), position_w_m=there)
    after = advance(flight, moved(inputs, by_m, pushed), RULES)
    now = reference_at(after, time_s + DT_S).position_w_m
    assert now == pytest.approx(there + np.array([by_m if follows else 0.0, 0.0, 0.0]))
    assert (after.phase, after.since_s) == (Phase.HOLD, since_s)


def test_a_landing_follows_too_and_a_flight_to_a_place_does_not() -> None:
    flight, time_s = hovering()
    landing = apply_request(flight, LandRequest(), facts(time_s, 1.0), RULES)
    there = reference_at(landing, time_s + DT_S).position_w_m
    inputs = replace(facts(time_s + DT_S, 1.0), position_w_m=there)
    after = advance(landing, moved(inputs, 0.5), RULES)
    assert after.phase is Phase.LAND
    assert reference_at(after, time_s + DT_S).position_w_m[0] == pytest.approx(there[0] + 0.5)
    assert (after.since_s, after.landing_due_s) == (landing.since_s, landing.landing_due_s)
    going = apply_request(flight, TrackRequest(Hold(np.array([4.0, 2.0, 1.0])), 0.0), facts(time_s, 1.0), RULES)
    assert advance(going, moved(inputs, 0.5), RULES).legs == going.legs
    grounded = replace(landing, airborne=False, touched_down=True)
    assert advance(grounded, moved(inputs, 0.5), RULES).legs == landing.legs


@pytest.mark.parametrize(
    ("speed_mps", "ahead_m"),
    [
        (0.0, 0.0),
        (0.5, 0.2),  # it rests 0.4 s further
        (2.0, 0.4),  # and would be 1.5 m further: so far from the reference is a fault
        (-0.5, None),  # it returns
    ],
)
def test_a_hold_waits_where_a_pushed_vehicle_comes_to_rest(speed_mps: float, ahead_m: float | None) -> None:
    flight, time_s = hovering()
    there = reference_at(flight, time_s + DT_S).position_w_m
    inputs = replace(facts(time_s + DT_S, 1.0), position_w_m=there, velocity_w_mps=np.array([speed_mps, 0.0, 0.0]))
    after = advance(flight, moved(inputs, 0.5), RULES)
    expected = 0.0 if ahead_m is None else 0.5 + ahead_m
    for later_s in (DT_S, 5.0):
        now = reference_at(after, time_s + later_s)
        assert now.position_w_m == pytest.approx(there + np.array([expected, 0.0, 0.0]))
        assert now.velocity_w_mps.tolist() == [0.0, 0.0, 0.0]
