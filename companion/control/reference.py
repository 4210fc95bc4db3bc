"""Reference trajectories: smooth to the third derivative, as the paper's Property 2 asks."""

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from companion.types import Array, Reference


class Trajectory(Protocol):
    """A reference over time, counted from the trajectory's own start; held at its ends."""

    @property
    def duration_s(self) -> float:
        """When it stands still at its end."""

    def at(self, time_s: float) -> Reference:
        """The reference at `time_s`; before 0 the start, after the duration the end."""


@dataclass(frozen=True)
class Hold:
    """Stay where you are."""

    position_w_m: Array
    yaw_rad: float = 0.0
    duration_s: float = 0.0

    def at(self, time_s: float) -> Reference:  # noqa: ARG002
        """The one point."""
        zero = np.zeros(3)
        return Reference(self.position_w_m, zero, zero, self.yaw_rad)


@dataclass(frozen=True)
class MinimumJerk:
    """From one point and heading to another, at rest at the end and, unless told otherwise, at the start.

    Flash and Hogan, 1985. A move that begins in flight takes over the motion there, so that nothing jumps.
    """

    start_w_m: Array
    end_w_m: Array
    duration_s: float
    start_yaw_rad: float = 0.0
    end_yaw_rad: float = 0.0
    start_velocity_w_mps: Array = field(default_factory=lambda: np.zeros(3))
    start_acceleration_w_mps2: Array = field(default_factory=lambda: np.zeros(3))

    def at(self, time_s: float) -> Reference:
        """The point of the fifth-order polynomial at `time_s`."""
        x = min(max(time_s / self.duration_s, 0.0), 1.0)
        share = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        rate = 30.0 * x * x * (1.0 - x) ** 2 / self.duration_s
        bend = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / self.duration_s**2
        way = self.end_w_m - self.start_w_m
        turn = (self.end_yaw_rad - self.start_yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
        position, velocity, acceleration = self._run_out(x)
        yaw_rad = self.start_yaw_rad + share * float(turn)
        return Reference(
            self.start_w_m + share * way + position, rate * way + velocity, bend * way + acceleration, yaw_rad
        )

    def _run_out(self, x: float) -> tuple[Array, Array, Array]:
        """The quintics that begin with the start's velocity or acceleration and end with nothing (Hermite's basis)."""
        v, a, t = self.start_velocity_w_mps, self.start_acceleration_w_mps2, self.duration_s
        rest = (1.0 - x) ** 2
        position = t * x * rest * (1.0 - x) * (1.0 + 3.0 * x) * v + 0.5 * t * t * x * x * rest * (1.0 - x) * a
        velocity = rest * (1.0 + 2.0 * x - 15.0 * x * x) * v + 0.5 * t * x * rest * (2.0 - 5.0 * x) * a
        acceleration = -12.0 * x * (1.0 - x) * (3.0 - 5.0 * x) / t * v + (1.0 - x) * (1.0 - 8.0 * x + 10.0 * x * x) * a
        return position, velocity, acceleration


def minimum_jerk_duration_s(distance_m: float, speed_mps: float, accel_mps2: float, least_s: float = 1.0) -> float:
    """Shortest duration of a minimum-jerk move within a speed and an acceleration (peaks 15/8 and 10/sqrt(3))."""
    return max(least_s, 1.875 * distance_m / speed_mps, float(np.sqrt(5.7735 * distance_m / accel_mps2)))


@dataclass(frozen=True)
class LapTiming:
    """How a closed curve is run: laps at a period, with a smooth start and stop of the phase."""

    period_s: float = 15.0
    laps: int = 2
    ramp_s: float = 4.0

    @property
    def duration_s(self) -> float:
        """Start to standstill: each ramp covers half of what full speed would."""
        return self.laps * self.period_s + self.ramp_s

    def phase(self, time_s: float) -> tuple[float, float, float]:
        """Phase (rad) and its first two derivatives; its speed rises and falls as a minimum-jerk step."""
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
class Ellipse:
    """x = a cos, y = b sin about a centre at constant height and heading, beginning at (a, 0)."""

    centre_w_m: Array
    semi_axes_m: tuple[float, float] = (1.0, 0.6)
    timing: LapTiming = LapTiming()
    yaw_rad: float = 0.0

    @property
    def duration_s(self) -> float:
        """Start to standstill."""
        return self.timing.duration_s

    def at(self, time_s: float) -> Reference:
        """The point of the ellipse at `time_s`."""
        angle, rate, bend = self.timing.phase(time_s)
        a, b = self.semi_axes_m
        cosine, sine = np.cos(angle), np.sin(angle)
        point = np.array([a * cosine, b * sine, 0.0])
        along = np.array([-a * sine, b * cosine, 0.0])
        return Reference(self.centre_w_m + point, along * rate, along * bend - point * rate**2, self.yaw_rad)


@dataclass(frozen=True)
class FigureEight:
    """x = a sin, y = b sin 2: a lying eight through its centre, at constant height and heading."""

    centre_w_m: Array
    semi_axes_m: tuple[float, float] = (1.0, 0.5)
    timing: LapTiming = LapTiming()
    yaw_rad: float = 0.0

    @property
    def duration_s(self) -> float:
        """Start to standstill."""
        return self.timing.duration_s

    def at(self, time_s: float) -> Reference:
        """The point of the eight at `time_s`."""
        angle, rate, bend = self.timing.phase(time_s)
        a, b = self.semi_axes_m
        point = np.array([a * np.sin(angle), b * np.sin(2.0 * angle), 0.0])
        along = np.array([a * np.cos(angle), 2.0 * b * np.cos(2.0 * angle), 0.0])
        curve = np.array([-a * np.sin(angle), -4.0 * b * np.sin(2.0 * angle), 0.0])
        return Reference(self.centre_w_m + point, along * rate, along * bend + curve * rate**2, self.yaw_rad)


@dataclass(frozen=True)
class Shifted:
    """Another trajectory, begun at `start_s` of an outer clock."""

    inner: Trajectory
    start_s: float

    @property
    def duration_s(self) -> float:
        """End on the outer clock."""
        return self.start_s + self.inner.duration_s

    def at(self, time_s: float) -> Reference:
        """The inner reference at the outer time."""
        return self.inner.at(time_s - self.start_s)


def with_yaw(reference: Reference, yaw_rad: float) -> Reference:
    """The same motion with another heading."""
    return replace(reference, yaw_rad=yaw_rad)


@dataclass(frozen=True)
class Descent:
    """Down at a steady rate from rest or from a motion, for ever: the ground ends it."""

    start_w_m: Array
    velocity_w_mps: Array
    speed_mps: float
    yaw_rad: float
    ease_s: float = 1.5
    duration_s: float = float("inf")

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
        return Reference(position, velocity, (down - self.velocity_w_mps) * bend, self.yaw_rad)
