"""Other vehicles: who holds, who lands, and when, at the limits; and that neighbours do not disturb each other."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import OtherVehicle, Vec3
from companion.guard.separation import Separation
from companion.supervisor.faults import Event, Fault, Stage
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.separation import STEP_S, SeparationRules
from tests.supervisor.observing import (
    RULES,
    faults,
    handed_over,
    healthy,
    on_ground,
    standing,
    watched,
    with_seen,
    with_status,
)

CYLINDER = Separation(radius_m=1.2, height_m=1.6, parked_height_m=1.0, braking_mps2=2.0, reaction_s=0.4)
LATER = SeparationRules(cylinder=CYLINDER, first=frozenset({"two"}))
"""Of the one that yields."""
FIRST = SeparationRules(cylinder=CYLINDER)
HERE: Vec3 = (0.5, -0.25, 1.0)
"""Place of the vehicle that `healthy` has."""
STILL: Vec3 = (0.0, 0.0, 0.0)
POINTS = round(RULES.yield_ahead_s / STEP_S) + 1


def other(
    x_m: float, y_m: float = 0.0, z_m: float = 0.0, velocity: Vec3 = STILL, unseen_s: float = 0.0, parked: bool = False
) -> OtherVehicle:
    """Another one, so far from the vehicle."""
    place = HERE[0] + x_m, HERE[1] + y_m, HERE[2] + z_m
    return OtherVehicle(body="two", position_w_m=place, velocity_w_mps=velocity, unseen_s=unseen_s, parked=parked)


def beside(cycle: int, *others: OtherVehicle, velocity: Vec3 = STILL) -> HealthInputs:
    """The vehicle, which flies on as it does, and would come to rest 0.4 s further."""
    x, y, z = HERE
    vx, vy, vz = velocity
    path = tuple((x + vx * k * STEP_S, y + vy * k * STEP_S, z + vz * k * STEP_S) for k in range(POINTS))
    now = healthy(cycle)
    assert now.mocap.vehicle is not None
    now = with_seen(now, vehicle=replace(now.mocap.vehicle, velocity_w_mps=np.array(velocity)))
    return replace(now, others=others, path_w_m=path, rest_w_m=(x + 0.4 * vx, y + 0.4 * vy, z + 0.4 * vz))


def found(separation: SeparationRules | None, *others: OtherVehicle, velocity: Vec3 = STILL) -> tuple[Event, ...]:
    return watched([beside(0, *others, velocity=velocity)], separation=separation)[0]


def kinds(separation: SeparationRules | None, *others: OtherVehicle, velocity: Vec3 = STILL) -> list[Fault]:
    return faults(found(separation, *others, velocity=velocity))


NOTHING: list[Fault] = []
EAST: Vec3 = (1.0, 0.0, 0.0)


def test_in_a_room_of_one_vehicle_nothing_is_looked_at() -> None:
    assert kinds(None, other(0.1)) == NOTHING
    assert kinds(LATER) == NOTHING


@pytest.mark.parametrize(("separation", "x_m", "holds"), [(FIRST, 1.69, True), (FIRST, 1.71, False)])
def test_the_first_one_holds_only_where_it_would_come_to_rest_too_near(
    separation: SeparationRules, x_m: float, holds: bool
) -> None:
    """At 1 m/s it comes to rest 0.4 m further, and 0.1 m are left to the cylinder."""
    assert kinds(separation, other(x_m), velocity=EAST) == ([Fault.TRAFFIC] if holds else NOTHING)


def test_it_says_who_is_where() -> None:
    assert found(FIRST, other(1.5, z_m=-0.25), velocity=EAST) == (
        Event(Fault.TRAFFIC, "'two' is 1.50 m away and 0.25 m lower, and the ways meet"),
    )
    (event,) = found(FIRST, other(1.5, z_m=0.5), velocity=EAST)
    assert "0.50 m higher" in event.text


def test_one_that_comes_is_counted_to_where_it_would_stop() -> None:
    """It needs 0.65 m from 1 m/s."""
    comes = (-1.0, 0.0, 0.0)
    assert kinds(FIRST, other(2.34, velocity=comes), velocity=EAST) == [Fault.TRAFFIC]
    assert kinds(FIRST, other(2.36, velocity=comes), velocity=EAST) == NOTHING


def test_one_that_goes_away_is_not_run_into_from_behind() -> None:
    """The front one does not stop for it: that would make it worse."""
    ahead = other(1.6, velocity=(0.5, 0.0, 0.0))
    assert kinds(FIRST, ahead, velocity=EAST) == [Fault.TRAFFIC]
    behind = other(-1.6, velocity=(1.0, 0.0, 0.0))
    assert kinds(LATER, behind, velocity=(0.5, 0.0, 0.0)) == NOTHING


@pytest.mark.parametrize(("x_m", "holds"), [(3.99, True), (4.01, False)])
def test_the_one_that_yields_holds_when_the_ways_meet_within_its_time(x_m: float, holds: bool) -> None:
    """In 2.5 s it flies 2.5 m, and 0.3 m are left to the cylinder."""
    expected = [Fault.TRAFFIC] if holds else NOTHING
    assert kinds(LATER, other(x_m), velocity=EAST) == expected
    assert kinds(FIRST, other(x_m), velocity=EAST) == NOTHING


def test_at_a_crossing_the_later_one_holds_and_the_first_one_passes() -> None:
    """Both would be at the crossing in 2.5 s."""
    north = (0.0, 1.0, 0.0)
    crosses = other(2.5, -2.5, velocity=north)
    assert kinds(LATER, crosses, velocity=EAST) == [Fault.TRAFFIC]
    assert kinds(FIRST, crosses, velocity=EAST) == NOTHING
    assert kinds(LATER, other(2.5, -6.0, velocity=north), velocity=EAST) == NOTHING, "it comes when this one is gone"
    assert kinds(LATER, other(2.5, -2.5, 1.95, velocity=north), velocity=EAST) == NOTHING, "above"


def test_who_crosses_faster_by_going_on_goes_on() -> None:
    """It is nearly through: holding would leave it in the other's way."""
    assert kinds(LATER, other(-0.9, -2.9, velocity=(0.0, 1.0, 0.0)), velocity=(1.2, 0.0, 0.0)) == NOTHING


