"""Rotations and frames against matrices written independently, and the signs a pilot would check first."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array
from companion.geometry import frames

SEED = st.integers(0, 2**32 - 1)
HALF_TURN_ABOUT_X = np.diag([1.0, -1.0, -1.0])


def about(axis: int, angle: float) -> Array:
    """Elementary rotation matrix about x (0), y (1) or z (2), right-handed."""
    c, s = math.cos(angle), math.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    m = np.eye(3)
    m[i, i] = m[j, j] = c
    m[i, j], m[j, i] = -s, s
    return m


def quat_about(axis: int, angle: float) -> Array:
    q = np.zeros(4)
    q[0], q[1 + axis] = math.cos(angle / 2), math.sin(angle / 2)
    return q


def random_quat(seed: int) -> Array:
    q = np.random.default_rng(seed).normal(size=4)
    return np.asarray(q / math.sqrt(float(q @ q)))


def rodrigues(q: Array) -> Array:
    """Rotation matrix from axis and angle, not from the quaternion's products."""
    angle = 2.0 * math.atan2(math.sqrt(float(q[1:] @ q[1:])), float(q[0]))
    axis = q[1:] / max(math.sqrt(float(q[1:] @ q[1:])), 1e-300)
    k = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k))


@given(seed=SEED)
def test_the_matrix_of_a_quaternion_is_rodrigues(seed: int) -> None:
    q = random_quat(seed)
    np.testing.assert_allclose(frames.matrix_from_quat(q), rodrigues(q), atol=1e-12)
    np.testing.assert_allclose(frames.up_axis(q), rodrigues(q)[:, 2], atol=1e-12)


@given(seed=SEED)
def test_a_vector_turns_as_its_matrix_says(seed: int) -> None:
    q, vector = random_quat(seed), np.random.default_rng(seed).normal(size=3)
    np.testing.assert_allclose(frames.turned(q, vector), rodrigues(q) @ vector, atol=1e-12)


@given(seed=SEED)
def test_products_of_quaternions_are_products_of_matrices(seed: int) -> None:
    a, b = random_quat(seed), random_quat(seed + 1)
    np.testing.assert_allclose(rodrigues(frames.quat_multiply(a, b)), rodrigues(a) @ rodrigues(b), atol=1e-12)
    np.testing.assert_allclose(rodrigues(frames.quat_conjugate(a)), rodrigues(a).T, atol=1e-12)


@given(seed=SEED)
def test_a_matrix_gives_its_quaternion_back(seed: int) -> None:
    q = random_quat(seed)
    found = frames.quat_from_matrix(rodrigues(q))
    assert found[0] >= 0.0
    np.testing.assert_allclose(found, q if q[0] >= 0.0 else -q, atol=1e-9)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle", [math.pi, math.pi - 1e-9, -math.pi + 1e-9])
def test_half_turns_are_not_singular(axis: int, angle: float) -> None:
    found = frames.quat_from_matrix(about(axis, angle))
    np.testing.assert_allclose(rodrigues(found), about(axis, angle), atol=1e-8)


@given(seed=SEED, size=st.floats(0.0, math.pi - 1e-6))
def test_rotation_vectors_go_there_and_back(seed: int, size: float) -> None:
    v = np.random.default_rng(seed).normal(size=3)
    vector = v / math.sqrt(float(v @ v)) * size
    q = frames.quat_from_rotation_vector(vector)
    np.testing.assert_allclose(frames.rotation_vector_from_quat(q), vector, atol=1e-8)
    np.testing.assert_allclose(frames.rotation_vector_from_quat(-q), vector, atol=1e-8)


@given(seed=SEED)
def test_the_autopilots_frames_are_a_half_turn_about_x_on_both_sides(seed: int) -> None:
    q = random_quat(seed)
    ned = rodrigues(frames.flip_quat(q))
    np.testing.assert_allclose(ned, HALF_TURN_ABOUT_X @ rodrigues(q) @ HALF_TURN_ABOUT_X, atol=1e-12)
    v = np.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(frames.flip_yz(v), [1.0, -2.0, -3.0])
    np.testing.assert_array_equal(frames.flip_yz(frames.flip_yz(v)), v)
    np.testing.assert_array_equal(frames.flip_quat(frames.flip_quat(q)), q)


@given(roll=st.floats(-179.0, 179.0), pitch=st.floats(-89.0, 89.0), yaw=st.floats(-179.0, 179.0))
def test_euler_angles_are_the_aerospace_sequence_in_ned(roll: float, pitch: float, yaw: float) -> None:
    """R_ned_frd = Rz(yaw) Ry(pitch) Rx(roll), made here from elementary matrices."""
    r = [math.radians(a) for a in (roll, pitch, yaw)]
    r_ned_frd = about(2, r[2]) @ about(1, r[1]) @ about(0, r[0])
    q = frames.quat_from_matrix(HALF_TURN_ABOUT_X @ r_ned_frd @ HALF_TURN_ABOUT_X)
    np.testing.assert_allclose(frames.euler_ned_frd_deg(q), (roll, pitch, yaw), atol=1e-6)


@pytest.mark.parametrize(
    ("axis", "angle_deg", "expected", "because"),
    [
        (1, 10.0, (0.0, -10.0, 0.0), "FLU: nose down is a positive turn about left; NED/FRD pitch is positive nose up"),
        (0, -10.0, (-10.0, 0.0, 0.0), "FLU: leaning left is a negative turn about forward, and so is FRD's roll"),
        (2, 90.0, (0.0, 0.0, -90.0), "W counts headings counter-clockwise, NED clockwise"),
    ],
)
def test_signs_at_the_edge(axis: int, angle_deg: float, expected: tuple[float, ...], because: str) -> None:
    q = quat_about(axis, math.radians(angle_deg))
    np.testing.assert_allclose(frames.euler_ned_frd_deg(q), expected, atol=1e-9, err_msg=because)


@given(yaw=st.floats(-3.1, 3.1), tilt=st.floats(-1.4, 1.4))
def test_the_heading_is_that_of_the_nose(yaw: float, tilt: float) -> None:
    np.testing.assert_allclose(rodrigues(frames.quat_from_yaw(yaw)), about(2, yaw), atol=1e-12)
    q = frames.quat_multiply(quat_about(2, yaw), quat_about(1, tilt))
    assert float(frames.yaw_of(q)) == pytest.approx(yaw, abs=1e-9)


def test_all_of_it_broadcasts() -> None:
    q = np.array([random_quat(n) for n in range(6)]).reshape(2, 3, 4)
    p = np.array([random_quat(n + 50) for n in range(6)]).reshape(2, 3, 4)
    for index in np.ndindex(2, 3):
        for function in (
            frames.flip_quat,
            frames.quat_conjugate,
            frames.rotation_vector_from_quat,
            frames.matrix_from_quat,
            frames.up_axis,
            frames.yaw_of,
        ):
            np.testing.assert_allclose(function(q)[index], function(q[index]), atol=1e-15)
        np.testing.assert_allclose(frames.quat_multiply(q, p)[index], frames.quat_multiply(q[index], p[index]))
        m = frames.matrix_from_quat(q)
        np.testing.assert_allclose(frames.quat_from_matrix(m)[index], frames.quat_from_matrix(m[index]), atol=1e-15)
        r = frames.rotation_vector_from_quat(q)
        np.testing.assert_allclose(frames.turned(q, r)[index], frames.turned(q[index], r[index]), atol=1e-15)
        np.testing.assert_allclose(
            frames.quat_from_rotation_vector(r)[index], frames.quat_from_rotation_vector(r[index]), atol=1e-15
        )
