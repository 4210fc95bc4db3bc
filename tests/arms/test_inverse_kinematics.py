"""Joint angles for a tip's target: they lead there, all are found, and what cannot be is refused with its reason."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from companion.arms.inverse_kinematics import reach_both_rad, reach_rad, ways_rad
from companion.arms.kinematics import tips_flu_m
from companion.arms.model import SIDES, ArmModel, JointLimit, Side
from companion.core.interfaces import ArmError
from companion.core.types import Array

MODEL = ArmModel()
FREE = replace(MODEL, limits=(JointLimit(-math.pi, math.pi, 3.0, 20.0),) * 4)
SIDE = st.sampled_from(SIDES)


def from_shoulder(x: float, y: float, z: float) -> Array:
    """A point seen from the left shoulder, in body FLU."""
    return np.array([x, 0.13 + y, z - 0.08])


def tip(side: Side, chain: Array) -> Array:
    place = SIDES.index(side)
    whole = np.zeros(8)
    whole[4 * place : 4 * place + 3] = chain
    return np.asarray(tips_flu_m(MODEL, whole)[place])


def inside(share: float) -> st.SearchStrategy[Array]:
    """Chains (3,) within the model's limits."""
    low, high = (limit[:3] for limit in MODEL.limit_arrays()[:2])
    shares = st.lists(st.floats(1.0 - share, share), min_size=3, max_size=3).map(np.array)
    return shares.map(lambda part: low + part * (high - low))


@given(side=SIDE, chain=inside(1.0))
def test_where_the_arm_can_be_it_can_be_sent(side: Side, chain: Array) -> None:
    target = tip(side, chain)
    found = reach_rad(MODEL, side, target, chain)
    np.testing.assert_allclose(tip(side, found), target, atol=1e-8)
    low, high = (limit[:3] for limit in MODEL.limit_arrays()[:2])
    assert np.all(found >= low)
    assert np.all(found <= high)


@given(side=SIDE, chain=inside(0.99))
def test_the_way_nearest_to_the_present_pose_is_the_present_pose(side: Side, chain: Array) -> None:
    assume(abs(chain[1]) > 1e-3)  # a straight elbow is where its two ways meet: the angle is ill-conditioned there
    np.testing.assert_allclose(reach_rad(MODEL, side, tip(side, chain), chain), chain, atol=1e-7)


@given(side=SIDE, chain=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array))
def test_every_way_leads_to_the_target_and_the_given_one_is_among_them(side: Side, chain: Array) -> None:
    assume(min(abs(math.sin(chain[1])), abs(math.cos(chain[2]))) > 1e-2)
    assume(abs(0.05 + 0.17 * math.cos(chain[2])) > 1e-2)
    target = tip(side, chain)
    ways = ways_rad(MODEL, side, target)
    for way in ways:
        np.testing.assert_allclose(tip(side, way), target, atol=1e-8)
    turned = (ways - chain + math.pi) % (2.0 * math.pi) - math.pi
    assert np.abs(turned).max(axis=1).min() < 1e-6


def test_a_point_in_front_has_an_elbow_down_and_an_elbow_up_way_mirrored_about_the_line_to_it() -> None:
    # shoulder to target 0.30 m straight forward: the triangle of 0.15, 0.22 and 0.30 m
    elbow = math.acos((0.09 - 0.15**2 - 0.22**2) / (2.0 * 0.15 * 0.22))
    lift = math.acos((0.09 + 0.15**2 - 0.22**2) / (2.0 * 0.15 * 0.30))
    ways = ways_rad(FREE, Side.LEFT, from_shoulder(0.30, 0.0, 0.0))
    straight = ways[np.abs(ways[:, 2]) < 1e-9]
    np.testing.assert_allclose(
        straight, [[math.pi / 2 - lift, elbow, 0.0], [math.pi / 2 + lift, -elbow, 0.0]], atol=1e-9
    )


def test_the_present_pose_decides_between_elbow_up_and_elbow_down() -> None:
    target = from_shoulder(0.30, 0.0, 0.0)
    down = reach_rad(FREE, Side.LEFT, target, np.array([0.0, 1.0, 0.0]))
    up = reach_rad(FREE, Side.LEFT, target, np.array([2.5, -1.0, 0.0]))
    assert down[1] > 0.0 > up[1]
    np.testing.assert_allclose(tip(Side.LEFT, down), tip(Side.LEFT, up), atol=1e-9)


def test_only_the_elbow_that_the_limits_allow_is_taken() -> None:
    target = from_shoulder(0.30, 0.0, 0.0)
    assert reach_rad(MODEL, Side.LEFT, target, np.array([2.5, -1.0, 0.0]))[1] > 0.0


def test_a_straight_arm_still_reaches_its_full_length() -> None:
    half = 0.37 * math.sqrt(0.5)
    found = reach_rad(MODEL, Side.LEFT, from_shoulder(half, 0.0, -half), np.zeros(3))
    np.testing.assert_allclose(found, [math.pi / 4, 0.0, 0.0], atol=1e-6)


def test_beyond_the_reach_the_distance_and_the_reach_are_told() -> None:
    with pytest.raises(ArmError) as caught:
        reach_rad(MODEL, Side.LEFT, from_shoulder(0.5, 0.0, 0.0), np.zeros(3))
    assert str(caught.value) == (
        "the left tip's target (0.500, 0.130, -0.080) m is out of reach: 0.500 m from the shoulder's axis, "
        "the arm reaches 0.070 to 0.370 m so far to the side"
    )


def test_too_near_to_the_shoulder_is_out_of_reach_too() -> None:
    with pytest.raises(ArmError, match=r"0\.010 m from the shoulder's axis, the arm reaches 0\.070 to 0\.370 m"):
        reach_rad(MODEL, Side.LEFT, from_shoulder(0.0, 0.0, -0.01), np.zeros(3))


def test_too_far_to_the_side_the_forearm_is_told() -> None:
    with pytest.raises(ArmError, match=r"right tip.*0\.200 m to the side of the shoulder, .* reaches 0\.170 m"):
        reach_rad(MODEL, Side.RIGHT, np.array([0.1, -0.33, -0.3]), np.zeros(3))


def test_a_joint_limit_in_the_way_is_named_with_the_angle_it_would_take() -> None:
    with pytest.raises(ArmError) as caught:
        reach_rad(MODEL, Side.RIGHT, np.array([0.0, -0.13, 0.25]), np.zeros(3))
    said = str(caught.value)
    assert said.startswith("the right tip's target (0.000, -0.130, 0.250) m cannot be reached: right.shoulder_pitch")
    assert said.endswith("allowed is -1.570 to 1.570 rad")


def test_one_arm_is_sent_and_the_other_stays() -> None:
    present = np.array([0.1, 0.5, 0.0, 0.3, 0.2, 0.6, 0.1, 0.4])
    target = from_shoulder(0.25, 0.05, -0.1)
    found = reach_both_rad(MODEL, {Side.LEFT: target}, present)
    np.testing.assert_array_equal(found[:4], present[:4])
    assert found[7] == present[7]
    np.testing.assert_allclose(tips_flu_m(MODEL, found)[1], target, atol=1e-9)
