"""Geofence: the box the vehicle must stay in, and the braking that keeps it there. Pure, single vehicle, floats."""

import math
from dataclasses import dataclass

from companion.core.types import Array, Vec3
from companion.guard.braking import lead_s, most_accel_mps2

Range = tuple[float, float]
"""Least and largest acceleration that may be commanded along one axis, m/s^2."""
Allowed = tuple[Range, Range, Range]
"""Ranges along x, y and z in W."""


@dataclass(frozen=True)
class Fence:
    """Box in W without a floor: descending is always allowed.

    A speed v towards a face is allowed where the stopping distance v t + v^2 / 2a is left; with the defaults:

    ========================== ==== ==== ==== ==== ====
    speed towards it, m/s      0.5  0.8  1.0  1.5  2.0
    distance to the face, m    0.26 0.48 0.65 1.16 1.80
    ========================== ==== ==== ==== ==== ====
    """

    low_m: tuple[float, float]
    """Least x and y."""
    high_m: tuple[float, float, float]
    """Largest x, y and z."""
    braking_mps2: float = 2.0
    """Deceleration that the vehicle is assumed to reach."""
    reaction_s: float = 0.4
    """Time until the vehicle begins to brake: lag of the attitude loop and all delays."""

    def beyond_m(self, position_w_m: Array) -> float:
        """Return how far outside a position (3,) is (m), largest over the faces; negative inside."""
        x, y, z = position_w_m.tolist()
        (x0, y0), (x1, y1, z1) = self.low_m, self.high_m
        return float(max(x0 - x, x - x1, y0 - y, y - y1, z - z1))

    def stopping_point_w_m(self, position_w_m: Array, velocity_w_mps: Array) -> Vec3:
        """Return where a vehicle with this position and velocity (3,) comes to rest: v t + v |v| / 2a further."""
        (x, y, z), (vx, vy, vz) = position_w_m.tolist(), velocity_w_mps.tolist()
        return self._stop_m(x, vx), self._stop_m(y, vy), self._stop_m(z, vz)

    def _stop_m(self, position_m: float, speed_mps: float) -> float:
        return position_m + speed_mps * self.reaction_s + speed_mps * abs(speed_mps) / (2.0 * self.braking_mps2)

    def allowed_accel_w_mps2(self, position_w_m: Vec3, velocity_w_mps: Vec3, acting_w_mps2: Vec3) -> Allowed:
        """Return the accelerations allowed along x, y and z, so that the vehicle comes to rest at a face at the latest.

        For the first half of the reaction time the acceleration that acts already continues, for the second half the
        one commanded now acts, and then the vehicle brakes. Where both are zero, the limit is passed exactly when the
        stopping point leaves the fence. NaN gives NaN.
        """
        (x, y, z), (vx, vy, vz), (ax, ay, az) = position_w_m, velocity_w_mps, acting_w_mps2
        (x0, y0), (x1, y1, z1) = self.low_m, self.high_m
        along_x, along_y = self._along(x, vx, ax, (x0, x1)), self._along(y, vy, ay, (y0, y1))
        return along_x, along_y, self._along(z, vz, az, (-math.inf, z1))

    def _along(self, position_m: float, speed_mps: float, acting_mps2: float, faces_m: tuple[float, float]) -> Range:
        for_s, braking_mps2 = lead_s(self.reaction_s), self.braking_mps2
        then_m = position_m + (speed_mps + 0.5 * acting_mps2 * for_s) * for_s
        speed_mps += acting_mps2 * for_s
        low_m, high_m = faces_m
        least_mps2 = -most_accel_mps2(then_m - low_m, -speed_mps, for_s, braking_mps2)
        return least_mps2, most_accel_mps2(high_m - then_m, speed_mps, for_s, braking_mps2)


NO_FENCE = Fence((-math.inf, -math.inf), (math.inf, math.inf, math.inf))
"""For a vehicle that does not know its position at every cycle."""
