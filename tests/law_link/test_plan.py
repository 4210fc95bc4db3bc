"""The plan: what the ground interpolates between its knots, against the trajectory that the vehicle flies."""

import math
from collections.abc import Callable
from math import remainder, tau

import numpy as np
import pytest

from companion.core.types import JointMotion, Reference
from companion.law_link.codec import packed, unpacked
from companion.law_link.messages import Plan
from companion.law_link.plan import KNOTS, SPACING_S, PlannedMotion, plan_of
from companion.trajectories.reference import Descent, Ellipse, FigureEight, Hold, LapTiming, MinimumJerk, Trajectory

NOW_S = 1234.5
LENGTH_S = (KNOTS - 1) * SPACING_S
TIMING = LapTiming(period_s=20.0, laps=2)
QUICK = LapTiming(period_s=8.0, laps=1)
HERE = np.array([0.3, -0.2, 1.1])
TRAJECTORIES: dict[str, tuple[Trajectory, tuple[float, float, float]]] = {
    "hold": (Hold(HERE, 0.4), (1e-7, 1e-7, 1e-7)),
    "ellipse": (Ellipse(HERE, timing=TIMING), (2e-7, 5e-6, 2e-4)),
    "quick ellipse": (Ellipse(HERE, timing=QUICK), (5e-7, 1e-5, 5e-4)),
    "figure-eight": (FigureEight(HERE, timing=TIMING), (2e-7, 5e-6, 2e-4)),
    "approach": (
        MinimumJerk(start_w_m=HERE, end_w_m=np.array([1.0, 0.5, 1.5]), duration_s=3.0, end_yaw_rad=1.0),
        (3e-5, 6e-4, 0.04),
    ),
    "descent": (
        Descent(
            start_w_m=HERE,
            velocity_w_mps=np.array([0.5, 0.0, 0.0]),
            speed_mps=0.3,
            yaw_rad=0.2,
            yaw_rate_radps=0.3,
        ),
        (1e-5, 2e-4, 5e-3),
    ),
}
"""Trajectories, and the largest errors of position (m), velocity (m/s) and acceleration (m/s^2).

The third derivative of an approach jumps where it begins and ends, in the middle between two knots.
"""


def plan_at(trajectory: Trajectory, begin_s: float) -> PlannedMotion:
    """Return the plan of a trajectory from `begin_s` of it, as it arrives over the link."""
    sent = plan_of(NOW_S, lambda time_s: trajectory.at(time_s - NOW_S + begin_s), None)
    arrived = unpacked(packed(sent))
    assert isinstance(arrived, Plan)
    return PlannedMotion(arrived)


def worst(trajectory: Trajectory, of: Callable[[Reference, Reference], float], beyond_s: float = 0.0) -> float:
    """Return the largest difference between the interpolated and the flown reference, over the whole trajectory."""
    found = 0.0
    for begin_s in np.arange(0.0, min(trajectory.duration_s, 5.0) + 0.2, 0.13).tolist():
        motion = plan_at(trajectory, begin_s)
        for ahead_s in np.arange(0.0, LENGTH_S + beyond_s, 0.021).tolist():
            found = max(found, of(motion.reference(NOW_S + ahead_s), trajectory.at(begin_s + ahead_s)))
    return found


def position_m(one: Reference, other: Reference) -> float:
    return float(np.linalg.norm(one.position_w_m - other.position_w_m))


def heading_rad(one: Reference, other: Reference) -> float:
    return abs(remainder(one.yaw_rad - other.yaw_rad, tau))


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_between_its_knots_the_plan_is_the_trajectory(name: str) -> None:
    trajectory, (position_limit, velocity_limit, acceleration_limit) = TRAJECTORIES[name]

    def velocity_mps(one: Reference, other: Reference) -> float:
        return float(np.linalg.norm(one.velocity_w_mps - other.velocity_w_mps))

    def acceleration_mps2(one: Reference, other: Reference) -> float:
        return float(np.linalg.norm(one.acceleration_w_mps2 - other.acceleration_w_mps2))

    assert worst(trajectory, position_m) < position_limit
    assert worst(trajectory, velocity_mps) < velocity_limit
    assert worst(trajectory, acceleration_mps2) < acceleration_limit


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_the_heading_is_the_trajectorys_too(name: str) -> None:
    assert worst(TRAJECTORIES[name][0], heading_rad) < 2e-4


def test_a_plan_that_is_one_period_old_is_still_exact() -> None:
    """With a plan every 0.2 s, two may be lost."""
    motion = plan_at(Ellipse(HERE, timing=TIMING), 5.0)
    late_s = 2.9 * SPACING_S
    assert position_m(motion.reference(NOW_S + late_s), Ellipse(HERE, timing=TIMING).at(5.0 + late_s)) < 1e-6


def test_beyond_the_last_knot_its_velocity_goes_on() -> None:
    trajectory = Ellipse(HERE, timing=TIMING)
    motion, end_s = plan_at(trajectory, 5.0), LENGTH_S
    last, beyond = trajectory.at(5.0 + end_s), motion.reference(NOW_S + end_s + 0.1)
    assert beyond.position_w_m == pytest.approx(last.position_w_m + 0.1 * last.velocity_w_mps, abs=1e-6)
    assert beyond.velocity_w_mps == pytest.approx(last.velocity_w_mps, abs=1e-6)
    assert beyond.acceleration_w_mps2 == pytest.approx(np.zeros(3))


def test_before_the_first_knot_the_plan_begins() -> None:
    motion = plan_at(Ellipse(HERE, timing=TIMING), 5.0)
    assert motion.since_begin_s(NOW_S - 0.05) == pytest.approx(-0.05, abs=1e-4)
    assert position_m(motion.reference(NOW_S - 0.05), motion.reference(NOW_S)) == 0.0


def test_a_heading_goes_the_short_way_over_half_a_turn() -> None:
    turning = MinimumJerk(
        start_w_m=HERE, end_w_m=HERE, duration_s=2.0, start_yaw_rad=math.pi - 0.2, end_yaw_rad=math.pi + 0.3
    )

    assert worst(turning, heading_rad) < 2e-4


def test_the_arms_motion_is_joined_as_the_reference_is() -> None:
    def joints(time_s: float) -> JointMotion:
        t = time_s - NOW_S
        angle = np.array([0.1 * (index + 1) * math.sin(1.5 * t) for index in range(8)])
        velocity = np.array([0.15 * (index + 1) * math.cos(1.5 * t) for index in range(8)])
        return JointMotion(angle, velocity, -2.25 * angle)

    plan = unpacked(packed(plan_of(NOW_S, lambda _: Hold(HERE).at(0.0), joints)))
    assert isinstance(plan, Plan)
    motion = PlannedMotion(plan)
    for ahead_s in np.arange(0.0, LENGTH_S, 0.017).tolist():
        there = motion.joints(NOW_S + ahead_s)
        assert there is not None
        assert there.position_rad == pytest.approx(joints(NOW_S + ahead_s).position_rad, abs=1e-6)
        assert there.acceleration_radps2 == pytest.approx(joints(NOW_S + ahead_s).acceleration_radps2, abs=2e-2)
    assert plan_at(Hold(HERE), 0.0).joints(NOW_S) is None, "a vehicle without arms"
