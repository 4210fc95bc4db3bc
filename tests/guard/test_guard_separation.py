"""The guard beside other vehicles: what passes to the last bit, what brakes, and what a corner of the fence does."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import AttitudeThrust, OtherVehicle, Vec3, VehicleState
from companion.geometry.attitude import accel_of_setpoint
from companion.guard.guard import AgeRange, Guard
from companion.guard.limits import LimitedSetpoint
from companion.guard.separation import Separation
from tests.guard.test_guard import FENCE, HOVER, LIMITS, MODEL, SLOPE, G, asking, at, same

CYLINDER = Separation()
AGES = AgeRange(0.05, 0.10)
ALONE = Guard(LIMITS, MODEL, FENCE, AGES)
BESIDE = Guard(LIMITS, MODEL, FENCE, AGES, separation=CYLINDER)
STILL: Vec3 = (0.0, 0.0, 0.0)
NAN: Vec3 = (math.nan, math.nan, math.nan)


def among(vehicle: VehicleState, *places: Vec3, velocity: Vec3 = STILL) -> VehicleState:
    others = tuple(OtherVehicle(body=f"v{n}", position_w_m=p, velocity_w_mps=velocity) for n, p in enumerate(places))
    return replace(vehicle, others=others)


def checked(
    wanted: AttitudeThrust, vehicle: VehicleState, age_s: float = 0.01, guard: Guard = BESIDE
) -> LimitedSetpoint:
    limited = guard.check(wanted, HOVER, vehicle, age_s, 10.0)
    assert limited.failure == ""
    return limited


def accel(limited: LimitedSetpoint) -> list[float]:
    return [float(a) for a in accel_of_setpoint(limited.setpoint, MODEL)]


def cuts(limited: LimitedSetpoint) -> tuple[bool, bool]:
    return bool(limited.separation_cut), bool(limited.fence_cut)


@given(
    wanted=st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0)),
    velocity=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-1.0, 1.0)),
    yaw_rad=st.floats(-3.0, 3.0),
)
def test_without_others_in_reach_nothing_changes_to_the_last_bit(wanted: Vec3, velocity: Vec3, yaw_rad: float) -> None:
    vehicle, setpoint = at((0.0, 0.0, 1.5), velocity), asking(*wanted, yaw_rad=yaw_rad)
    alone = checked(setpoint, vehicle, guard=ALONE)
    for beside in (vehicle, among(vehicle, NAN), among(vehicle, (30.0, 0.0, 1.0), (0.0, -30.0, 1.0))):
        assert same(checked(setpoint, beside), alone)


def test_one_beside_is_not_flown_into() -> None:
    vehicle = among(at((0.0, 0.0, 1.5)), (1.25, 0.0, 1.5))
    limited = checked(asking(2.0, 0.5, 0.3), vehicle)
    assert cuts(limited) == (True, False)
    x, y, z = accel(limited)
    assert x == pytest.approx(0.0, abs=1e-6), "5 cm before the cylinder, at rest"
    assert y == pytest.approx(0.5, abs=1e-6)
    assert z == pytest.approx(0.3, abs=1e-6)
    away = checked(asking(-2.0, 0.5, 0.3), vehicle)
    assert same(away, checked(asking(-2.0, 0.5, 0.3), at((0.0, 0.0, 1.5)), guard=ALONE))


def test_it_brakes_in_time_for_one_that_comes() -> None:
    vehicle = among(at((0.0, 0.0, 1.5), (1.0, 0.0, 0.0)), (2.2, 0.0, 1.5), velocity=(-1.0, 0.0, 0.0))
    assert accel(checked(HOVER, vehicle))[0] < -1.0
    far = among(at((0.0, 0.0, 1.5), (1.0, 0.0, 0.0)), (3.0, 0.0, 1.5), velocity=(-1.0, 0.0, 0.0))
    assert same(checked(HOVER, far), checked(HOVER, far, guard=ALONE))


def test_it_does_not_sink_onto_another_nor_climb_into_one() -> None:
    above = among(at((0.0, 0.0, 2.9)), (0.1, 0.0, 1.25))
    sinking = checked(asking(0.0, 0.0, -2.0), above)
    assert cuts(sinking) == (True, False)
    assert accel(sinking)[2] == pytest.approx(0.0, abs=0.01)
    below = among(at((0.0, 0.0, 1.25)), (0.1, 0.0, 2.9))
    assert accel(checked(asking(0.0, 0.0, 2.0), below))[2] == pytest.approx(0.0, abs=0.01)


def test_what_the_tilt_leaves_goes_to_braking() -> None:
    """It wants along the other with all that it has, and comes near it too fast."""
    vehicle = among(at((0.0, 0.0, 1.5), (2.0, 0.0, 0.0)), (1.5, 0.0, 1.5))
    x, y, _ = accel(checked(asking(0.0, 5.0, 0.0), vehicle))
    assert x == pytest.approx(-G * SLOPE, rel=1e-3)
    assert y == pytest.approx(0.0, abs=0.05)
    slower = among(at((0.0, 0.0, 1.5), (0.8, 0.0, 0.0)), (1.5, 0.0, 1.5))
    x, y, _ = accel(checked(asking(0.0, 5.0, 0.0), slower))
    assert -5.0 < x < -1.0
    assert math.hypot(x, y) == pytest.approx(G * SLOPE, rel=1e-3)


def test_in_a_corner_it_slides_along_the_fence_away_from_the_other() -> None:
    """The other one comes from inside at an angle: backing away would lead through the face of the fence."""
    vehicle = among(at((4.45, 0.0, 1.5)), (3.65, -0.8, 1.5))
    limited = checked(HOVER, vehicle)
    assert cuts(limited) == (True, True)
    x, y, _ = accel(limited)
    assert x == pytest.approx(0.0, abs=1e-6), "5 cm before the face, at rest"
    assert y > 2.0


def test_between_fence_and_another_the_fence_counts() -> None:
    vehicle = among(at((4.45, 0.0, 1.5)), (3.4, 0.0, 1.5))
    x, _, _ = accel(checked(HOVER, vehicle))
    assert x == pytest.approx(0.0, abs=1e-6)
    pressed_up = among(at((0.0, 0.0, 3.45)), (0.0, 0.0, 2.5))
    assert accel(checked(HOVER, pressed_up))[2] == pytest.approx(0.0, abs=1e-6)


def test_one_between_two_that_come_stays_where_it_is() -> None:
    vehicle = among(at((0.0, 0.0, 1.5)), (1.2, 0.0, 1.5), (-1.2, 0.0, 1.5))
    x, y, _ = accel(checked(HOVER, vehicle))
    assert x == pytest.approx(0.0, abs=1e-6)
    assert y == pytest.approx(0.0, abs=1e-6)


def test_an_old_state_brakes_for_nobody() -> None:
    vehicle = among(at((0.0, 0.0, 1.5)), (1.0, 0.0, 1.5))
    assert same(checked(HOVER, vehicle, age_s=0.2), checked(HOVER, vehicle, age_s=0.2, guard=ALONE))
    half = checked(asking(2.0, 0.0, 0.0), vehicle, age_s=0.075)
    assert bool(half.separation_cut)
    assert bool(half.age_cut)


anything = st.floats(allow_nan=True, allow_infinity=True)
any_place = st.tuples(anything, anything, anything)


@given(
    places=st.lists(st.tuples(any_place, any_place, st.booleans()), max_size=3), position=any_place, velocity=any_place
)
def test_nothing_that_is_seen_of_others_breaks_it(
    places: list[tuple[Vec3, Vec3, bool]], position: Vec3, velocity: Vec3
) -> None:
    others = tuple(OtherVehicle(body="x", position_w_m=p, velocity_w_mps=v, parked=k) for p, v, k in places)
    state = VehicleState(0.0, np.array(position), np.array(velocity), HOVER.q_w_flu_wxyz, np.zeros(3), others)
    limited = BESIDE.check(asking(1.0, 1.0, 0.0), HOVER, state, 0.01, 0.01)
    assert np.isfinite(limited.setpoint.q_w_flu_wxyz).all()
    assert LIMITS.min_thrust <= float(limited.setpoint.thrust) <= LIMITS.max_thrust
