"""The disturbance from motion and setpoints alone, without a law."""

import numpy as np
import pytest

from companion.control.controller import ControlInput
from companion.control.disturbance import MOST_MPS2, Disturbance, estimate_disturbance, no_disturbance
from companion.core.types import Array, Reference

ZERO = np.zeros(3)
DT_S = 0.01
PUSH_W_MPS2 = np.array([0.62, -0.41, 0.2])


def seen(velocity: Array, sent: Array) -> ControlInput:
    reference = Reference(ZERO, ZERO, ZERO, 0.0)
    return ControlInput(
        position_w_m=ZERO,
        velocity_w_mps=velocity,
        q_w_flu_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        rate_flu_radps=ZERO,
        age_s=0.01,
        reference=reference,
        sent_accel_w_mps2=sent,
        dt_s=DT_S,
    )


def estimated(push: Array, sent: Array, seconds: float) -> Disturbance:
    """Fly at rest for so long and then accelerate by what is left of `push` and `sent`."""
    first = seen(np.zeros_like(push), sent)
    estimate, velocity = no_disturbance(first), np.zeros_like(push)
    for _ in range(round(seconds / DT_S)):
        estimate = estimate_disturbance(estimate, seen(velocity, sent))
        velocity = velocity + (push + sent) * DT_S
    return estimate


def test_it_begins_with_none() -> None:
    np.testing.assert_array_equal(no_disturbance(seen(np.ones(3), np.ones(3))).accel_w_mps2, ZERO)


@pytest.mark.parametrize("sent", [ZERO, -PUSH_W_MPS2, np.array([1.0, 0.0, -0.5])], ids=["drifts", "hovers", "moves"])
def test_a_steady_push_is_found_whatever_is_sent_meanwhile(sent: Array) -> None:
    np.testing.assert_allclose(estimated(PUSH_W_MPS2, sent, 8.0).accel_w_mps2, PUSH_W_MPS2, atol=5e-3)


def test_a_batch_is_as_each_vehicle_alone() -> None:
    pushes = np.stack((PUSH_W_MPS2, -0.5 * PUSH_W_MPS2))
    together = estimated(pushes, np.zeros((2, 3)), 2.0)
    for row, push in enumerate(pushes):
        np.testing.assert_allclose(together.accel_w_mps2[row], estimated(push, ZERO, 2.0).accel_w_mps2, rtol=1e-12)


def test_what_no_wind_can_be_is_cut() -> None:
    np.testing.assert_allclose(estimated(np.array([0.0, 0.0, -9.0]), ZERO, 5.0).accel_w_mps2, [0.0, 0.0, -MOST_MPS2])