def test_a_way_out_is_no_traffic_for_one_whose_reference_is_nearer_than_itself() -> None:
    """The guard has pushed it 0.25 m away from where it was to hover."""
    now = beside(0, other(1.34), velocity=(-0.1, 0.0, 0.0))
    nearer = tuple((x + 0.25, y, z) for x, y, z in now.path_w_m)
    assert watched([replace(now, path_w_m=nearer)], separation=LATER)[0] == ()
    comes = tuple((HERE[0] + 0.25 + 0.2 * k * STEP_S, *HERE[1:]) for k in range(POINTS))
    assert faults(watched([replace(now, path_w_m=comes)], separation=LATER)[0]) == [Fault.TRAFFIC]


def test_neighbours_that_hover_or_move_apart_do_not_disturb_each_other() -> None:
    for x_m in (1.31, 1.45, 1.6):
        assert kinds(LATER, other(x_m)) == NOTHING
        assert kinds(LATER, other(x_m), velocity=(-0.5, 0.0, 0.0)) == NOTHING
    assert kinds(LATER, other(1.6, velocity=(-0.04, 0.0, 0.0))) == NOTHING, "noise"
    assert kinds(LATER, other(3.0, velocity=(-1.0, 0.0, 0.0))) == NOTHING, "one that hovers gains nothing by a hold"


def test_to_a_parked_one_everybody_yields_and_flies_over_it_lower() -> None:
    assert kinds(FIRST, other(3.5, parked=True), velocity=EAST) == [Fault.TRAFFIC]
    assert kinds(FIRST, other(3.5, z_m=-1.31, parked=True), velocity=EAST) == NOTHING
    assert kinds(FIRST, other(3.5, z_m=-1.29, parked=True), velocity=EAST) == [Fault.TRAFFIC]


