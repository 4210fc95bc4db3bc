"""The simulated vehicle's true state, which the cameras see and every check is measured against."""

from typing import NamedTuple

from mock_autopilot.physics.quaternion import Array


class Truth(NamedTuple):
    """The vehicle at one instant of simulated time; world NED, body FRD, quaternion turns body into world."""

    time_s: float
    """Simulated seconds since the autopilot booted."""
    position_ned_m: Array
    """Shape (3,)."""
    velocity_ned_mps: Array
    """Shape (3,)."""
    q_ned_frd_wxyz: Array
    """Unit quaternion, shape (4,)."""
    rate_frd_radps: Array
    """Body rates, shape (3,)."""
    on_ground: bool
    """Standing on the floor."""
