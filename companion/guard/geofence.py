"""The box the vehicle must stay in, and how hard it must brake to stay there. Pure, single vehicle, plain floats."""

import math
from dataclasses import dataclass

from companion.core.types import Array

Three = tuple[float, float, float]
Range = tuple[float, float]
"""Least and largest acceleration along one axis that may be asked for, m/s^2."""
Allowed = tuple[Range, Range, Range]
"""Along x, y and z in W."""
_LEAST_S = 0.01
"""Half a reaction lasts a control cycle at least."""


@dataclass(frozen=True)
class Fence:
    """A box in W without a floor: coming down is always allowed.

    A speed v towards a face is legal where its stopping distance v t + v^2 / 2a is left, with the defaults:

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
    """Deceleration that is counted on."""
    reaction_s: float = 0.4
    """Until the vehicle begins to brake: the attitude loop's and all delays."""

    def beyond_m(self, position_w_m: Array) -> float:
        """How far outside a place (3,) is, largest over the faces, m; negative inside: the distance to the nearest."""
        x, y, z = position_w_m.tolist()
        (x0, y0), (x1, y1, z1) = self.low_m, self.high_m
        return float(max(x0 - x, x - x1, y0 - y, y - y1, z - z1))

    def stopping_point_w_m(self, position_w_m: Array, velocity_w_mps: Array) -> Three:
        """Where a vehicle at this place and velocity (3,) comes to rest: v t + v |v| / 2a further, axis by axis."""
        (x, y, z), (vx, vy, vz) = position_w_m.tolist(), velocity_w_mps.tolist()
        return self._stop_m(x, vx), self._stop_m(y, vy), self._stop_m(z, vz)

    def _stop_m(self, place_m: float, speed_mps: float) -> float:
        return place_m + speed_mps * self.reaction_s + speed_mps * abs(speed_mps) / (2.0 * self.braking_mps2)

    def allowed_accel_w_mps2(self, place_w_m: Three, velocity_w_mps: Three, carried_w_mps2: Three) -> Allowed:
        """What may be asked for along x, y and z, so that the vehicle comes to rest at a face at the latest.

        For the first half of the reaction the vehicle is `carried` on by what acts already, for the second by what is
        asked for now, and then it brakes. Where nothing is carried on and nothing asked for, the limit is passed
        exactly when the stopping point leaves the fence. NaN gives NaN.
        """
        (x, y, z), (vx, vy, vz), (ax, ay, az) = place_w_m, velocity_w_mps, carried_w_mps2
        (x0, y0), (x1, y1, z1) = self.low_m, self.high_m
        along_x, along_y = self._along(x, vx, ax, (x0, x1)), self._along(y, vy, ay, (y0, y1))
        return along_x, along_y, self._along(z, vz, az, (-math.inf, z1))

    def _along(self, place_m: float, speed_mps: float, carried_mps2: float, faces_m: tuple[float, float]) -> Range:
        lead_s = max(0.5 * self.reaction_s, _LEAST_S)
        then_m = place_m + (speed_mps + 0.5 * carried_mps2 * lead_s) * lead_s
        speed_mps += carried_mps2 * lead_s
        low_m, high_m = faces_m
        return -self._most_mps2(then_m - low_m, -speed_mps, lead_s), self._most_mps2(high_m - then_m, speed_mps, lead_s)

    def _most_mps2(self, left_m: float, speed_mps: float, for_s: float) -> float:
        """Largest acceleration towards a face, `left_m` away, for so long, from which braking still stops at it.

        With u the speed after it: left = (v + u) t / 2 + u^2 / 2a. Where not even that is left, u points inwards, the
        more the further beyond, as fast as the vehicle can stop again. Without a jump: it would rattle at the face.
        """
        at = self.braking_mps2 * for_s
        root = at * at - 4.0 * self.braking_mps2 * (speed_mps * for_s - 2.0 * left_m)
        end_mps = 0.5 * (math.copysign(math.sqrt(abs(root)), root) - at)
        return (end_mps - speed_mps) / for_s
