"""What pushes the vehicle, estimated without any law: the acceleration measured less the one that was sent.

It is all that a law must counter to stay in place: wind, an error of the autopilot's horizon, a hover thrust that is
wrong. Velocity and setpoints go through the same low pass, so nothing is differentiated: with v_f' = (v - v_f)/T the
filtered acceleration is (v - v_f)/T.
"""

from typing import Any

import numpy as np

from companion.control.controller import ControlInput
from companion.core.types import Array
from companion.core.values import value
from companion.geometry.array_math import all_by_axis, maximum, minimum

AVERAGE_S = 1.0
"""Time constant of the low pass: with a shorter one the turns of a trajectory would be taken for wind."""
FOLLOW_S = 0.2
"""First-order lag with which a setpoint is taken to act; attitude loops and links need 0.15 to 0.3 s."""
MOST_MPS2 = 3.0
"""Per axis: more is no wind in which this vehicle could hover."""


@value
class Disturbance:
    """The estimate (m/s^2), and the velocity (m/s) and accelerations sent (m/s^2) as filtered; each (..., 3) in W."""

    accel_w_mps2: Array
    velocity: Array
    acting: Array
    sent: Array


def no_disturbance(now: ControlInput) -> Disturbance:
    """Return the estimate at lift-off: none."""
    nothing = np.zeros_like(now.velocity_w_mps)
    return Disturbance(nothing, now.velocity_w_mps, nothing, nothing)


def estimate_disturbance(before: Disturbance, now: ControlInput) -> Disturbance:
    """Advance the estimate by one cycle; `sent_accel_w_mps2` is without the arms' part, and so is the estimate."""
    follow, share = minimum(now.dt_s / FOLLOW_S, 1.0), minimum(now.dt_s / AVERAGE_S, 1.0)

    def estimated(measured: Any, asked: Any, velocity: Any, acting: Any, sent: Any) -> Any:
        acting = acting + follow * (asked - acting)
        sent = sent + share * (acting - sent)
        surprise = measured - velocity
        accel = minimum(maximum(surprise / AVERAGE_S - sent, -MOST_MPS2), MOST_MPS2)
        return accel, velocity + share * surprise, acting, sent

    vectors = now.velocity_w_mps, now.sent_accel_w_mps2, before.velocity, before.acting, before.sent
    return Disturbance(*all_by_axis(estimated, *vectors))