def test_without_a_way_ahead_only_what_is_near_counts() -> None:
    now = replace(beside(0, other(0.9)), path_w_m=(), rest_w_m=(math.nan, math.nan, math.nan))
    assert faults(watched([now], separation=LATER)[0]) == [Fault.SEPARATION_LOST]
    far = replace(beside(0, other(1.6)), path_w_m=(), rest_w_m=(math.nan, math.nan, math.nan))
    assert watched([far], separation=LATER) == [()]


# --- inside the cylinder ---


@pytest.mark.parametrize(
    ("separation", "stage", "fault"),
    [
        (LATER, Stage.FLYING, Fault.SEPARATION_LOST),
        (LATER, Stage.LANDING, Fault.SEPARATION_LOST),
        (FIRST, Stage.FLYING, Fault.TRAFFIC),
    ],
)
def test_inside_the_cylinder_the_later_one_lands_and_the_first_one_holds(
    separation: SeparationRules, stage: Stage, fault: Fault
) -> None:
    now = replace(beside(0, other(1.19)), stage=stage)
    assert watched([now], separation=separation) == [
        (Event(fault, "'two' is 1.19 m away and 0.00 m higher: inside its cylinder"),)
    ]
    assert watched([replace(beside(0, other(1.21)), stage=stage)], separation=separation) == [()]


def test_a_place_that_is_only_guessed_lands_nobody() -> None:
    """Its body is covered for a moment: where it would have flown on is no reason to land."""
    assert kinds(LATER, other(1.1, unseen_s=0.05)) == [Fault.SEPARATION_LOST]
    assert kinds(LATER, other(1.1, unseen_s=0.2)) == [Fault.TRAFFIC]


def test_while_it_lands_a_way_that_meets_is_no_news() -> None:
    now = replace(beside(0, other(1.5), velocity=EAST), stage=Stage.LANDING)
    assert watched([now], separation=LATER) == [()]


@pytest.mark.parametrize("separation", [LATER, FIRST])
def test_with_turning_rotors_on_the_ground_both_stop(separation: SeparationRules) -> None:
    now = replace(standing(beside(0, other(1.0))), path_w_m=(), rest_w_m=(math.nan, math.nan, math.nan))
    assert faults(watched([now], separation=separation)[0]) == [Fault.SEPARATION_LOST]
    assert watched([standing(beside(0, other(1.3), velocity=EAST))], separation=separation) == [()]
    assert watched([on_ground(beside(0, other(1.0)))], separation=separation) == [()], "nothing turns"


@pytest.mark.parametrize(
    ("there", "stops"),
    [
        (other(1.44), True),
        (other(1.46), False),
        (other(0.0, z_m=1.84), True),
        (other(0.0, z_m=1.86), False),
        (other(3.9, z_m=1.4, velocity=(-1.0, 0.0, 0.0)), True),
        (other(4.0, z_m=1.4, velocity=(-1.0, 0.0, 0.0)), False),
        (other(2.0, z_m=1.4, velocity=(1.0, 0.0, 0.0)), False),
        (other(1.3, parked=True), False),
    ],
)
def test_a_takeoff_ends_before_lift_off_if_another_one_comes(there: OtherVehicle, stops: bool) -> None:
    """It was far enough from one that is parked; of one that flies it must stay further away."""
    now = replace(standing(beside(0, there)), path_w_m=())
    assert watched([now], separation=FIRST) == [()]
    expected = [Fault.SEPARATION_LOST] if stops else []
    assert faults(watched([replace(now, taking_off=True)], separation=FIRST)[0]) == expected


