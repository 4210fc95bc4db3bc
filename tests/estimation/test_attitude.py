"""The attitude filter's geometry, against the array functions and by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.frames import (
    matrix_from_quat,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_multiply,
    rotation_vector_from_quat,
)
from companion.estimation.attitude import Attitude, at_rest, is_rotation, predict, surprise_rad, update
from companion.estimation.kalman import Covariance
from companion.types import Array

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
        np.testing.assert_allclose(surprise_rad(estimate(believed), rows(q_measured)), expected, atol=1e-7)


def test_no_surprise_is_zero_not_nan() -> None:
    assert surprise_rad(estimate(np.zeros(3)), rows(quat_from_rotation_vector(np.zeros(3)))) == (0.0, 0.0, 0.0)


@given(believed=VECTORS, measured=VECTORS)
def test_an_unsure_filter_takes_the_measurement(believed: Array, measured: Array) -> None:
    q_measured = quat_from_rotation_vector(measured)
    state = estimate(believed)
    taken = update(state, surprise_rad(state, rows(q_measured)), 1e-6)
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
