"""The attitude filter's geometry, against the array functions and by hand."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array
from companion.estimation.attitude import (
    Attitude,
    at_rest,
    innovation_of_quat_rad,
    innovation_rad,
    is_rotation,
    predict,
    update,
)
from companion.estimation.kalman import Covariance
from companion.geometry.frames import (
    matrix_from_quat,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_multiply,
    rotation_vector_from_quat,
)

SURE = Covariance(1e-12, 0.0, 0.0, 0.0, 0.0, 0.0)
UNSURE = Covariance(1e9, 0.0, 0.0, 1.0, 0.0, 1.0)
VECTORS = st.tuples(*[st.floats(-1.7, 1.7)] * 3).map(np.array)


def rows(q: Array) -> tuple[float, ...]:
    return tuple(matrix_from_quat(q).ravel().tolist())


def estimate(vector: Array, covariance: Covariance = UNSURE) -> Attitude:
    return at_rest(matrix_from_quat(quat_from_rotation_vector(vector)), covariance)


@given(believed=VECTORS, measured=VECTORS)
def test_the_surprise_is_the_rotation_from_the_belief_to_the_measurement(believed: Array, measured: Array) -> None:
    q, q_measured = quat_from_rotation_vector(believed), quat_from_rotation_vector(measured)
    expected = rotation_vector_from_quat(quat_multiply(quat_conjugate(q), q_measured))
    if np.linalg.norm(expected) < 3.0:  # near half a turn the two directions are alike
        innovation = np.array(innovation_rad(estimate(believed), rows(q_measured)))
        np.testing.assert_allclose(innovation, expected, atol=1e-7)


@given(believed=VECTORS, measured=VECTORS, sign=st.sampled_from((1.0, -1.0)))
def test_a_quaternion_surprises_as_much_as_its_matrix(believed: Array, measured: Array, sign: float) -> None:
    state, q_measured = estimate(believed), quat_from_rotation_vector(measured)
    innovation = np.array(innovation_of_quat_rad(state, tuple((sign * q_measured).tolist())))
    if np.linalg.norm(innovation) < 3.0:
        np.testing.assert_allclose(innovation, np.array(innovation_rad(state, rows(q_measured))), rtol=0.0, atol=1e-14)


def test_half_a_turn_is_no_small_surprise() -> None:
    state = estimate(np.zeros(3))
    assert innovation_of_quat_rad(state, (0.0, 0.0, 1.0, 0.0)) == pytest.approx((0.0, np.pi, 0.0))


def test_no_surprise_is_zero_not_nan() -> None:
    assert innovation_rad(estimate(np.zeros(3)), rows(quat_from_rotation_vector(np.zeros(3)))) == (0.0, 0.0, 0.0)
    both = estimate(np.array([[0.0, 0.0, 0.0], [0.3, 0.2, 0.1]]))
    innovation = np.array(innovation_of_quat_rad(both, both.q))
    np.testing.assert_array_equal(innovation[:, 0], np.zeros(3))
    np.testing.assert_allclose(innovation[:, 1], np.zeros(3), atol=1e-16)


@given(angle=st.floats(0.0, 1e-6) | st.sampled_from((5e-324, 1e-310, 1e-200, 1e-162, 1e-154)))
def test_the_smallest_turns_are_turned(angle: float) -> None:
    turned = predict(Attitude((1.0, 0.0, 0.0, 0.0), (0.0, angle, 0.0), (0.0, 0.0, 0.0), SURE), 1.0, 1.0)
    assert turned.q == pytest.approx((1.0, 0.0, 0.5 * angle, 0.0), rel=1e-12, abs=1e-150)


NUMBERS = st.tuples(*[st.floats(-4.0, 4.0)] * 12, st.floats(0.001, 0.1))
"""Turn so far, rate, its change, turn measured; time. Small enough to keep away from half a turn of innovation."""


@given(st.lists(NUMBERS, min_size=1, max_size=5))
def test_a_batch_is_each_one_alone(several: list[tuple[float, ...]]) -> None:
    """Turned on, surprised by a quaternion and by a matrix, and corrected: arrays of numbers against floats."""
    numbers = np.array(several)
    q_measured = quat_from_rotation_vector(0.15 * numbers[:, 9:12])
    variances = Covariance(*np.array([[1e-5], [1e-3], [1e-2], [1.0], [5.0], [100.0]]) * numbers[:, 12])
    together = flown(numbers.T, variances, tuple(q_measured.T), tuple(matrix_from_quat(q_measured).reshape(-1, 9).T))
    for i, own in enumerate(numbers.tolist()):
        variance = Covariance(*(float(x[i]) for x in vars(variances).values()))
        alone = flown(own, variance, tuple(q_measured[i].tolist()), rows(q_measured[i]))
        np.testing.assert_allclose(together[:, i], alone, rtol=1e-12, atol=1e-12)


def flown(numbers: Any, covariance: Covariance, q_measured: Any, rotation_rows: Any) -> Array:
    """Everything that comes of one step, along the first axis, from `NUMBERS` along the first axis."""
    q = estimate(0.15 * np.array(numbers[0:3]).T).q
    start = Attitude(q, tuple(numbers[3:6]), tuple(numbers[6:9]), covariance)
    ahead = predict(start, numbers[12], 80.0)
    by_matrix, by_quat = innovation_rad(ahead, rotation_rows), innovation_of_quat_rad(ahead, q_measured)
    after = update(ahead, by_quat, 4e-6)
    return np.array(
        [
            *ahead.q,
            *ahead.rate,
            *by_matrix,
            *by_quat,
            *after.q,
            *after.rate,
            *after.turn,
            *vars(after.covariance).values(),
        ]
    )


@given(believed=VECTORS, measured=VECTORS)
def test_an_unsure_filter_takes_the_measurement(believed: Array, measured: Array) -> None:
    q_measured = quat_from_rotation_vector(measured)
    state = estimate(believed)
    taken = update(state, innovation_rad(state, rows(q_measured)), 1e-6)
    np.testing.assert_allclose(matrix_from_quat(np.array(taken.q)), matrix_from_quat(q_measured), atol=1e-6)
    assert taken.q[0] >= 0.0


def test_prediction_turns_about_the_bodys_axes() -> None:
    """Nose to the west, then a roll to the right: the left side comes up, and left is south."""
    west = at_rest(matrix_from_quat(quat_from_rotation_vector(np.array([0.0, 0.0, np.pi / 2]))), SURE)
    turned = predict(Attitude(west.q, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0), SURE), 0.4, 1.0)
    left = matrix_from_quat(np.array(turned.q))[:, 1]
    np.testing.assert_allclose(left, (-np.cos(0.2), 0.0, np.sin(0.2)), atol=1e-12)


@given(VECTORS)
def test_every_rotation_passes_and_its_mirror_does_not(vector: Array) -> None:
    rotation = matrix_from_quat(quat_from_rotation_vector(vector))
    assert is_rotation(tuple(rotation.ravel().tolist()))
    assert not is_rotation(tuple((-rotation).ravel().tolist()))


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf"), 1e200])
def test_no_number_slips_through(bad: float) -> None:
    for place in range(9):
        values = np.eye(3).ravel().tolist()
        values[place] = bad
        assert not is_rotation(tuple(values))