def test_over_one_that_stands_less_height_is_needed() -> None:
    above = standing(beside(0, other(0.0, z_m=1.1)))
    assert watched([above], separation=LATER) == [()]
    assert faults(watched([standing(beside(0, other(0.0, z_m=0.9)))], separation=LATER)[0]) == [Fault.SEPARATION_LOST]
    landed = handed_over(beside(0, other(0.0, z_m=1.1)))
    assert faults(watched([landed], separation=LATER)[0]) == [Fault.SEPARATION_LOST], "PX4 flies it"
    assert watched([with_status(landed, in_air=False)], separation=LATER) == [()]


def test_who_does_not_know_its_own_place_judges_no_distance() -> None:
    old = with_seen(beside(0, other(1.0)), age_s=RULES.degraded_s)
    assert Fault.SEPARATION_LOST not in faults(watched([old], separation=LATER)[0])
    unknown = with_seen(beside(0, other(1.0)), vehicle=None)
    assert Fault.SEPARATION_LOST not in faults(watched([unknown], separation=LATER)[0])


# --- a way that is blocked ---

HELD = round(RULES.yield_s * 128)
"""Cycles after which a way counts as blocked."""


def blocked(flight: list[HealthInputs], separation: SeparationRules = LATER) -> list[int]:
    """Cycles in which a way is blocked."""
    events = watched(flight, separation=separation)
    return [number for number, found in enumerate(events) if Fault.TRAFFIC_BLOCKED in faults(found)]


def hovers(count: int, at: Callable[[int], OtherVehicle], velocity: Vec3 = STILL) -> list[HealthInputs]:
    return [beside(k, at(k), velocity=velocity) for k in range(count)]


def test_who_is_in_the_way_of_one_that_goes_first_lands_in_time() -> None:
    flight = hovers(HELD + 2, lambda _: other(1.49))
    assert blocked(flight) == [HELD, HELD + 1]
    assert watched(flight, separation=LATER)[HELD] == (
        Event(Fault.TRAFFIC_BLOCKED, "'two', which goes first, has been in the way for 3.0 s"),
    )
    assert blocked(flight, FIRST) == []
    assert blocked(hovers(HELD + 2, lambda _: other(1.51))) == []


def test_one_that_is_parked_does_not_wait() -> None:
    assert blocked(hovers(HELD + 2, lambda _: other(1.4, parked=True))) == []


def test_noise_at_the_edge_does_not_begin_the_time_again() -> None:
    assert blocked(hovers(HELD + 2, lambda k: other(1.49 if k % 7 else 1.59)))
    assert blocked(hovers(HELD + 2, lambda k: other(1.49 if k != 200 else 1.61))) == []


def test_who_leaves_is_not_in_the_way() -> None:
    assert blocked(hovers(HELD + 2, lambda _: other(1.4), velocity=(-0.3, 0.0, 0.0))) == []
    assert blocked(hovers(HELD + 2, lambda _: other(1.4), velocity=(-0.02, 0.0, 0.0)))
    without = [replace(now, path_w_m=()) for now in hovers(HELD + 2, lambda _: other(1.4))]
    assert blocked(without)


def test_on_the_ground_nobody_is_in_the_way() -> None:
    assert blocked([standing(now) for now in hovers(HELD + 2, lambda _: other(1.4))]) == []


def test_the_time_goes_on_while_the_own_place_is_not_known() -> None:
    flight = hovers(HELD + 2, lambda _: other(1.4))
    flight[100] = with_seen(flight[100], age_s=RULES.degraded_s)
    assert blocked(flight) == [HELD, HELD + 1]


# --- a body that is lost ---

LIMIT_S = RULES.other_unseen_s


def unseen(flight: list[HealthInputs]) -> list[bool]:
    return [Fault.OTHER_UNSEEN in faults(found) for found in watched(flight, separation=LATER)]


def test_a_vehicle_that_was_seen_in_this_flight_must_be_seen() -> None:
    lost = other(3.0, unseen_s=LIMIT_S + 0.01)
    assert unseen([beside(0, other(3.0)), beside(1, other(3.0, unseen_s=LIMIT_S)), beside(2, lost)]) == [
        False, False, True,
    ]  # fmt: skip
    assert watched([beside(0, other(3.0)), beside(1, lost)], separation=LATER)[1] == (
        Event(Fault.OTHER_UNSEEN, "'two' has not been seen for 0.5 s"),
    )


