"""A stand-in for EKF2: the autopilot's estimate of position, velocity and heading, with its errors.

Everything the autopilot does and reports uses this estimate. Its frame is the local NED frame whose
origin lies at the start position; without a yaw source it is turned against the world by `yaw_error_rad`.
Recorded behaviour: docs/px4-conformance.md, section h.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from mock_autopilot.physics.quaternion import Array
from mock_autopilot.px4.horizon import Horizon
from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.vision import VisionSample, wrap_rad

GPS_READY_S = 2.9
"""After boot; the flags of a GPS vehicle are complete at 3.0 s."""
VISION_SETTLE_S = 1.2
"""Time from the first vision sample to a position that PX4 trusts."""
VISION_LATE_S = 0.9
"""Silence after which the predicted-position flag goes."""
VISION_LOST_S = 4.58
"""Silence after which the position is no longer trusted; PX4 looks at it ten times a second."""
GLOBAL_LOST_S = 4.58
GLOBAL_SETTLE_S = 4.0
"""Time from SET_GPS_GLOBAL_ORIGIN to a usable global position."""
RESET_AFTER_S = 1.2
"""A rejected vision position is taken over as a jump after this long."""
REGAIN_AFTER_S = 0.3
"""After a loss the first position that is taken over."""
GATE_M = 0.6
"""Distance between estimate and vision beyond which a sample is rejected."""
DRIFT_MPS2 = (0.31, 0.14, 0.0)
"""Acceleration error without vision and with a perfect horizon: 11 m after 8 s, worst of three recorded losses."""
HASTE_PER_S = 1.6
"""Rate at which a position error fades, recorded with EKF2_EVP_NOISE = 0.1 m; it is 2.3 / s with 0.01 m."""
HASTE_EXPONENT = 0.17
PERFECT_GAINS = (10.0, 25.0)
"""Position (1/s) and velocity (1/s^2) per m of innovation where the horizon is perfect."""
RANGE_OFF_M = (0.1, 0.7)
"""Height error (too high) with a range finder as the height reference: 0.1 to 0.6 recorded, from take-off."""
RANGE_SETTLES_S = 1.5
LANDING_SHARE, LANDING_CLIMB_S = 0.3, 0.4
"""In PX4's own landings a range finder corrects the vertical speed: share that is left of its usual error, and time
constant with which the error at the begin fades. Recorded: 0.14 m/s (RMS) in hover, mean of a landing 0.01 to 0.03."""
BARO_PER_S, BARO_PER_S2 = 1.5, 1.0
"""Gains of the barometer on height and vertical speed while vision is lost."""
VELOCITY_GATE_MPS = 0.45
"""EKF2_EVV_GATE (3) times a standard deviation of 0.15 m/s: a velocity farther off fails its test."""
NAVIGATION_FAILS_S = 2.0
"""After failing this long in the air, the estimate is invalid (PX4's EstimatorChecks) until the vehicle stands."""
STANDING = (0.0, 0.0, 0.0)
HISTORY_STEP_S = 0.01
FARTHEST_M = 1e5
"""Positions beyond it (and NaN) are ignored."""


class Motion(NamedTuple):
    """The true motion that the inertial sensors measure: world frame, relative to the start position."""

    position_ned_m: tuple[float, float, float]
    velocity_ned_mps: tuple[float, float, float]
    acceleration_ned_mps2: tuple[float, float, float]
    yaw_rad: float


class Estimator:
    """The autopilot's estimate of position, velocity and heading."""

    def __init__(
        self,
        params: ParamTable,
        rng: np.random.Generator,
        start_yaw_rad: float,
        horizon: Horizon,
        range_off_m: float = 0.0,
    ) -> None:
        self._params = params
        self._rng = rng
        self.horizon = horizon
        self._range_off_m, self._height_off_m = range_off_m, 0.0
        self.position_m = [0.0, 0.0, 0.0]
        self.velocity_mps = [0.0, 0.0, 0.0]
        self.yaw_error_rad = 0.0 if self._has_magnetometer else -start_yaw_rad
        self.reset_counter = 0
        self.origin_set_s: float | None = None
        self.in_air = False
        self.at_rest = True
        self.range_ok = True
        """The range finder measures the height above the ground."""
        self.landing = False
        """PX4 lands the vehicle by itself."""
        self._now_s = 0.0
        self._gps_error_m = [0.0, 0.0, 0.0]
        self._fused_s = -math.inf
        self._since_s = math.inf
        self._rejected_since_s: float | None = None
        self._heard_s = -math.inf
        self._heard_since_s = math.inf
        self._vision_resets: int | None = None
        self._yaw_known = False
        self._velocity_wrong_s: float | None = None
        self.navigation_failed = False
        """Position and velocity contradict each other."""
        self._baro_off_m = 0.0
        self._history: deque[tuple[float, tuple[float, float, float]]] = deque(maxlen=40)

    @property
    def uses_gps(self) -> bool:
        """Return whether EKF2_GPS_CTRL lets the receiver be fused."""
        return int(self._params["EKF2_GPS_CTRL"]) != 0

    @property
    def _has_magnetometer(self) -> bool:
        return int(self._params["EKF2_MAG_TYPE"]) != 5

    @property
    def _vision_bits(self) -> int:
        return int(self._params["EKF2_EV_CTRL"])

    # -- what is trusted -------------------------------------------------------------------------

    @property
    def silence_s(self) -> float:
        """Return the time since a vision sample was fused, s."""
        return self._now_s - self._fused_s

    @property
    def local_ok(self) -> bool:
        """Return whether the horizontal position is good enough for PX4 to fly on."""
        if self.uses_gps:
            return self._now_s >= GPS_READY_S
        settled = self._now_s - self._since_s >= VISION_SETTLE_S
        return self.silence_s < VISION_LOST_S and settled and not self.navigation_failed

    @property
    def global_ok(self) -> bool:
        """Return whether, in addition, the position on earth is known."""
        if self.uses_gps:
            return self.local_ok
        settled = self.origin_set_s is not None and self._now_s - self.origin_set_s >= GLOBAL_SETTLE_S
        return settled and self.local_ok and self.silence_s < GLOBAL_LOST_S

    @property
    def flags(self) -> int:
        """Return ESTIMATOR_STATUS.flags as recorded: attitude, velocities, positions, predictions."""
        if self._now_s < 2.0:
            return 164 if self.uses_gps else 128
        flags = 1 | 4 | 32 | (64 if self.range_ok else 0) | (128 if self.at_rest else 0)
        if self.uses_gps:
            return flags | (2 | 8 | 16 | 256 | 512 if self._now_s >= GPS_READY_S else 0)
        if self.silence_s < VISION_LOST_S:
            flags |= 2 | 8 | (16 if self.origin_set_s is not None else 0)
        if self.silence_s < VISION_LATE_S and self._now_s - self._since_s >= 1.0:
            flags |= 256
        return flags

    # -- every step ------------------------------------------------------------------------------

    def step(self, now_s: float, motion: Motion, dt_s: float) -> None:
        """Advance to `now_s`: follow the receiver, or integrate the accelerometers."""
        self._now_s = now_s
        self.horizon.step(now_s, in_air=self.in_air, aided=self._aided)
        if not self.in_air:
            self.navigation_failed, self._velocity_wrong_s = False, None
        if self.uses_gps:
            self._follow_gps(motion, dt_s)
        elif self.in_air or self.silence_s < VISION_LOST_S:
            self._integrate(motion, dt_s)
        else:
            self.velocity_mps = [0.0, 0.0, 0.0]  # standing without any fix: PX4 assumes it stands still
        if not self._history or now_s - self._history[-1][0] >= HISTORY_STEP_S:
            x, y, z = self.position_m
            self._history.append((now_s, (x, y, z)))

    def _follow_gps(self, motion: Motion, dt_s: float) -> None:
        """Set the estimate to the truth plus a wandering error of about 0.1 m (Ornstein-Uhlenbeck, 10 s)."""
        noise = self._rng.standard_normal(3)
        for axis in range(3):
            error = self._gps_error_m[axis]
            error += -error * dt_s / 10.0 + 0.1 * math.sqrt(0.2 * dt_s) * float(noise[axis])
            self._gps_error_m[axis] = error
            self.position_m[axis] = motion.position_ned_m[axis] + error
            self.velocity_mps[axis] = motion.velocity_ned_mps[axis]

    def _integrate(self, motion: Motion, dt_s: float) -> None:
        ax, ay = turned(motion.acceleration_ned_mps2, self.yaw_error_rad)
        measured = (ax, ay, motion.acceleration_ned_mps2[2])
        north, east, down = self._wrong_mps2(measured, motion.yaw_rad, dt_s)
        if motion.velocity_ned_mps == STANDING:
            down = 0.0
        elif self.landing and int(self._params["EKF2_RNG_CTRL"]) and not self.horizon.perfect:
            down = LANDING_SHARE * down - (self.velocity_mps[2] - motion.velocity_ned_mps[2]) / LANDING_CLIMB_S
        for axis, wrong in enumerate((north, east, down)):
            self.velocity_mps[axis] += (measured[axis] + wrong) * dt_s
            self.position_m[axis] += self.velocity_mps[axis] * dt_s
        if int(self._params["EKF2_BARO_CTRL"]):
            self._follow_barometer(motion.position_ned_m[2], dt_s, alone=self.silence_s > REGAIN_AFTER_S)

    @property
    def _aided(self) -> bool:
        return self.uses_gps or self.silence_s <= REGAIN_AFTER_S

    def _wrong_mps2(
        self, measured_mps2: tuple[float, float, float], yaw_rad: float, dt_s: float
    ) -> tuple[float, float, float]:
        if self.horizon.perfect:
            return (0.0, 0.0, 0.0) if self._aided or not self.in_air else DRIFT_MPS2
        yaw_rad += self.yaw_error_rad
        return self.horizon.wrong_mps2(measured_mps2, yaw_rad, dt_s, aided=self._aided)

    def _follow_barometer(self, truth_z_m: float, dt_s: float, *, alone: bool) -> None:
        """Learn the barometer's offset while vision is there; `alone`, correct height and vertical speed by it."""
        error_m = self.position_m[2] - truth_z_m
        if not alone:
            self._baro_off_m = error_m
            return
        self.position_m[2] -= BARO_PER_S * (error_m - self._baro_off_m) * dt_s
        self.velocity_mps[2] -= BARO_PER_S2 * (error_m - self._baro_off_m) * dt_s

    # -- vision ----------------------------------------------------------------------------------

    def fuse_vision(self, sample: VisionSample, now_s: float, truth_yaw_rad: float) -> None:
        """Fuse one external pose, reject it, or jump to it."""
        bits = self._vision_bits
        if self.uses_gps or not bits & 1 or not all(abs(part) < FARTHEST_M for part in sample.position_ned_m):
            return
        self._note_heard(now_s)
        if bits & 8 and sample.yaw_rad is not None and math.isfinite(sample.yaw_rad):
            self._fuse_yaw(sample.yaw_rad, truth_yaw_rad)
        jump = self._jump_wanted(sample, now_s)
        if jump:
            self._reset_to(sample)
        elif jump is None:
            return
        else:
            self._correct(sample, now_s)
        self._fused_s = now_s
        self._rejected_since_s = None

    def _note_heard(self, now_s: float) -> None:
        if now_s - self._heard_s > VISION_LATE_S:
            self._heard_since_s = now_s
            self._since_s = now_s - (VISION_SETTLE_S if self.silence_s < VISION_LOST_S else 0.0)
        self._heard_s = now_s

    def _jump_wanted(self, sample: VisionSample, now_s: float) -> bool | None:
        """Return True to jump to the sample, False to fuse it, None to reject it for now."""
        known, self._vision_resets = self._vision_resets, sample.reset_counter
        if known is None or known != sample.reset_counter:
            return True
        if self.silence_s > VISION_LATE_S and self._rejected_since_s is None:
            return True if now_s - self._heard_since_s >= REGAIN_AFTER_S else None
        if math.dist(self.believed_m(sample), self._position_at(now_s)) < GATE_M:
            return False
        if self._rejected_since_s is None:
            self._rejected_since_s = now_s
        return True if now_s - self._rejected_since_s >= RESET_AFTER_S else None

    def believed_m(self, sample: VisionSample) -> tuple[float, float, float]:
        """Return a sample's position, NED in m; its height follows the range finder where that is the reference."""
        x, y, z = sample.position_ned_m
        return (x, y, z - self._height_off_m)

    def _reset_to(self, sample: VisionSample) -> None:
        self.position_m = list(self.believed_m(sample))
        self.velocity_mps = list(sample.velocity_ned_mps or (0.0, 0.0, 0.0))
        self.reset_counter += 1
        self._history.clear()

    def _correct(self, sample: VisionSample, now_s: float) -> None:
        """Correct position and velocity by a sample: second-order tracking, independent of the samples' rate."""
        dt_s = min(max(now_s - self._fused_s, 0.001), 0.1)
        before, (gain, velocity_gain) = self._position_at(now_s), self._gains
        self._settle_height(dt_s)
        seen = self.believed_m(sample)
        for axis in range(3):
            innovation = seen[axis] - before[axis]
            self.position_m[axis] += min(gain * dt_s, 0.5) * innovation
            self.velocity_mps[axis] += min(velocity_gain * dt_s, 1.0) * innovation
        if self._vision_bits & 4 and sample.velocity_ned_mps is not None and self._believes(sample.velocity_ned_mps):
            for axis in range(3):
                slip = sample.velocity_ned_mps[axis] - self.velocity_mps[axis]
                self.velocity_mps[axis] += min(10.0 * dt_s, 0.5) * slip

    @property
    def _gains(self) -> tuple[float, float]:
        """Return the gains of position (1/s) and velocity (1/s^2) for an innovation, by EKF2_EVP_NOISE."""
        if self.horizon.perfect:
            return PERFECT_GAINS
        haste = HASTE_PER_S * (0.1 / max(self._params["EKF2_EVP_NOISE"], 0.01)) ** HASTE_EXPONENT
        return haste, 0.5 * haste**2

    def _settle_height(self, dt_s: float) -> None:
        """Make the range finder the height reference from take-off on, if EKF2_RNG_CTRL allows it."""
        if self.in_air and not self.horizon.perfect and int(self._params["EKF2_RNG_CTRL"]):
            self._height_off_m += (self._range_off_m - self._height_off_m) * dt_s / RANGE_SETTLES_S

    def _believes(self, velocity_ned_mps: tuple[float, float, float]) -> bool:
        """Test a measured velocity; one that keeps failing in the air takes the position down with it."""
        if math.dist(velocity_ned_mps, self.velocity_mps) < VELOCITY_GATE_MPS:
            self._velocity_wrong_s = None
            return True
        if self._velocity_wrong_s is None:
            self._velocity_wrong_s = self._now_s
        self.navigation_failed |= self.in_air and self._now_s - self._velocity_wrong_s >= NAVIGATION_FAILS_S
        return False

    def _position_at(self, now_s: float) -> tuple[float, float, float]:
        """Return the estimated position when the sample was taken, EKF2_EV_DELAY ms ago."""
        taken_s = now_s - self._params["EKF2_EV_DELAY"] / 1000.0
        for at_s, position in reversed(self._history):
            if at_s <= taken_s + 1e-9 and taken_s < now_s:
                return position
        x, y, z = self.position_m
        return (x, y, z)

    def _fuse_yaw(self, yaw_rad: float, truth_yaw_rad: float) -> None:
        wrong = wrap_rad(yaw_rad - truth_yaw_rad - self.yaw_error_rad)
        self.yaw_error_rad = wrap_rad(self.yaw_error_rad + (0.05 * wrong if self._yaw_known else wrong))
        self._yaw_known = True

    def set_origin(self, now_s: float) -> None:
        """Set the time from which the local frame has an origin on earth (SET_GPS_GLOBAL_ORIGIN)."""
        self.origin_set_s = now_s


def turned(vector: tuple[float, float, float] | Array, yaw_rad: float) -> tuple[float, float]:
    """Return the horizontal part of a vector after a turn about the vertical by `yaw_rad`."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return (c * float(vector[0]) - s * float(vector[1]), s * float(vector[0]) + c * float(vector[1]))
