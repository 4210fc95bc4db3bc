"""Error of the autopilot's estimated roll and pitch, and the acceleration errors that follow from it.

The error is a walk (attitude_error.py) whose share of its full size grows after take-off and fades on the ground, as in
the recorded flights: below 0.1 degrees before take-off, grown within seconds, 2 to 4 degrees at touchdown and half of
it 3 to 8 s later.
"""

import math

import numpy as np

from mock_autopilot.physics import quaternion_one
from mock_autopilot.physics.plant import GRAVITY_MPS2
from mock_autopilot.physics.quaternion_one import Four, Three
from mock_autopilot.px4.attitude_error import AttitudeErrorParams, AttitudeErrorWalk, turn_of

ON_GROUND_SHARE = 0.04
"""Share of the error in flight: 0.05 degrees."""
GROWS_S, FADES_S = 2.0, 5.0
STEP_S = 0.004
"""The error is updated as often as PX4's position loop runs."""
BLIND_PACE = 0.4
"""Speed of the walk without positions: then the gyroscopes alone turn the horizon."""
BIAS_S = 2.0
"""Time constant with which the estimator takes a constant acceleration error for the accelerometers' bias."""
VERTICAL_MPS2_PER_RAD = 7.0
"""Wrong vertical acceleration (RMS) for the size of the horizon's error: 0.15 m/s2 at 1.2 degrees."""
VERTICAL_TIME_S = 2.0


class Horizon:
    """Estimated less true roll and pitch over the time since boot."""

    def __init__(self, params: AttitudeErrorParams, rng: np.random.Generator) -> None:
        self.perfect = not params.present
        own, vertical = rng.spawn(2)
        size_rad = float(np.asarray(params.rms_rad))
        lift = AttitudeErrorParams(size_rad=VERTICAL_MPS2_PER_RAD * size_rad, time_s=VERTICAL_TIME_S)
        self._tilt, self._lift = AttitudeErrorWalk(params, own), AttitudeErrorWalk(lift, vertical)
        self._share, self._due_s, self._walked_s = ON_GROUND_SHARE, 0.0, 0.0
        self.error_rad = (0.0, 0.0)
        """Errors of roll and pitch."""
        self._vertical_mps2 = 0.0
        self._bias_mps2 = [0.0, 0.0, 0.0]

    def step(self, now_s: float, *, in_air: bool, aided: bool) -> None:
        """Advance to `now_s`; without aiding by vision or satellites nothing is learnt on the ground either."""
        if self.perfect or now_s < self._due_s - 1e-9:
            return
        self._due_s = now_s + STEP_S
        goal, time_s = (1.0, GROWS_S) if in_air else (ON_GROUND_SHARE, FADES_S if aided else math.inf)
        self._share += (goal - self._share) * STEP_S / time_s
        self._walked_s += STEP_S if aided or not in_air else BLIND_PACE * STEP_S
        roll, pitch = self._tilt.at(self._walked_s)
        self.error_rad = (roll * self._share, pitch * self._share)
        self._vertical_mps2 = self._lift.at(self._walked_s)[0] * self._share

    def true_setpoint(self, q_wxyz: Four) -> Four:
        """Return the true attitude of a vehicle whose estimate is at the setpoint `q_wxyz`."""
        w, x, y, z = turn_of(*self.error_rad)
        return quaternion_one.multiply(q_wxyz, (w, -x, -y, -z))

    def believed(self, q_wxyz: Four) -> Four:
        """Return the estimated attitude for the true one, `q_wxyz`."""
        return quaternion_one.multiply(q_wxyz, turn_of(*self.error_rad))

    def wrong_mps2(self, measured_mps2: Three, yaw_rad: float, dt_s: float, *, aided: bool) -> Three:
        """Return the error of the acceleration that the estimator integrates, in its frame (NED).

        `measured_mps2` is the true one in that frame. A constant error is learnt as a bias while positions come in.
        """
        if self.perfect:
            return (0.0, 0.0, 0.0)
        ax, ay, az = measured_mps2
        (roll, pitch), c, s = self.error_rad, math.cos(yaw_rad), math.sin(yaw_rad)
        wx, wy, lift = c * roll - s * pitch, s * roll + c * pitch, GRAVITY_MPS2 - az
        wrong = (-wy * lift, wx * lift, wx * ay - wy * ax + self._vertical_mps2)
        left = [wrong[axis] - self._bias_mps2[axis] for axis in range(3)]
        if aided:
            self._bias_mps2 = [self._bias_mps2[axis] + left[axis] * dt_s / BIAS_S for axis in range(3)]
        return (left[0], left[1], left[2])
