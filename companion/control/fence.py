"""The box the vehicle must stay in, and where it would come to rest if it began to brake now. Pure, single vehicle."""

from dataclasses import dataclass

from companion.types import Array


@dataclass(frozen=True)
class Fence:
    """A box in W without a floor: coming down is always allowed."""

    low_m: tuple[float, float]
    """Least x and y."""
    high_m: tuple[float, float, float]
    """Largest x, y and z."""
    braking_mps2: float = 2.0
    """Deceleration that is counted on."""
    reaction_s: float = 0.3
    """Until the vehicle begins to brake: the attitude loop's and all delays."""

    def beyond_m(self, position_w_m: Array) -> float:
        """How far outside a place (3,) is, largest over the faces, m; negative inside: the distance to the nearest."""
        x, y, z = position_w_m.tolist()
        (x0, y0), (x1, y1, z1) = self.low_m, self.high_m
        return float(max(x0 - x, x - x1, y0 - y, y - y1, z - z1))

    def stopping_point_w_m(self, position_w_m: Array, velocity_w_mps: Array) -> tuple[float, float, float]:
        """Where a vehicle at this place and velocity (3,) comes to rest: v t + v |v| / 2a further, axis by axis."""
        x, y, z = (
            p + v * self.reaction_s + v * abs(v) / (2.0 * self.braking_mps2)
            for p, v in zip(position_w_m.tolist(), velocity_w_mps.tolist(), strict=True)
        )
        return x, y, z
