"""Truths for the tests of the mock's Qualisys end."""

from collections.abc import Iterator

import numpy as np

from mock_autopilot.physics.quaternion import Array
from mock_autopilot.physics.truth import Truth

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
STEP_S = 0.002


def truth_at(
    time_s: float,
    position_ned_m: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
    q_ned_frd_wxyz: Array = LEVEL,
    velocity_ned_mps: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Truth:
    """A truth that does not rotate."""
    position, velocity = np.asarray(position_ned_m, float), np.asarray(velocity_ned_mps, float)
    return Truth(time_s, position, velocity, q_ned_frd_wxyz, np.zeros(3), False)


def flight(for_s: float, from_s: float = 0.0) -> Iterator[Truth]:
    """Truths every 2 ms, flying north at 1 m/s."""
    for k in range(round(for_s / STEP_S)):
        time_s = from_s + k * STEP_S
        yield truth_at(time_s, (time_s, 0.0, -1.0), velocity_ned_mps=(1.0, 0.0, 0.0))
