"""Flies the mock's vehicle along the recorded way with the recorded setpoints.

Sent as recorded they would not hold it there: two plants drift apart. So each keeps its time and its thrust and
attitude, and in the air a pull towards where the recorded vehicle was is added. What PX4 tells depends on when
setpoints come, on whether the thrust is idle and on where the ground is: all three are as recorded.
"""

import math
from collections.abc import Sequence

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.plant import GRAVITY_MPS2
from mock_autopilot.physics.truth import Truth
from tests.mock_autopilot.reenact.session import Pose, Setpoint

PULL_PER_S2, BRAKE_PER_S = 4.0, 3.0
MOST_MPS2 = 3.0
"""Limit of the pull."""
AIRBORNE_M = 0.05
IDLE_SHARE = 0.7
"""Less than this share of the hover thrust is no flying: a ramp on the ground, or the end of a landing."""
SEEN_WITHIN_S = 0.15
"""Longest time to the nearest recorded pose from which the vehicle's position is known."""
SLOPE_S = 0.05


class Flyer:
    """Setpoints for the mock, from the recorded setpoints and poses."""

    def __init__(self, poses: Sequence[Pose], hover_thrust: float) -> None:
        self._times_s = np.array([pose.at_s for pose in poses])
        self._places_m = np.array([pose.position_m for pose in poses]).reshape(-1, 3)
        self._hover_thrust = hover_thrust

    def message(self, recorded: Setpoint, truth: Truth) -> mavlink.MAVLink_message:
        """Return the SET_ATTITUDE_TARGET to send now in place of the recorded one."""
        q_wxyz, thrust = recorded.q_wxyz, recorded.thrust
        if self._flies(recorded):
            q_wxyz, thrust = self._pulled(recorded, truth)
        return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, list(q_wxyz), 0.0, 0.0, 0.0, thrust)

    def _flies(self, recorded: Setpoint) -> bool:
        if not self._times_s.size or recorded.thrust < IDLE_SHARE * self._hover_thrust:
            return False
        seen = np.abs(self._times_s - recorded.at_s).min() <= SEEN_WITHIN_S
        return bool(seen and -self._place_m(recorded.at_s)[2] > AIRBORNE_M)

    def _place_m(self, at_s: float) -> np.ndarray:
        return np.array([np.interp(at_s, self._times_s, axis) for axis in self._places_m.T])

    def _pulled(self, recorded: Setpoint, truth: Truth) -> tuple[tuple[float, float, float, float], float]:
        """Return attitude and thrust with the pull added, the heading as recorded."""
        at_s = recorded.at_s
        velocity_mps = (self._place_m(at_s + SLOPE_S) - self._place_m(at_s - SLOPE_S)) / (2.0 * SLOPE_S)
        pull = PULL_PER_S2 * (self._place_m(at_s) - truth.position_ned_m)
        pull += BRAKE_PER_S * (velocity_mps - truth.velocity_ned_mps)
        pull *= min(1.0, MOST_MPS2 / max(float(np.linalg.norm(pull)), 1e-9))
        down = quat.to_matrix(np.array(recorded.q_wxyz))[:, 2]
        force = pull - down * recorded.thrust / self._hover_thrust * GRAVITY_MPS2
        share = float(np.linalg.norm(force)) / GRAVITY_MPS2
        yaw_rad = float(quat.yaw_of(np.array(recorded.q_wxyz)))
        return _towards(force, yaw_rad), min(share * self._hover_thrust, 1.0)


def _towards(force: np.ndarray, yaw_rad: float) -> tuple[float, float, float, float]:
    """Return the attitude whose thrust points along `force` (NED), with this heading."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    forward, right = c * force[0] + s * force[1], -s * force[0] + c * force[1]
    pitch = math.atan2(-forward, -force[2])
    roll = math.atan2(right, math.hypot(forward, force[2]))
    w, x, y, z = quat.from_euler(roll, pitch, yaw_rad).tolist()
    return (w, x, y, z)
