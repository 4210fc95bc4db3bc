"""The fence: how far outside, where a vehicle comes to rest, and how hard it may still be driven towards a face."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from companion.core.types import Vec3
from companion.guard.geofence import Fence

FENCE = Fence((-4.0, -3.0), (5.0, 2.0, 3.5), braking_mps2=2.0, reaction_s=0.4)
AT_REST = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("place", "beyond_m"),
    [
        ((0.0, 0.0, 0.0), -2.0),
        ((4.5, 0.0, 1.0), -0.5),
        ((5.25, 0.0, 1.0), 0.25),
        ((-4.5, 0.0, 1.0), 0.5),
        ((-3.5, 0.0, 1.0), -0.5),
        ((0.0, 2.75, 1.0), 0.75),
        ((0.0, -3.125, 1.0), 0.125),
        ((0.0, -2.875, 1.0), -0.125),
        ((0.0, 0.0, 3.75), 0.25),
        ((0.0, 0.0, 3.25), -0.25),
        ((0.0, 0.0, -50.0), -2.0),
        ((5.25, -3.5, 3.75), 0.5),
    ],
)
def test_how_far_outside(place: Vec3, beyond_m: float) -> None:
    assert FENCE.beyond_m(np.array(place)) == pytest.approx(beyond_m, abs=1e-15)


def test_the_stopping_point_is_the_reaction_and_the_brake_further_axis_by_axis() -> None:
    found = FENCE.stopping_point_w_m(np.array([1.0, 2.0, 3.0]), np.array([2.0, -1.0, 0.0]))
    assert found == pytest.approx((1.0 + 0.8 + 1.0, 2.0 - 0.4 - 0.25, 3.0))


def test_the_docstring_says_which_speed_is_legal_how_far_from_a_face() -> None:
    rows = [line.split() for line in (Fence.__doc__ or "").splitlines()]
    (speeds,) = (row[-5:] for row in rows if row[:1] == ["speed"])
    (distances,) = (row[-5:] for row in rows if row[:1] == ["distance"])
    default = Fence((-9.0, -9.0), (9.0, 9.0, 9.0))
    for speed, distance in zip(speeds, distances, strict=True):
        stop, *_ = default.stopping_point_w_m(np.zeros(3), np.array([float(speed), 0.0, 0.0]))
        assert float(distance) == pytest.approx(stop, abs=0.005)


# --- allowed accelerations ---

FACES = [(0, 1.0, 5.0), (0, -1.0, -4.0), (1, 1.0, 2.0), (1, -1.0, -3.0), (2, 1.0, 3.5)]
"""Axis, outwards along it, where."""


def towards(face: tuple[int, float, float], left_m: float, speed_mps: float, carried_mps2: float = 0.0) -> float:
    """Most that may be asked for towards a face, from so far before it, m/s^2."""
    axis, way, where = face

    def along(value: float) -> Vec3:
        three = [0.0, 0.0, 0.0]
        three[axis] = value
        return three[0], three[1], three[2]

    ranges = FENCE.allowed_accel_w_mps2(along(where - way * left_m), along(way * speed_mps), along(way * carried_mps2))
    return way * ranges[axis][0 if way < 0.0 else 1]


@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize(
    ("left_m", "speed_mps", "most_mps2"),
    [
        (0.0, 0.0, 0.0),  # at the face, at rest: nothing further
        (0.45, 1.0, 0.0),  # what 1 m/s needs after half the reaction: 0.2 + 0.25
        (0.28, 0.8, -0.41742),  # 0.28 = (0.8 + u) 0.1 + u^2 / 4: u = -0.2 + sqrt(0.84), (u - 0.8) / 0.2
        (8.0, 0.0, 27.30194),  # 8 = 0.1 u + u^2 / 4: u = -0.2 + sqrt(32.04)
        (0.02, 0.25, -1.54289),  # 0.02 = (0.25 + u) 0.1 + u^2 / 4: u = -0.2 + sqrt(0.04 - 0.02), already inwards
        (0.005, 0.2, -2.70711),  # no u is enough: (-sqrt(0.08) - 0.4) / 2 inwards
        (0.1, 3.0, -20.35890),  # (-sqrt(3.04) - 0.4) / 2
        (-0.005, 0.0, -0.29289),  # beyond: (sqrt(0.08) - 0.4) / 2 is just inwards
        (-0.1, 0.0, -4.0),  # (-1.2 - 0.4) / 2
        (-0.5, 0.0, -8.0),
        (-0.5, -2.0, 3.61484),  # inwards at 2 m/s, where 1.277 are enough
    ],
)
def test_what_may_be_asked_for_by_hand(
    face: tuple[int, float, float], left_m: float, speed_mps: float, most_mps2: float
) -> None:
    """`left_m` counts from where the vehicle is after the half of the reaction in which it is only carried on."""
    assert towards(face, left_m + 0.2 * speed_mps, speed_mps) == pytest.approx(most_mps2, abs=1e-5)


@pytest.mark.parametrize("face", FACES)
def test_what_acts_already_counts_for_half_the_reaction(face: tuple[int, float, float]) -> None:
    """3 m/s^2 for 0.2 s from 0.4 m/s: 0.08 + 0.06 m further at 1 m/s, which needs the 0.45 m that are left."""
    assert towards(face, 0.45 + 0.14, 0.4, carried_mps2=3.0) == pytest.approx(0.0, abs=1e-12)


def test_downwards_everything_is_allowed() -> None:
    assert FENCE.allowed_accel_w_mps2((0.0, 0.0, -9.0), (0.0, 0.0, -99.0), AT_REST)[2][0] == -math.inf


@given(left_m=st.floats(0.1, 3.0), share=st.floats(0.0, 1.0))
def test_to_ask_for_nothing_is_allowed_as_long_as_the_stopping_point_is_inside(left_m: float, share: float) -> None:
    edge_mps = 2.0 * (math.sqrt(0.16 + left_m) - 0.4)
    assert towards(FACES[0], left_m, (1.0 - 1e-9) * share * edge_mps) > 0.0
    assert towards(FACES[0], left_m, edge_mps + 1e-6 + share) < 0.0


@given(left_m=st.floats(0.3, 4.0), speed_mps=st.floats(-2.0, 1.0), carried_mps2=st.floats(-4.0, 4.0))
def test_what_is_allowed_for_half_the_reaction_just_leaves_the_way_to_brake(
    left_m: float, speed_mps: float, carried_mps2: float
) -> None:
    most = towards(FACES[0], left_m, speed_mps, carried_mps2)
    then, speed = speed_mps * 0.2 + 0.02 * carried_mps2, speed_mps + 0.2 * carried_mps2
    end = speed + 0.2 * most
    assume(end > 0.0)
    assert then + speed * 0.2 + 0.02 * most + end * end / 4.0 == pytest.approx(left_m, abs=1e-9)


def test_no_jump_anywhere() -> None:
    """The allowed acceleration is continuous in the distance left and the speed, so that nothing chatters."""
    for speed_mps in (-1.0, 0.0, 0.3, 1.0):
        most = [towards(FACES[0], left_m, speed_mps) for left_m in np.linspace(-1.0, 1.0, 20_001)]
        assert float(np.abs(np.diff(most)).max()) < 0.15


def test_without_a_reaction_a_control_cycle_is_reckoned_with() -> None:
    """9 = (0 + u) 0.005 + u^2 / 4 with u after 0.01 s."""
    at_once = replace(FENCE, reaction_s=0.0)
    most = at_once.allowed_accel_w_mps2((-4.0, 0.0, 0.0), AT_REST, AT_REST)[0][1]
    assert most == pytest.approx((math.sqrt(1e-4 + 36.0) - 0.01) / 0.01)


def test_no_number_allows_nothing() -> None:
    for place, velocity, carried in np.ndindex(2, 2, 2):
        numbers = [(math.nan, 0.0, math.nan) if bad else AT_REST for bad in (place, velocity, carried)]
        low, high = FENCE.allowed_accel_w_mps2(*numbers)[0]
        assert (low <= 0.0 <= high) == (not (place or velocity or carried))
