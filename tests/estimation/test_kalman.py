"""The filter against the textbook's matrices, and against itself."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array
from companion.estimation.kalman import Covariance, Motion, grow, predict, shrink, update

START = Covariance(1e-7, 0.0, 0.0, 1.0, 0.0, 25.0)
DT_S = st.floats(0.001, 0.5)
VARIANCE = 9e-8


def matrix(c: Covariance) -> Array:
    return np.array([[c.pp, c.pv, c.pa], [c.pv, c.vv, c.va], [c.pa, c.va, c.aa]])


def grown_by_matrices(p: Array, dt: float, density: float) -> Array:
    f = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
    q = np.array([[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]])
    return np.asarray(f @ p @ f.T + density * q)


def shrunk_by_matrices(p: Array, variance: float) -> Array:
    h = np.array([[1.0, 0.0, 0.0]])
    k = p @ h.T / (h @ p @ h.T + variance)
    joseph = np.eye(3) - k @ h
    return np.asarray(joseph @ p @ joseph.T + variance * k @ k.T)


def motion(position: Array, covariance: Covariance = START) -> Motion:
    return Motion(position, np.zeros_like(position), np.zeros_like(position), covariance)


@given(dts=st.lists(DT_S, min_size=1, max_size=20), density=st.floats(0.01, 100.0))
def test_the_closed_form_is_the_matrix_form(dts: list[float], density: float) -> None:
    c, p = START, matrix(START)
    for dt in dts:
        c, p = grow(c, dt, density), grown_by_matrices(p, dt, density)
        np.testing.assert_allclose(matrix(c), p, rtol=1e-9)
        c, p = shrink(c, VARIANCE)[1], shrunk_by_matrices(p, VARIANCE)
        np.testing.assert_allclose(matrix(c), p, rtol=1e-4, atol=1e-9)


@given(first=DT_S, second=DT_S)
def test_two_steps_are_one_long_step(first: float, second: float) -> None:
    at_once = grow(START, first + second, 4.0)
    np.testing.assert_allclose(matrix(grow(grow(START, first, 4.0), second, 4.0)), matrix(at_once), rtol=1e-9)


@given(dts=st.lists(DT_S, min_size=1, max_size=200), density=st.floats(0.001, 1000.0))
def test_the_covariance_stays_one(dts: list[float], density: float) -> None:
    c = START
    for dt in dts:
        _, c = shrink(grow(c, dt, density), VARIANCE)
        scale = np.sqrt(np.diag(matrix(c)))
        assert (np.linalg.eigvalsh(matrix(c) / np.outer(scale, scale)) > -1e-9).all()


def test_a_sure_filter_ignores_and_an_unsure_one_believes() -> None:
    assert shrink(Covariance(0.0, 0, 0, 0, 0, 0), 1.0)[0] == (0.0, 0.0, 0.0)
    assert shrink(Covariance(1e9, 0, 0, 0, 0, 0), 1.0)[0][0] == pytest.approx(1.0)


def test_prediction_is_the_parabola() -> None:
    state = Motion(np.array([1.0, 0, 0]), np.array([2.0, 0, 0]), np.array([4.0, 0, 0]), START)
    ahead = predict(state, 0.5, 1.0)
    assert ahead.position[0] == pytest.approx(1.0 + 1.0 + 0.5)
    assert ahead.velocity[0] == pytest.approx(4.0)


def test_a_known_input_moves_the_motion_but_is_not_remembered() -> None:
    ahead = predict(motion(np.zeros(3)), 0.5, 1.0, accel_input=np.array([0.0, 0.0, 8.0]))
    assert ahead.position[2] == pytest.approx(1.0)
    assert ahead.velocity[2] == pytest.approx(4.0)
    assert ahead.acceleration[2] == 0.0


def test_broadcasting_equals_looping() -> None:
    rng = np.random.default_rng(1)
    paths = rng.normal(size=(30, 2, 4, 3))
    together = motion(paths[0])
    for measured in paths[1:]:
        together = update(predict(together, 0.01, 4.0), measured, VARIANCE)
    for i in range(2):
        for j in range(4):
            alone = motion(paths[0, i, j])
            for measured in paths[1:, i, j]:
                alone = update(predict(alone, 0.01, 4.0), measured, VARIANCE)
            np.testing.assert_array_equal(np.asarray(together.velocity)[i, j], alone.velocity)
            assert together.covariance == alone.covariance


def test_one_vehicles_three_floats_are_filtered_as_an_array_is() -> None:
    rng = np.random.default_rng(3)
    nothing = (0.0, 0.0, 0.0)
    floats, array = Motion(nothing, nothing, nothing, START), motion(np.zeros(3))
    for measured in rng.normal(size=(30, 3)):
        known = tuple(measured.tolist())
        floats = update(predict(floats, 0.01, 4.0, known), known, VARIANCE)
        array = update(predict(array, 0.01, 4.0, measured), measured, VARIANCE)
    assert floats.position == tuple(array.position)
    assert floats.velocity == tuple(array.velocity)
    assert floats.acceleration == tuple(array.acceleration)


def test_vehicles_with_times_of_their_own_broadcast_too() -> None:
    rng = np.random.default_rng(2)
    paths, dts = rng.normal(size=(30, 5, 3)), rng.uniform(0.005, 0.1, size=(30, 5, 1))
    together = motion(paths[0])
    for measured, dt in zip(paths[1:], dts[1:], strict=True):
        together = update(predict(together, dt, 4.0), measured, VARIANCE)
    for i in range(5):
        alone = motion(paths[0, i])
        for measured, dt in zip(paths[1:, i], dts[1:, i, 0].tolist(), strict=True):
            alone = update(predict(alone, dt, 4.0), measured, VARIANCE)
        np.testing.assert_array_equal(together.position[i], alone.position)
        np.testing.assert_array_equal(together.velocity[i], alone.velocity)
        own = [np.asarray(number)[i, 0] for number in vars(together.covariance).values()]
        assert own == list(vars(alone.covariance).values())


def test_the_steady_state_is_where_the_docstring_says() -> None:
    c = START
    for _ in range(500):
        _, c = shrink(grow(c, 0.01, 4.0), VARIANCE)
    w = (4.0 / (VARIANCE * 0.01)) ** (1 / 6)
    assert w == pytest.approx(40.6, abs=0.1)
    assert c.vv == pytest.approx(3 * w**3 * VARIANCE * 0.01, rel=0.25), (
        "continuous formula, ten samples a time constant"
    )


@given(acceleration=st.floats(-20, 20), seed=st.integers(0, 1000))
def test_irregular_frames_of_a_parabola_are_followed_exactly(acceleration: float, seed: int) -> None:
    """Each frame counts at its own time: no error is left however the gaps fall."""
    gaps: Any = np.random.default_rng(seed).uniform(0.005, 0.05, size=300)
    state, time_s = motion(np.zeros(3)), 0.0
    for dt in gaps.tolist():
        time_s += dt
        state = update(predict(state, dt, 4.0), np.full(3, 0.5 * acceleration * time_s**2), VARIANCE)
    np.testing.assert_allclose(state.velocity, acceleration * time_s, atol=1e-3 * (1 + abs(acceleration)))
    np.testing.assert_allclose(state.acceleration, acceleration, atol=1e-2 * (1 + abs(acceleration)))
