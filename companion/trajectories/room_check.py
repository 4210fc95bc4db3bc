"""Check, before takeoff, that a trajectory stays in the room and within the speeds a vehicle can follow."""

from typing import NamedTuple, Protocol

import numpy as np

from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.trajectories.reference import Trajectory
from companion.trajectories.waypoints import Waypoints

_STEP_S = 0.01
_LEAST_A_SEGMENT = 8
"""Least number of instants in each segment between two waypoints."""


class RoomLimits(Protocol):
    """Limits of a trajectory: ranges in W (m), speeds and accelerations (SI)."""

    @property
    def x_m(self) -> tuple[float, float]:
        """Least and largest x (m)."""

    @property
    def y_m(self) -> tuple[float, float]:
        """Least and largest y (m)."""

    @property
    def z_m(self) -> tuple[float, float]:
        """Least and largest height (m)."""

    @property
    def max_speed_mps(self) -> float:
        """Largest speed (m/s)."""

    @property
    def max_accel_mps2(self) -> float:
        """Largest acceleration (m/s^2)."""

    @property
    def max_yaw_rate_radps(self) -> float:
        """Largest yaw rate (rad/s)."""

    @property
    def max_yaw_accel_radps2(self) -> float:
        """Largest yaw acceleration (rad/s^2)."""


class _Limit(NamedTuple):
    what: str
    most: float
    unit: str
    key: str


def instants_s(trajectory: Trajectory) -> Array:
    """Return the instants (s) that are checked: every 10 ms, and eight between each two waypoints, (n,)."""
    even = np.arange(0.0, trajectory.duration_s + _STEP_S, _STEP_S)
    if not isinstance(trajectory, Waypoints):
        return even
    short = np.flatnonzero(np.diff(trajectory.times_s) < _LEAST_A_SEGMENT * _STEP_S)
    shares = np.arange(_LEAST_A_SEGMENT + 1) / _LEAST_A_SEGMENT
    within = trajectory.times_s[short, None] + np.diff(trajectory.times_s)[short, None] * shares
    return np.unique(np.concatenate((even, within.ravel())).round(6))


def check_trajectory(trajectory: Trajectory, room: RoomLimits, name: str, times_s: Array | None = None) -> None:
    """Raise ConfigError with the instant at which it first leaves the room, or is fastest where that is too fast.

    `times_s` (n,): only these instants are checked, for callers that check in pieces; the motion of the heading is
    computed between them, so pieces should share two instants. NaN counts as outside.
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
                f"{name}: leaves the room: {where}, allowed is {least:g} to {largest:g} m (room.{label}_m)"
            )
    speed = np.linalg.norm([reference.velocity_w_mps for reference in references], axis=1)
    accel = np.linalg.norm([reference.acceleration_w_mps2 for reference in references], axis=1)
    _require(speed, times_s, _Limit("too fast", room.max_speed_mps, "m/s", "room.max_speed_mps"), name)
    _require(accel, times_s, _Limit("too sharp", room.max_accel_mps2, "m/s^2", "room.max_accel_mps2"), name)
    _check_heading(np.array([reference.yaw_rad for reference in references]), times_s, room, name)


def _check_heading(yaw_rad: Array, times_s: Array, room: RoomLimits, name: str) -> None:
    """Check yaw rate and acceleration by differences between the instants, as references do not contain them."""
    between_s = 0.5 * (times_s[1:] + times_s[:-1])
    rate = np.diff(np.unwrap(yaw_rad)) / np.diff(times_s)
    fast = _Limit("turns too fast", room.max_yaw_rate_radps, "rad/s", "room.max_yaw_rate_radps")
    _require(np.abs(rate), between_s, fast, name)
    accel = np.diff(rate) / np.diff(between_s)
    sharp = _Limit("turns too sharply", room.max_yaw_accel_radps2, "rad/s^2", "room.max_yaw_accel_radps2")
    _require(np.abs(accel), times_s[1:-1], sharp, name)


def _require(size: Array, times_s: Array, limit: _Limit, name: str) -> None:
    if size.size and not size.max() <= limit.most:
        row = int(np.argmax(size))
        raise ConfigError(
            f"{name}: {limit.what}: {size[row]:.2f} {limit.unit} at {times_s[row]:.2f} s, allowed is {limit.most:g} "
            f"({limit.key})"
        )
