"""Effect of moving links on the vehicle: by hand, and by differentiating their places."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from companion.arms import dynamics
from companion.arms.model import ArmModel, Link
from companion.core.types import Array, JointMotion
from tests.arms.poses import MOTIONS, joints

MODEL = ArmModel()
MASSES = np.array([0.14, 0.10, 0.16])


def _later(motion: JointMotion, dt_s: float) -> JointMotion:
    """The motion a moment later, its acceleration constant."""
    velocity = motion.velocity_radps + dt_s * motion.acceleration_radps2
    position = motion.position_rad + dt_s * motion.velocity_radps + 0.5 * dt_s**2 * motion.acceleration_radps2
    return JointMotion(position, velocity, motion.acceleration_radps2)


def _accelerations(motion: JointMotion) -> Array:
    """The links' accelerations (2, 3, 3), m/s^2, by differences of their places; the error is of fourth order."""
    h = 1e-3
    weights = {-2: -1.0, -1: 16.0, 0: -30.0, 1: 16.0, 2: -1.0}
    places = [w * dynamics.link_com_flu_m(MODEL, _later(motion, n * h).position_rad) for n, w in weights.items()]
    return np.asarray(np.sum(places, axis=0) / (12.0 * h * h))


def test_centres_of_mass_of_hanging_arms_by_hand() -> None:
    right, left = dynamics.link_com_flu_m(MODEL, np.zeros(8))
    np.testing.assert_allclose(right, [[0.0, -0.13, z] for z in (-0.19, -0.26, -0.37)], atol=1e-15)
    np.testing.assert_allclose(left, [[0.0, 0.13, z] for z in (-0.19, -0.26, -0.37)], atol=1e-15)


def test_the_shift_of_the_whole_vehicle_by_hand() -> None:
    # one arm straight out forward: its moment about the origin over the paper's m_t
    moment = 0.14 * 0.11 + 0.10 * 0.18 + 0.16 * 0.29
    shift = dynamics.com_shift_flu_m(MODEL, joints(left_shoulder_pitch=math.pi / 2), 4.85)
    assert shift[0] == pytest.approx(moment / 4.85)
    assert shift[1] == pytest.approx(0.0, abs=1e-15)


def test_arms_without_mass_push_nothing() -> None:
    empty = replace(MODEL, links=(Link(0.15, 0.0, 0.1), Link(0.05, 0.0, 0.03), Link(0.17, 0.0, 0.09)))
    motion = JointMotion(np.zeros(8), np.ones(8), np.ones(8))
    np.testing.assert_array_equal(dynamics.reaction_force_b_n(empty, motion), np.zeros(3))


def test_the_reaction_of_a_hanging_arm_that_starts_to_swing_forward_pushes_back() -> None:
    accel = joints(right_shoulder_pitch=10.0)
    motion = JointMotion(np.zeros(8), np.zeros(8), accel)
    moment = 0.14 * 0.11 + 0.10 * 0.18 + 0.16 * 0.29
    np.testing.assert_allclose(dynamics.reaction_force_b_n(MODEL, motion), [-10.0 * moment, 0.0, 0.0], atol=1e-15)


def test_an_arm_that_swings_past_its_lowest_point_pulls_the_vehicle_down() -> None:
    motion = JointMotion(np.zeros(8), joints(right_shoulder_pitch=2.0), np.zeros(8))
    moment = 0.14 * 0.11 + 0.10 * 0.18 + 0.16 * 0.29
    np.testing.assert_allclose(dynamics.reaction_force_b_n(MODEL, motion), [0.0, 0.0, -4.0 * moment], atol=1e-15)


@given(motion=MOTIONS)
def test_the_reaction_force_is_minus_the_masses_times_their_acceleration(motion: JointMotion) -> None:
    force = -(MASSES[:, None] * _accelerations(motion)).sum((0, 1))
    np.testing.assert_allclose(dynamics.reaction_force_b_n(MODEL, motion), force, atol=1e-6)


@given(motion=MOTIONS)
def test_the_reaction_torque_is_that_of_these_forces_about_the_origin(motion: JointMotion) -> None:
    lever = dynamics.link_com_flu_m(MODEL, motion.position_rad)
    torque = -(MASSES[:, None] * np.cross(lever, _accelerations(motion))).sum((0, 1))
    np.testing.assert_allclose(dynamics.reaction_torque_b_nm(MODEL, motion), torque, atol=1e-6)


@given(motion=MOTIONS)
def test_one_motion_and_many_give_the_same_force_and_torque(motion: JointMotion) -> None:
    parts = (motion.position_rad, motion.velocity_radps, motion.acceleration_radps2)
    many = JointMotion(*(np.stack((part, -part)) for part in parts))
    for of in (dynamics.reaction_force_b_n, dynamics.reaction_torque_b_nm):
        np.testing.assert_allclose(of(MODEL, many)[0], of(MODEL, motion), atol=1e-12)


def test_claws_move_no_mass() -> None:
    claws = joints(right_claw=5.0, left_claw=3.0)
    motion = JointMotion(claws, claws, claws)
    np.testing.assert_array_equal(dynamics.reaction_force_b_n(MODEL, motion), np.zeros(3))
