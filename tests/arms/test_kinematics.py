"""Places of the links: by hand, by turning matrices, and by differentiation."""

import math

import numpy as np
from hypothesis import given

from companion.arms.kinematics import points_flu_m, tips_flu_m
from companion.arms.model import ArmModel
from companion.core.types import Array
from tests.arms.poses import joints, vectors

MODEL = ArmModel()
L1, L2, L3 = 0.15, 0.05, 0.17


def test_all_zero_is_both_arms_hanging_straight_down_under_their_shoulders() -> None:
    right, left = points_flu_m(MODEL, np.zeros(8))
    np.testing.assert_allclose(right, [[0.0, -0.13, z] for z in (-0.08, -0.23, -0.28, -0.45)], atol=1e-15)
    np.testing.assert_allclose(left, [[0.0, 0.13, z] for z in (-0.08, -0.23, -0.28, -0.45)], atol=1e-15)


def test_positive_shoulder_pitch_lifts_the_arm_forward() -> None:
    right, left = tips_flu_m(MODEL, joints(right_shoulder_pitch=math.pi / 2))
    np.testing.assert_allclose(right, [L1 + L2 + L3, -0.13, -0.08], atol=1e-15)
    np.testing.assert_allclose(left, [0.0, 0.13, -0.45], atol=1e-15)


def test_positive_elbow_pitch_lifts_elbow_link_and_forearm_forward() -> None:
    _, left = points_flu_m(MODEL, joints(left_elbow_pitch=math.pi / 2))
    np.testing.assert_allclose(left[1], [0.0, 0.13, -0.23], atol=1e-15)
    np.testing.assert_allclose(left[2], [L2, 0.13, -0.23], atol=1e-15)
    np.testing.assert_allclose(left[3], [L2 + L3, 0.13, -0.23], atol=1e-15)


def test_positive_roll_swings_each_forearm_outward() -> None:
    right, left = tips_flu_m(MODEL, joints(right_elbow_roll=0.5, left_elbow_roll=0.5))
    np.testing.assert_allclose(right, [0.0, -0.13 - L3 * math.sin(0.5), -0.28 - L3 * math.cos(0.5)], atol=1e-15)
    np.testing.assert_allclose(left, [0.0, 0.13 + L3 * math.sin(0.5), -0.28 - L3 * math.cos(0.5)], atol=1e-15)


def _tip_by_matrices(shoulder: Array, pitch: float, elbow: float, roll: float, outward: float) -> Array:
    """The chain of turns, joint by joint: about -y (forward is up) twice, then about x, outward."""

    def about_y(angle: float) -> Array:
        c, s = math.cos(-angle), math.sin(-angle)
        return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])

    c, s = math.cos(outward * roll), math.sin(outward * roll)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    down = np.array([0.0, 0.0, -1.0])
    below_elbow = about_y(elbow) @ (L2 * down + about_x @ (L3 * down))
    return np.asarray(shoulder + about_y(pitch) @ (L1 * down + below_elbow))


@given(q=vectors(3.0))
def test_tips_are_where_a_chain_of_turning_matrices_puts_them(q: Array) -> None:
    right = _tip_by_matrices(np.array([0.0, -0.13, -0.08]), q[0], q[1], q[2], -1.0)
    left = _tip_by_matrices(np.array([0.0, 0.13, -0.08]), q[4], q[5], q[6], 1.0)
    np.testing.assert_allclose(tips_flu_m(MODEL, q), [right, left], atol=1e-12)


@given(q=vectors(3.0))
def test_links_keep_their_lengths(q: Array) -> None:
    lengths = np.linalg.norm(np.diff(points_flu_m(MODEL, q), axis=-2), axis=-1)
    np.testing.assert_allclose(lengths, [[L1, L2, L3]] * 2, atol=1e-12)


def test_many_poses_at_once_are_each_as_alone() -> None:
    many = np.random.default_rng(1).uniform(-2.0, 2.0, (5, 3, 8))
    together = points_flu_m(MODEL, many)
    assert together.shape == (5, 3, 2, 4, 3)
    np.testing.assert_array_equal(together[4, 1], points_flu_m(MODEL, many[4, 1]))
