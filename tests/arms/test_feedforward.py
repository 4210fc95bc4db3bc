"""Feedforward of the arms to the law, against what a lever and a high-pass do."""

import math

import numpy as np
import pytest

from companion.arms.dynamics import com_shift_flu_m, reaction_force_b_n
from companion.arms.feedforward import (
    Airframe,
    force_accel_b_mps2,
    tilt_accel_b_mps2,
    trimmed_b_radps2,
    turning_b_radps2,
)
from companion.arms.model import ArmModel
from companion.arms.trajectory import at_rest
from companion.core.types import JointMotion

MODEL = ArmModel()
AIRFRAME = Airframe(4.85, 9.8, (0.11, 0.10, 0.13), 7.7, 0.75)
FORWARD = np.array([0.9, 0.5, 0.0, 0.0] * 2)
RIGHT_OUT = np.array([0.3, 0.5, 1.0, 0.0, 0.3, 0.5, 0.0, 0.0])


def test_arms_held_in_front_turn_the_nose_down() -> None:
    turning = turning_b_radps2(MODEL, AIRFRAME, at_rest(FORWARD))
    ahead_m = com_shift_flu_m(MODEL, FORWARD, 4.85)[0]
    assert ahead_m > 0.01
    assert turning == pytest.approx([0.0, 4.85 * 9.8 * ahead_m / 0.10, 0.0]), "about body y, which points left"


def test_an_arm_held_out_to_the_right_turns_the_right_side_down() -> None:
    assert turning_b_radps2(MODEL, AIRFRAME, at_rest(RIGHT_OUT))[0] > 0.0, "positive about body x lifts the left side"


def test_a_nose_held_down_accelerates_forward_and_a_right_side_held_down_to_the_right() -> None:
    w2 = 7.7**2
    assert tilt_accel_b_mps2(np.array([0.0, 3.0, 0.0]), AIRFRAME) == pytest.approx([9.8 * 3.0 / w2, 0.0, 0.0])
    assert tilt_accel_b_mps2(np.array([3.0, 0.0, 5.0]), AIRFRAME) == pytest.approx([0.0, -9.8 * 3.0 / w2, 0.0])


def test_a_lasting_torque_is_trimmed_out_with_the_integrators_time_constant() -> None:
    lasting, trimmed = np.array([1.0, -2.0, 0.5]), np.zeros(3)
    for _ in range(75):
        trimmed = trimmed_b_radps2(trimmed, lasting, AIRFRAME, 0.01)
    assert trimmed == pytest.approx((1.0 - math.exp(-1.0)) * lasting, rel=1e-9)


def test_the_links_force_is_shared_by_the_whole_mass() -> None:
    motion = JointMotion(FORWARD, np.zeros(8), np.full(8, 10.0))
    wanted = reaction_force_b_n(MODEL, motion) / 4.85
    assert force_accel_b_mps2(MODEL, AIRFRAME, motion, motion) == pytest.approx(wanted)
    still = at_rest(FORWARD)
    assert force_accel_b_mps2(MODEL, AIRFRAME, motion, still) == pytest.approx([*wanted[:2], 0.0]), "each its own lead"


def test_many_instants_at_once_are_each_alone() -> None:
    rng = np.random.default_rng(3)
    many = JointMotion(*(rng.normal(size=(5, 8)) for _ in range(3)))
    turning = turning_b_radps2(MODEL, AIRFRAME, many)
    force, tilt = force_accel_b_mps2(MODEL, AIRFRAME, many, many), tilt_accel_b_mps2(turning, AIRFRAME)
    for i in range(5):
        one = JointMotion(many.position_rad[i], many.velocity_radps[i], many.acceleration_radps2[i])
        alone = turning_b_radps2(MODEL, AIRFRAME, one)
        assert turning[i] == pytest.approx(alone)
        assert force[i] == pytest.approx(force_accel_b_mps2(MODEL, AIRFRAME, one, one))
        assert tilt[i] == pytest.approx(tilt_accel_b_mps2(alone, AIRFRAME))
