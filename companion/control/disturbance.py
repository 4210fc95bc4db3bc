"""Disturbance of the vehicle, estimated independently of the law: measured acceleration less the one sent.

It contains everything that a law must compensate to stay in place: wind, an error of the autopilot's horizon, a wrong
hover thrust. Velocity and setpoints go through the same low pass, so nothing is differentiated: with
v_f' = (v - v_f)/T the filtered acceleration is (v - v_f)/T.
"""

import numpy as np

from companion.control.controller import ControlInput
from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import all_by_axis, maximum, minimum

AVERAGE_S = 1.0
"""Time constant of the low pass: a shorter one would take the turns of a trajectory for wind."""
FOLLOW_S = 0.2
"""First-order lag with which a setpoint is assumed to act; attitude loops and links need 0.15 to 0.3 s."""
MOST_MPS2 = 3.0
"""Largest estimate per axis: this vehicle could not hover in more wind."""


@value
class Disturbance:
    """Estimate (m/s^2), and the filtered velocity (m/s) and accelerations sent (m/s^2); each (..., 3) in W."""

    accel_w_mps2: Array
    velocity: Array
    acting: Array
    sent: Array


def no_disturbance(now: ControlInput) -> Disturbance:
    """Return the estimate at lift-off: no disturbance."""
    nothing = np.zeros_like(now.velocity_w_mps)
    return Disturbance(nothing, now.velocity_w_mps, nothing, nothing)


def estimate_disturbance(before: Disturbance, now: ControlInput) -> Disturbance:
    """Advance the estimate by one cycle; like `sent_accel_w_mps2` it does not contain the effect of the arms."""
    follow, share = minimum(now.dt_s / FOLLOW_S, 1.0), minimum(now.dt_s / AVERAGE_S, 1.0)

    def estimated(
        measured: Scalar, commanded: Scalar, velocity: Scalar, acting: Scalar, sent: Scalar
    ) -> tuple[Scalar, ...]:
        acting = acting + follow * (commanded - acting)
        sent = sent + share * (acting - sent)
        innovation = measured - velocity
        accel = minimum(maximum(innovation / AVERAGE_S - sent, -MOST_MPS2), MOST_MPS2)
        return accel, velocity + share * innovation, acting, sent

    vectors = now.velocity_w_mps, now.sent_accel_w_mps2, before.velocity, before.acting, before.sent
    return Disturbance(*all_by_axis(estimated, *vectors))
