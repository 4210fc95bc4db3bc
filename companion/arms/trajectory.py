"""Joint trajectories: smooth to the acceleration, at rest before their start and after their end."""

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Protocol

import numpy as np

from companion.arms.quintic import Quintics, between
from companion.core.types import Array, JointMotion

Times = float | Array
"""One time, or an array (...,) of them: a motion is then (8,), or (..., 8)."""


class JointTrajectory(Protocol):
    """A joint motion over time, counted from its own start."""

    @property
    def duration_s(self) -> float:
        """Return the time at which it comes to rest at its end (s)."""

    @property
    def pieces_s(self) -> Array:
        """Times (n,) from 0 to the duration that part it into simple pieces: a polynomial, an eighth of a swing.

        Sampling each piece finds the extremes.
        """

    def at(self, time_s: Times) -> JointMotion:
        """Return the motion at `time_s`; before 0 the start at rest, after the duration the end at rest."""


def at_rest(position_rad: Array) -> JointMotion:
    """Return a motion that stands still at a pose (..., 8)."""
    nothing = np.zeros_like(position_rad)
    return JointMotion(position_rad, nothing, nothing)


@dataclass(frozen=True)
class Hold:
    """Stay at a pose (8,)."""

    position_rad: Array
    duration_s: float = 0.0

    @property
    def pieces_s(self) -> Array:
        """Its two ends."""
        return np.array([0.0, self.duration_s])

    def at(self, time_s: Times) -> JointMotion:
        """Return the one pose."""
        return at_rest(np.broadcast_to(self.position_rad, (*np.shape(time_s), *self.position_rad.shape)))


@dataclass(frozen=True)
class Waypoints:
    """Through poses (n, 8) at times (n,) from 0 (s), a quintic between each two, at rest at both ends.

    `stop` rests at each pose: minimum-jerk steps. Otherwise a pose is passed with the velocity and acceleration of the
    parabola through it and its neighbours, which follows densely sampled motions closely and swings out a little
    beyond sharp corners; where a short step meets a long one both are bounded, or the long one would swing out far. A
    joint that has the same angle in two poses stands still between them.
    """

    times_s: Array
    positions_rad: Array
    stop: bool = True

    @property
    def duration_s(self) -> float:
        """The last pose's time."""
        return float(self.times_s[-1])

    @property
    def pieces_s(self) -> Array:
        """The poses' times."""
        return self.times_s

    def at(self, time_s: Times) -> JointMotion:
        """Return the motion at `time_s`."""
        return self._curve.at(time_s)

    @cached_property
    def _curve(self) -> Quintics:
        poses, passing = self.positions_rad, self._passing()
        starts, ends = (
            JointMotion(poses[cut], passing.velocity_radps[cut], passing.acceleration_radps2[cut])
            for cut in (slice(None, -1), slice(1, None))
        )
        return Quintics(tuple(self.times_s.tolist()), between(starts, ends, np.diff(self.times_s)[:, None]))

    def _passing(self) -> JointMotion:
        poses, spans = self.positions_rad, np.diff(self.times_s)[:, None]
        velocity, acceleration = np.zeros_like(poses), np.zeros_like(poses)
        if not self.stop:
            before, after = spans[:-1], spans[1:]
            steps = np.diff(poses, axis=0)
            slope, longer = steps / spans, np.maximum(before, after)
            most = 2.0 * (np.abs(steps[:-1]) + np.abs(steps[1:])) / longer
            weighted = (before * slope[1:] + after * slope[:-1]) / (before + after)
            bend = 2.0 * (slope[1:] - slope[:-1]) / (before + after)
            moves = (steps[:-1] != 0.0) & (steps[1:] != 0.0)
            velocity[1:-1] = moves * np.clip(weighted, -most, most)
            acceleration[1:-1] = moves * np.clip(bend, -most / longer, most / longer)
        return JointMotion(poses, velocity, acceleration)


def minimum_jerk(start_rad: Array, end_rad: Array, duration_s: float) -> Waypoints:
    """Return the minimum-jerk motion from rest in one pose (8,) to another; Flash and Hogan, 1985."""
    return Waypoints(np.array([0.0, duration_s]), np.stack((start_rad, end_rad)))


