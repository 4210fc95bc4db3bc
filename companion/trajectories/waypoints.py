"""Trajectory through timed waypoints: at rest at both ends, smooth to the third derivative between."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from companion.core.types import Array, Reference
from companion.trajectories.monotone import monotone_motion_at_knots


@dataclass(frozen=True)
class Waypoints:
    """Trajectory through waypoints: times (n,) from 0 (s), positions (n, 3) in W (m), headings (n,) (rad).

    A quintic spline: one fifth-order polynomial per segment, continuous up to snap at the waypoints, at rest with no
    acceleration at both ends. Between two waypoints at one position it stands still: it comes to rest at the
    first and starts from rest at the second. The heading takes the short way from one waypoint to the next, is smooth
    to its second derivative, and never turns beyond either of the two.
    """

    times_s: Array
    positions_w_m: Array
    yaws_rad: Array

    @property
    def duration_s(self) -> float:
        """Time of the last waypoint, s."""
        return float(self.times_s[-1])

    def at(self, time_s: float) -> Reference:
        """Return the reference of the spline at `time_s`, held at its ends."""
        t = min(max(time_s, 0.0), self.duration_s)
        segment = int(np.clip(np.searchsorted(self.times_s, t, side="right") - 1, 0, len(self.times_s) - 2))
        x = t - self.times_s[segment]
        position, velocity, acceleration = _powers(x) @ self._coefficients[segment]
        return Reference(position[:3], velocity[:3], acceleration[:3], float(position[3]))

    @cached_property
    def _coefficients(self) -> Array:
        """Coefficients (segments, 6, 4): each a quintic between positions, velocities and accelerations at its ends."""
        values = np.concatenate((self.positions_w_m, np.unwrap(self.yaws_rad)[:, None]), axis=1)
        spans, steps = np.diff(self.times_s), np.diff(values, axis=0)
        moving = _motion_at_knots(spans, steps[:, :3])
        turning = monotone_motion_at_knots(spans, steps[:, 3])
        motion = np.concatenate((moving, turning[:, :, None]), axis=2)
        v, a = motion[:, 0], motion[:, 1]
        h = spans[:, None]
        v0, v1, a0, a1 = v[:-1] * h, v[1:] * h, a[:-1] * h**2, a[1:] * h**2
        c3 = (20.0 * steps - 8.0 * v1 - 12.0 * v0 - 3.0 * a0 + a1) / (2.0 * h**3)
        c4 = (-30.0 * steps + 14.0 * v1 + 16.0 * v0 + 3.0 * a0 - 2.0 * a1) / (2.0 * h**4)
        c5 = (12.0 * steps - 6.0 * (v1 + v0) - a0 + a1) / (2.0 * h**5)
        return np.stack((values[:-1], v[:-1], 0.5 * a[:-1], c3, c4, c5), axis=1)


def _motion_at_knots(spans: Array, steps: Array) -> Array:
    """Return velocity and acceleration (n, 2, 3) at every waypoint for which jerk and snap are continuous.

    At rest at both ends, and where a step beside the waypoint is 0: a pause. A block-tridiagonal system, solved from
    one end to the other in a time linear in the number of waypoints, as the vehicle may be flying meanwhile.
    """
    count = len(spans)
    paused = (steps == 0.0).all(axis=1)
    motion = np.zeros((count + 1, 2, 3))
    gains, rests = np.zeros((count, 2, 2)), np.zeros((count, 2, 3))  # motion[k] = rests[k] - gains[k] @ motion[k + 1]
    for k in range(1, count):
        if paused[k - 1] or paused[k]:
            continue  # at rest, whatever comes next: both parts of the path are solved by themselves
        h, g = float(spans[k - 1]), float(spans[k])
        below = np.array([[-24.0 / h**2, -3.0 / h], [-168.0 / h**3, -24.0 / h**2]])
        here = np.array(
            [
                [36.0 / g**2 - 36.0 / h**2, 9.0 / h + 9.0 / g],
                [-192.0 / h**3 - 192.0 / g**3, 36.0 / h**2 - 36.0 / g**2],
            ]
        )
        above = np.array([[24.0 / g**2, -3.0 / g], [-168.0 / g**3, 24.0 / g**2]])
        wanted = np.array(
            [
                60.0 * steps[k] / g**3 - 60.0 * steps[k - 1] / h**3,
                -360.0 * steps[k] / g**4 - 360.0 * steps[k - 1] / h**4,
            ]
        )
        left = here - below @ gains[k - 1]
        gains[k], rests[k] = np.linalg.solve(left, above), np.linalg.solve(left, wanted - below @ rests[k - 1])
    for k in range(count - 1, 0, -1):
        motion[k] = rests[k] - gains[k] @ motion[k + 1]
    return motion


_ORDERS = np.arange(6.0)
_FACTORS = np.array([np.ones(6), _ORDERS, _ORDERS * (_ORDERS - 1.0)])
_EXPONENTS = np.maximum(_ORDERS - np.arange(3.0)[:, None], 0.0)


def _powers(x: float) -> Array:
    """Return (1, x, ..., x^5) and its first two derivatives, (3, 6)."""
    return _FACTORS * x**_EXPONENTS