def test_one_that_comes_back_is_forgiven() -> None:
    lost = other(3.0, unseen_s=1.0)
    assert unseen([beside(0, other(3.0)), beside(1, lost), beside(2, other(3.0))]) == [False, True, False]


@pytest.mark.parametrize("unseen_s", [10.0, math.inf])
def test_one_that_was_not_there_when_the_flight_began_is_not_missed(unseen_s: float) -> None:
    gone = other(3.0, unseen_s=unseen_s)
    grounded = [on_ground(beside(k, other(3.0) if k == 0 else gone)) for k in range(3)]
    assert unseen([*grounded, beside(3, gone), beside(4, gone)]) == [False] * 5
    assert unseen([on_ground(beside(0, other(3.0))), beside(1, gone)]) == [False, True], "lost since"


def test_one_that_was_never_seen_is_nowhere() -> None:
    never = OtherVehicle(
        body="two", position_w_m=(math.nan,) * 3, velocity_w_mps=(math.nan,) * 3, unseen_s=math.inf
    )  # fmt: skip
    assert watched([beside(k, never, velocity=EAST) for k in range(HELD + 2)], separation=LATER) == [()] * (HELD + 2)


def test_a_lost_one_is_missed_also_while_the_own_place_is_not_known() -> None:
    old = with_seen(beside(1, other(3.0, unseen_s=1.0)), age_s=RULES.degraded_s)
    assert unseen([beside(0, other(3.0)), old]) == [False, True]


def test_disarmed_it_is_forgotten() -> None:
    lost = other(3.0, unseen_s=1.0)
    assert unseen([beside(0, other(3.0)), with_status(beside(1, lost), armed=False), beside(2, lost)]) == [False] * 3


# --- a landing that is overdue above another one ---


def overdue(cycle: int, overdue_s: float, *others: OtherVehicle) -> HealthInputs:
    now = beside(cycle, *others)
    return replace(now, stage=Stage.LANDING, landing_due_s=now.time_s - overdue_s)


def too_long(separation: SeparationRules | None, *flight: HealthInputs) -> bool:
    return Fault.LANDING_TOO_LONG in faults(watched(list(flight), separation=separation)[-1])


@pytest.mark.parametrize("separation", [FIRST, LATER])
@pytest.mark.parametrize(
    ("x_m", "z_m", "waits"), [(0.0, -2.0, True), (1.29, -2.0, True), (1.31, -2.0, False), (0.0, 2.0, False)]
)
def test_a_landing_above_another_one_is_not_handed_over(
    separation: SeparationRules, x_m: float, z_m: float, waits: bool
) -> None:
    there = other(x_m, z_m=z_m)
    assert too_long(separation, overdue(0, 20.0, there)) is not waits
    assert too_long(separation, overdue(0, 14.0, there)) is False
    assert too_long(None, overdue(0, 20.0, there)), "who looks out for nobody"


def test_its_time_goes_on_when_the_other_one_is_gone_and_does_not_wait_for_ever() -> None:
    below, gone = other(0.0, z_m=-2.0), other(5.0)
    now = overdue(0, 50.0, below)
    for after_s, late in ((14.5, False), (15.5, True)):
        last = replace(overdue(0, 0.0, gone), time_s=now.time_s + after_s, landing_due_s=now.landing_due_s)
        assert too_long(FIRST, now, last) is late
    assert not too_long(FIRST, overdue(0, 74.5, below))
    assert too_long(FIRST, overdue(0, 75.5, below))
    unseen = replace(below, position_w_m=(float("nan"),) * 3, unseen_s=float("inf"))
    assert too_long(FIRST, overdue(0, 20.0, unseen))
    assert too_long(FIRST, with_seen(overdue(0, 20.0, below), vehicle=None)), "nor is it known where it is itself"
