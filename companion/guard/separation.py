"""Separation: the cylinder around each other vehicle, and the braking that keeps this one out. Pure, floats.

Each vehicle brakes for its own part of the speed at which two of them come together, and counts on the other's doing
the same: at the surface of the cylinder both are at rest.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from companion.core.types import OtherVehicle, Vec3
from companion.guard.braking import lead_s, most_accel_mps2

_ROUNDS = 4
"""Rounds in which an acceleration is brought behind all walls in turn; three vehicles need two."""
_DEEPEST_M = 0.3
"""Depth inside the cylinder from which the vehicle backs away no faster: at 1.3 m/s from one that stands still."""
_DRIFTS_AFTER_S, _DRIFT_MPS2, _DRIFT_M = 0.3, 0.25, 3.0
"""Time after which one that is not seen may be without motion capture itself, and how it may move then.

PX4 lands it by an estimate of the position that gets worse, or by none: the wind drives it, 2.6 m in the five seconds
from a height of 2.3 m to the floor.
"""
_LEFT_ALONE_S = 0.6
"""Time for which an acceleration sideways towards another vehicle may last whatever is commanded next.

PX4 keeps the last setpoint until it takes the link for lost (COM_OF_LOSS_T) and lands.
"""
_ON_AXIS_M = 1e-3
"""Horizontal distance below which no direction leads away from the other."""


@dataclass(frozen=True)
class Wall:
    """Largest acceleration (m/s^2) that may be commanded along one horizontal direction."""

    x: float
    y: float
    most_mps2: float

    def beyond_mps2(self, x_mps2: float, y_mps2: float) -> float:
        """Return by how much an acceleration exceeds it; negative behind the wall."""
        return x_mps2 * self.x + y_mps2 * self.y - self.most_mps2


@dataclass(frozen=True)
class Walls:
    """Accelerations that other vehicles leave: walls sideways, and a range of the vertical one (m/s^2)."""

    sideways: tuple[Wall, ...] = ()
    least_up_mps2: float = -math.inf
    most_up_mps2: float = math.inf

    def let(self, accel_w_mps2: Vec3) -> bool:
        """Return True for an acceleration that no wall is in the way of."""
        x, y, z = accel_w_mps2
        return self.least_up_mps2 <= z <= self.most_up_mps2 and all(w.beyond_mps2(x, y) <= 0.0 for w in self.sideways)

    def behind(self, x_mps2: float, y_mps2: float, full_mps2: float) -> tuple[float, float]:
        """Return the horizontal acceleration nearest to this one behind all walls; itself if it is there.

        No wall asks for more than `full_mps2`. Between walls that contradict each other it is the mean of what they
        ask for, so that the vehicle is not pushed from one to the other.
        """
        if not self.sideways:
            return x_mps2, y_mps2
        asked = list[tuple[float, float]]()
        for _ in range(_ROUNDS):
            asked.clear()
            for wall in self.sideways:
                beyond = x_mps2 * wall.x + y_mps2 * wall.y - max(wall.most_mps2, -full_mps2)
                if beyond > 0.0:
                    x_mps2, y_mps2 = x_mps2 - beyond * wall.x, y_mps2 - beyond * wall.y
                asked.append((x_mps2, y_mps2))
        if len(asked) == 1 or asked[0] == asked[-1]:
            return x_mps2, y_mps2
        return sum(x for x, _ in asked) / len(asked), sum(y for _, y in asked) / len(asked)

    def tangent_first(self, x_mps2: float, y_mps2: float, room_mps2: float) -> tuple[float, float]:
        """Return a horizontal acceleration of at most `room_mps2` that loses its part along the strictest wall first.

        What the tilt limit leaves goes to braking.
        """
        if math.hypot(x_mps2, y_mps2) <= room_mps2 or not self.sideways:
            return x_mps2, y_mps2
        wall = min(self.sideways, key=lambda one: one.most_mps2)
        out = max(-room_mps2, min(room_mps2, x_mps2 * wall.x + y_mps2 * wall.y))
        along, most = y_mps2 * wall.x - x_mps2 * wall.y, math.sqrt(room_mps2 * room_mps2 - out * out)
        along = max(-most, min(most, along))
        return out * wall.x - along * wall.y, out * wall.y + along * wall.x


NO_WALLS = Walls()
"""For a vehicle that is alone."""


@dataclass(frozen=True, kw_only=True)
class Separation:
    """Cylinder around another vehicle's origin that this one's origin must stay out of.

    Two vehicles are apart while they are `radius_m` apart horizontally, or `height_m` vertically. Which of the two
    keeps them apart is the one with more room left to brake: both vehicles compute the same, as it depends on their
    relative motion alone. So a vehicle may cross above another one, but not sink onto it.
    """

    radius_m: float = 1.2
    height_m: float = 1.6
    parked_height_m: float = 1.0
    """Height of the cylinder while the other stands on the ground: no rotor turns there."""
    braking_mps2: float = 2.0
    """Deceleration that each vehicle is assumed to reach."""
    reaction_s: float = 0.4
    """Time until a vehicle begins to brake: lag of the attitude loop and all delays."""

    def widened(self, by_m: float) -> "Separation":
        """Return the same with a cylinder that is wider and higher by a margin (m)."""
        radius_m, height_m, parked_height_m = self.radius_m + by_m, self.height_m + by_m, self.parked_height_m + by_m
        return replace(self, radius_m=radius_m, height_m=height_m, parked_height_m=parked_height_m)

    @property
    def lowered(self) -> "Separation":
        """The same for a vehicle that is itself parked: between the two no air streams down on a turning rotor."""
        return replace(self, height_m=self.parked_height_m)

    def gap_m(self, position_w_m: Vec3, other: OtherVehicle) -> float:
        """Return the distance between a position and the other's cylinder (m); negative inside."""
        return self.gap_between_m(position_w_m, other.position_w_m, other.parked)

    def gap_between_m(self, position_w_m: Vec3, other_w_m: Vec3, parked: bool) -> float:
        """Return the distance between a position and the cylinder around another (m); negative inside."""
        (x, y, z), (ox, oy, oz) = position_w_m, other_w_m
        return max(math.hypot(ox - x, oy - y) - self.radius_m, abs(oz - z) - self.height_over_m(parked))

    def height_over_m(self, parked: bool) -> float:
        """Return the cylinder's height (m) for another one that is parked, or flies."""
        return self.parked_height_m if parked else self.height_m

    def walls(
        self, position_w_m: Vec3, velocity_w_mps: Vec3, acting_w_mps2: Vec3, others: Iterable[OtherVehicle]
    ) -> Walls:
        """Return what the others allow a vehicle on which an acceleration acts; NaN positions of others allow all."""
        sideways, least, most = list[Wall](), -math.inf, math.inf
        for other in others:
            wall = self._wall(position_w_m, velocity_w_mps, acting_w_mps2, other)
            if isinstance(wall, Wall):
                sideways.append(wall)
            elif wall is not None:
                least, most = max(least, wall[0]), min(most, wall[1])
        return Walls(tuple(sideways), least, most)

    def stop_m(self, speed_mps: float) -> float:
        """Return the distance in which a vehicle comes to rest from a speed towards something; 0 if it moves away."""
        if not speed_mps > 0.0:
            return 0.0
        return speed_mps * self.reaction_s + speed_mps * speed_mps / (2.0 * self.braking_mps2)

    def _wall(
        self, position: Vec3, velocity: Vec3, acting: Vec3, other: OtherVehicle
    ) -> Wall | tuple[float, float] | None:
        (x, y, z), (ox, oy, oz), (vx, vy, vz) = position, other.position_w_m, velocity
        ux, uy, uz = other.velocity_w_mps
        dx, dy, dz = ox - x, oy - y, oz - z
        if not math.isfinite(dx + dy + dz + ux + uy + uz):
            return None
        apart_m, up = math.hypot(dx, dy), math.copysign(1.0, dz)
        above_m, climb, sinks_m = abs(dz) - self.height_over_m(other.parked), vz * up, self.stop_m(-uz * up)
        if apart_m < _ON_AXIS_M:
            return self._floor(above_m, sinks_m, climb, acting[2] * up, up)
        nx, ny = dx / apart_m, dy / apart_m
        drift_m = self._drift_m(other)
        closing, comes_m = vx * nx + vy * ny, self.stop_m(-ux * nx - uy * ny)
        beside_m = apart_m - self.radius_m - drift_m
        if drift_m == 0.0 and above_m - sinks_m - self.stop_m(climb) > beside_m - comes_m - self.stop_m(closing):
            return self._floor(above_m, sinks_m, climb, acting[2] * up, up)
        left_m = max(beside_m, -_DEEPEST_M) - comes_m
        acting_mps2 = acting[0] * nx + acting[1] * ny
        most_mps2 = self._most_mps2(left_m, closing, acting_mps2)
        if most_mps2 > 0.0:
            most_mps2 = min(most_mps2, max(self._most_mps2(left_m, closing, acting_mps2, _LEFT_ALONE_S), 0.0))
        return Wall(nx, ny, most_mps2)

    def _drift_m(self, other: OtherVehicle) -> float:
        """Return how far (m) to keep from where one that is not seen is believed, beyond the radius; at any height.

        As far as it may have drifted, unless it stood, and the distance in which one comes to rest from its drift.
        """
        if other.parked or other.unseen_s < _DRIFTS_AFTER_S:
            return 0.0
        drifted_m, speed_mps = 0.5 * _DRIFT_MPS2 * other.unseen_s**2, _DRIFT_MPS2 * other.unseen_s
        return min(drifted_m + self.stop_m(speed_mps), _DRIFT_M)

    def _floor(
        self, above_m: float, sinks_m: float, climb_mps: float, acting_mps2: float, up: float
    ) -> tuple[float, float]:
        most = self._most_mps2(max(above_m, -_DEEPEST_M) - sinks_m, climb_mps, acting_mps2)
        return (-math.inf, most) if up > 0.0 else (-most, math.inf)

    def _most_mps2(self, left_m: float, speed_mps: float, acting_mps2: float, lasts_s: float = 0.0) -> float:
        """Return the most acceleration towards the other, after the one that acts has acted (Fence)."""
        for_s = lead_s(self.reaction_s)
        left_m -= (speed_mps + 0.5 * acting_mps2 * for_s) * for_s
        return most_accel_mps2(left_m, speed_mps + acting_mps2 * for_s, lasts_s or for_s, self.braking_mps2)
