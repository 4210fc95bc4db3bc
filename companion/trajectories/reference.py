"""Reference trajectories, smooth to the third derivative, as Property 2 of the paper requires."""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from companion.core.types import Array, Reference, Scalar
from companion.geometry.array_math import all_by_axis

_Pair = tuple[float, float]


class Trajectory(Protocol):
    """Reference over time, counted from the trajectory's own start; held at its ends."""

    @property
    def duration_s(self) -> float:
        """Time at which it comes to rest at its end, s."""

    def at(self, time_s: float) -> Reference:
        """Return the reference at `time_s`; before 0 the start, after the duration the end."""


@dataclass(frozen=True)
class Hold:
    """Trajectory that stays at one position and heading."""

    position_w_m: Array
    yaw_rad: float = 0.0
    duration_s: float = 0.0

    def at(self, time_s: float) -> Reference:  # noqa: ARG002
        """Return the constant reference, at rest."""
        zero = np.zeros(3)
        return Reference(self.position_w_m, zero, zero, self.yaw_rad)


@dataclass(frozen=True, kw_only=True)
class MinimumJerk:
    """Minimum-jerk move from one point and heading to another, at rest at the end and, by default, at the start.

    Flash and Hogan, 1985. A move that begins in flight continues the present motion, so that nothing jumps.
    """

    start_w_m: Array
    end_w_m: Array
    duration_s: float
    start_yaw_rad: float = 0.0
    end_yaw_rad: float = 0.0
    start_velocity_w_mps: Array = field(default_factory=lambda: np.zeros(3))
    start_acceleration_w_mps2: Array = field(default_factory=lambda: np.zeros(3))
    start_yaw_rate_radps: float = 0.0

    def at(self, time_s: float) -> Reference:
        """Return the point of the fifth-order polynomial at `time_s`."""
        x = min(max(time_s / self.duration_s, 0.0), 1.0)
        share = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        rate = 30.0 * x * x * (1.0 - x) ** 2 / self.duration_s
        bend = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / self.duration_s**2
        turn = (self.end_yaw_rad - self.start_yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
        (p_v, v_v, a_v), (p_a, v_a, a_a) = self._run_out(x)

        def moved(start: Scalar, end: Scalar, v: Scalar, a: Scalar) -> tuple[Scalar, Scalar, Scalar]:
            way = end - start
            return (
                start + share * way + p_v * v + p_a * a,
                rate * way + v_v * v + v_a * a,
                bend * way + a_v * v + a_a * a,
            )

        begun = self.start_velocity_w_mps, self.start_acceleration_w_mps2
        position, velocity, acceleration = all_by_axis(moved, self.start_w_m, self.end_w_m, *begun)
        yaw_rad = self.start_yaw_rad + share * float(turn) + p_v * self.start_yaw_rate_radps
        return Reference(position, velocity, acceleration, yaw_rad)

    def _run_out(self, x: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return quintics with derivatives that begin with velocity or acceleration 1 and end at rest at 0.

        They are the Hermite basis.
        """
        t, left = self.duration_s, 1.0 - x
        of_velocity = (
            t * x * left**3 * (1.0 + 3.0 * x),
            left**2 * (1.0 + 2.0 * x - 15.0 * x * x),
            -12.0 * x * left * (3.0 - 5.0 * x) / t,
        )
        of_acceleration = (
            0.5 * t * t * x * x * left**3,
            0.5 * t * x * left**2 * (2.0 - 5.0 * x),
            left * (1.0 - 8.0 * x + 10.0 * x * x),
        )
        return of_velocity, of_acceleration


def minimum_jerk_duration_s(distance: float, speed: float, accel: float, least_s: float = 1.0) -> float:
    """Return the shortest duration of a minimum-jerk move within a speed and an acceleration.

    Distance in m, m/s and m/s^2, or angle in rad, rad/s and rad/s^2; peaks are 15/8 and 10/sqrt(3).
    """
    return max(least_s, 1.875 * distance / speed, float(np.sqrt(5.7735 * distance / accel)))


@dataclass(frozen=True)
class LapTiming:
    """Timing of a closed curve: laps at a period, with a smooth start and stop of the phase."""

    period_s: float = 15.0
    laps: int = 2
    ramp_s: float = 4.0

    @property
    def duration_s(self) -> float:
        """Time from start to rest: each ramp covers half of what full speed would."""
        return self.laps * self.period_s + self.ramp_s

    def phase(self, time_s: float) -> tuple[float, float, float]:
        """Return the phase (rad) and its first two derivatives; its speed rises and falls as a minimum-jerk step."""
        full = 2.0 * np.pi / self.period_s
        t = min(max(time_s, 0.0), self.duration_s)
        left = self.duration_s - t
        if left < self.ramp_s:
            angle, rate, bend = self._ramp(left)
            return 2.0 * np.pi * self.laps - full * angle, full * rate, -full * bend
        if t < self.ramp_s:
            angle, rate, bend = self._ramp(t)
            return full * angle, full * rate, full * bend
        return full * (t - 0.5 * self.ramp_s), full, 0.0

    def _ramp(self, t: float) -> tuple[float, float, float]:
        x = t / self.ramp_s
        angle = self.ramp_s * x**4 * (2.5 - 3.0 * x + x * x)
        return angle, x**3 * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * (1.0 - x) ** 2 / self.ramp_s


@dataclass(frozen=True)
class _LevelCurve:
    """Closed curve about a centre at constant height and heading, flown as `timing` says."""

    centre_w_m: Array
    semi_axes_m: tuple[float, float] = (1.0, 0.6)
    timing: LapTiming = LapTiming()
    yaw_rad: float = 0.0

    @property
    def duration_s(self) -> float:
        """Time from start to rest, s."""
        return self.timing.duration_s

    def at(self, time_s: float) -> Reference:
        """Return the point of the curve at `time_s`."""
        angle, rate, bend = self.timing.phase(time_s)
        (x, y), (x_1, y_1), (x_2, y_2) = self._point(angle)
        velocity = np.array((x_1 * rate, y_1 * rate, 0.0))
        acceleration = np.array((x_1 * bend + x_2 * rate**2, y_1 * bend + y_2 * rate**2, 0.0))
        return Reference(self.centre_w_m + np.array((x, y, 0.0)), velocity, acceleration, self.yaw_rad)

    def _point(self, angle: float) -> tuple[_Pair, _Pair, _Pair]:
        """Return x and y (m) at a phase (rad), and their first two derivatives by it."""
        raise NotImplementedError


@dataclass(frozen=True)
class Ellipse(_LevelCurve):
    """Ellipse x = a cos, y = b sin, beginning at (a, 0)."""

    def _point(self, angle: float) -> tuple[_Pair, _Pair, _Pair]:
        a, b = self.semi_axes_m
        x, y = a * math.cos(angle), b * math.sin(angle)
        return (x, y), (-a * math.sin(angle), b * math.cos(angle)), (-x, -y)


@dataclass(frozen=True)
class FigureEight(_LevelCurve):
    """Lying eight x = a sin, y = b sin 2, beginning at its centre."""

    semi_axes_m: tuple[float, float] = (1.0, 0.5)

    def _point(self, angle: float) -> tuple[_Pair, _Pair, _Pair]:
        a, b = self.semi_axes_m
        x, y = a * math.sin(angle), b * math.sin(2.0 * angle)
        return (x, y), (a * math.cos(angle), 2.0 * b * math.cos(2.0 * angle)), (-x, -4.0 * y)


@dataclass(frozen=True, kw_only=True)
class Descent:
    """Descent at a constant rate from rest or from a motion, without end: touchdown ends it."""

    start_w_m: Array
    velocity_w_mps: Array
    speed_mps: float
    yaw_rad: float
    ease_s: float = 1.5
    duration_s: float = float("inf")
    yaw_rate_radps: float = 0.0

    def at(self, time_s: float) -> Reference:
        """Blend from the velocity at the start to straight down, with a minimum-jerk share of the rate."""
        t = max(time_s, 0.0)
        x = min(t / self.ease_s, 1.0)
        share = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        bend = 30.0 * x * x * (1.0 - x) ** 2 / self.ease_s
        eased = self.ease_s * x**4 * (2.5 - 3.0 * x + x * x) + max(0.0, t - self.ease_s)
        down = np.array([0.0, 0.0, -self.speed_mps])
        position = self.start_w_m + down * eased + self.velocity_w_mps * (t - eased)
        velocity = down * share + self.velocity_w_mps * (1.0 - share)
        yaw_rad = self.yaw_rad + self.yaw_rate_radps * (t - eased)
        return Reference(position, velocity, (down - self.velocity_w_mps) * bend, yaw_rad)
