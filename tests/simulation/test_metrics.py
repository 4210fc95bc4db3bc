"""Scores of flights whose errors are known by hand."""

import numpy as np
import pytest

from companion.core.types import Array
from companion.simulation.metrics import LOST_M, score
from companion.simulation.simulation import Trace


def trace_of(error_w_m: Array, sent: list[list[bool]], event: list[list[bool]]) -> Trace:
    """Two vehicles over four cycles, the trajectory begun with the third; `error_w_m` is (4, 2, 3)."""
    reference = np.full((4, 2, 3), 5.0)
    still = np.zeros((4, 2, 3))
    time_s = np.array([-0.02, -0.01, 0.0, 0.01])
    return Trace(
        time_s=time_s,
        position_w_m=reference + error_w_m,
        velocity_w_mps=still,
        reference_w_m=reference,
        reference_velocity_w_mps=still,
        accel_w_mps2=still,
        event=np.array(event),
        sent=np.array(sent),
    )


def errors() -> Array:
    return np.array(
        [
            [[0.9, 0.9, 0.9], [0.0, 0.0, 0.0]],
            [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
            [[0.1, -0.2, 0.0], [0.0, 0.3, 0.0]],
            [[-0.3, 0.2, 0.4], [0.0, -0.1, 0.0]],
        ]
    )


def test_errors_and_shares_of_the_trajectory_alone() -> None:
    sent = [[True, True], [True, False], [True, False], [False, False]]
    event = [[True, True], [True, False], [True, True], [True, False]]
    result = score(trace_of(errors(), sent, event))
    assert result.mean_error_m == pytest.approx(np.array([[0.2, 0.2, 0.2], [0.0, 0.2, 0.0]]))
    assert result.max_error_m == pytest.approx(np.array([[0.3, 0.2, 0.4], [0.0, 0.3, 0.0]]))
    assert result.error_m == pytest.approx([0.2 * np.sqrt(3.0), 0.2])
    assert result.update_share.tolist() == [0.5, 0.0]
    assert result.event_share.tolist() == [1.0, 0.5]
    assert result.diverged.tolist() == [False, False]


def test_counted_from_the_first_instant_if_that_is_wanted() -> None:
    none = [[False, False]] * 4
    result = score(trace_of(errors(), none, none), from_s=-0.02)
    assert result.mean_error_m[0] == pytest.approx([1.3 / 4, 1.3 / 4, 1.3 / 4])
    assert result.max_error_m[0] == pytest.approx([0.9, 0.9, 0.9])


@pytest.mark.parametrize("far", [LOST_M * 1.001, np.nan, np.inf])
def test_who_was_ever_lost_has_diverged_also_before_the_trajectory(far: float) -> None:
    error, none = errors(), [[False, False]] * 4
    error[1, 1, 2] = far
    assert score(trace_of(error, none, none)).diverged.tolist() == [False, True]
    error[1, 1, 2] = LOST_M * 0.999
    assert score(trace_of(error, none, none)).diverged.tolist() == [False, False]
