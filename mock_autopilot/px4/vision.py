"""External poses (motion capture, visual odometry) as the estimator takes them."""

import math
from dataclasses import dataclass

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class VisionSample:
    """One pose in the local NED frame (m, rad), from VISION_POSITION_ESTIMATE or ODOMETRY."""

    position_ned_m: Triple
    yaw_rad: float | None
    velocity_ned_mps: Triple | None = None
    """None where the message carries none."""
    reset_counter: int = 0


def wrap_rad(angle_rad: float) -> float:
    """The same direction in (-pi, pi]."""
    return math.remainder(angle_rad, 2.0 * math.pi)