@dataclass(frozen=True)
class Sinusoid:
    """centre + amplitude sin(2 pi t / period + phase), each (8,), faded in and out by minimum-jerk steps.

    The swings of the paper's experiments, but begun and ended at rest in the centre. A fade takes at most half of it.
    """

    centre_rad: Array
    amplitude_rad: Array
    period_s: Array
    phase_rad: Array
    duration_s: float
    fade_s: float = 2.0

    @property
    def pieces_s(self) -> Array:
        """Eighths of the quickest swing, and of each fade."""
        swings = np.linspace(0.0, self.duration_s, int(8.0 * self.duration_s / self.period_s.min()) + 2)
        fade = np.linspace(0.0, self._fade_s, 9)
        return np.unique(np.concatenate((swings, fade, self.duration_s - fade)))

    def at(self, time_s: Times) -> JointMotion:
        """Return the faded swing at `time_s`."""
        t = time_s[..., None] if isinstance(time_s, np.ndarray) else time_s
        share, rate, bend = self._fade(t)
        turn = 2.0 * np.pi / self.period_s
        sine = self.amplitude_rad * np.sin(t * turn + self.phase_rad)
        cosine = self.amplitude_rad * np.cos(t * turn + self.phase_rad) * turn
        return JointMotion(
            self.centre_rad + share * sine,
            rate * sine + share * cosine,
            (bend - share * turn * turn) * sine + 2.0 * rate * cosine,
        )

    @property
    def _fade_s(self) -> float:
        return min(self.fade_s, 0.5 * self.duration_s)

    def _fade(self, t: Times) -> tuple[Times, Times, Times]:
        """Return the share (0..1) of the swing at `t` (s), and its first two derivatives."""
        x: Times
        sign: Times
        if isinstance(t, np.ndarray):
            x = np.clip(np.minimum(t, self.duration_s - t) / self._fade_s, 0.0, 1.0)
            sign = np.where(2.0 * t < self.duration_s, 1.0, -1.0)
        else:
            x = min(max(min(t, self.duration_s - t) / self._fade_s, 0.0), 1.0)
            sign = 1.0 if 2.0 * t < self.duration_s else -1.0
        share = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        rate = sign * 30.0 * x * x * (1.0 - x) * (1.0 - x) / self._fade_s
        return share, rate, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / self._fade_s**2


@dataclass(frozen=True)
class Slowed:
    """Another trajectory at 1 / factor of its speed: velocities / factor, accelerations / factor^2."""

    inner: JointTrajectory
    factor: float

    @property
    def duration_s(self) -> float:
        """Longer by the factor."""
        return self.inner.duration_s * self.factor

    @property
    def pieces_s(self) -> Array:
        """The inner ones, stretched."""
        return np.asarray(self.inner.pieces_s * self.factor)

    def at(self, time_s: Times) -> JointMotion:
        """Return the inner motion, stretched."""
        motion = self.inner.at(time_s / self.factor)
        return JointMotion(
            motion.position_rad, motion.velocity_radps / self.factor, motion.acceleration_radps2 / self.factor**2
        )


@dataclass(frozen=True)
class InTurn:
    """One trajectory after another; each must begin at rest where the one before ends at rest."""

    parts: tuple[JointTrajectory, ...]

    @property
    def duration_s(self) -> float:
        """All of them."""
        return sum(part.duration_s for part in self.parts)

    @property
    def pieces_s(self) -> Array:
        """Those of the parts."""
        shifted = [part.pieces_s + start for part, start in zip(self.parts, self._starts_s, strict=True)]
        return np.unique(np.concatenate(shifted))

    def at(self, time_s: Times) -> JointMotion:
        """Return the motion of the part whose turn it is."""
        if isinstance(time_s, np.ndarray):
            return self._at_many(time_s)
        part = max(bisect_right(self._starts_s, time_s) - 1, 0)
        return self.parts[part].at(time_s - self._starts_s[part])

    @cached_property
    def _starts_s(self) -> tuple[float, ...]:
        return tuple(accumulate((part.duration_s for part in self.parts[:-1]), initial=0.0))

    def _at_many(self, time_s: Array) -> JointMotion:
        whose = np.maximum(np.searchsorted(self._starts_s, time_s, side="right") - 1, 0)
        out = self.parts[0].at(time_s)
        for number, (part, start_s) in enumerate(zip(self.parts[1:], self._starts_s[1:], strict=True), start=1):
            mine, theirs = (whose == number)[..., None], part.at(time_s - start_s)
            out = JointMotion(
                np.where(mine, theirs.position_rad, out.position_rad),
                np.where(mine, theirs.velocity_radps, out.velocity_radps),
                np.where(mine, theirs.acceleration_radps2, out.acceleration_radps2),
            )
        return out
