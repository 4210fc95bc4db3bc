"""Whether a trajectory stays in the room and is one that a vehicle can follow: asked before takeoff."""

import numpy as np

from companion.config import RoomConfig
from companion.control.reference import Trajectory
from companion.ports import ConfigError
from companion.types import Array

_STEP_S = 0.01


def instants_s(trajectory: Trajectory) -> Array:
    """The instants at which it is looked at, every 10 ms, (n,)."""
    return np.arange(0.0, trajectory.duration_s + _STEP_S, _STEP_S)


def check_trajectory(trajectory: Trajectory, room: RoomConfig, name: str, times_s: Array | None = None) -> None:
    """Look at it; ConfigError with the first instant at which it leaves the room or goes too fast.

    `times_s` (n,): only at these instants, for whoever has to look at it in pieces. What is no number is outside.
    """
    times_s = instants_s(trajectory) if times_s is None else times_s
    references = [trajectory.at(float(time_s)) for time_s in times_s]
    position = np.array([reference.position_w_m for reference in references])
    for axis, (label, (least, largest)) in enumerate((("x", room.x_m), ("y", room.y_m), ("z", room.z_m))):
        inside = (position[:, axis] >= least) & (position[:, axis] <= largest)
        if not inside.all():
            row = int(np.argmin(inside))
            where = f"{label} = {position[row, axis]:.2f} m at {times_s[row]:.2f} s"
            raise ConfigError(
                f"{name}: leads out of the room: {where}, allowed is {least:g} to {largest:g} m (room.{label}_m)"
            )
    speeds = np.array([reference.velocity_w_mps for reference in references])
    _within(speeds, room.max_speed_mps, times_s, f"{name}: too fast", "m/s (room.max_speed_mps)")
    accels = np.array([reference.acceleration_w_mps2 for reference in references])
    _within(accels, room.max_accel_mps2, times_s, f"{name}: too sharp", "m/s^2 (room.max_accel_mps2)")


def _within(vectors: Array, most: float, times_s: Array, what: str, unit: str) -> None:
    size = np.linalg.norm(vectors, axis=1)
    if not size.max() <= most:
        row = int(np.argmax(size))
        raise ConfigError(f"{what}: {size[row]:.2f} at {times_s[row]:.2f} s, allowed is {most:g} {unit}")
