"""Carrying the disarmed vehicle by hand, to try the hand test without a vehicle. Pure."""

from dataclasses import replace

import numpy as np

from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.plant import PlantState
from mock_autopilot.physics.quaternion import Array

MOVE_S = 0.8
"""Duration of one move."""
_STILL = np.zeros(3)


class Handling:
    """A hand that holds the vehicle from the first `take_to` on, also in the air, until it is released."""

    def __init__(self) -> None:
        self._from = self._to = np.zeros(6)
        self._since_s = 0.0
        self.holds = False

    def take_to(self, where: Array, state: PlantState, time_s: float) -> None:
        """Carry it to x, y, z (m, NED) and roll, pitch, yaw (rad), together (6,), from where it is."""
        self._from = self._at(time_s) if self.holds else np.array([*state.position_ned_m, *_euler(state)])
        self._to, self._since_s, self.holds = where, time_s, True

    def carry(self, state: PlantState, time_s: float) -> PlantState:
        """Return the state at the hand's pose; the motion is too slow for the inertial sensors to measure."""
        at = self._at(time_s)
        return replace(
            state,
            position_ned_m=at[:3],
            velocity_ned_mps=_STILL,
            acceleration_ned_mps2=_STILL,
            q_ned_frd_wxyz=quat.from_euler(*at[3:].tolist()),
            rate_frd_radps=_STILL,
        )

    def _at(self, time_s: float) -> Array:
        share = min(1.0, (time_s - self._since_s) / MOVE_S)
        return np.asarray(self._from + (self._to - self._from) * share * share * (3.0 - 2.0 * share))


def _euler(state: PlantState) -> tuple[float, float, float]:
    roll, pitch, yaw = quat.to_euler(state.q_ned_frd_wxyz)
    return float(roll), float(pitch), float(yaw)
