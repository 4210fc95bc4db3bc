"""The error of the autopilot's horizon: believed roll and pitch less the true ones, a slow walk of about a degree.

PX4 flies its attitude loop in the horizon it believes, so that the true attitude is off by this error, and reports the
believed one. The recorded flights are of PX4 v1.17.0 in simulation (SIH quadrotor of 1 kg, motion capture, no GPS),
2026-11-29, means of four samples at 100 Hz: less than 0.6 % of their power lies above 5 Hz.

The error is a turn about the body's x and y axes, as the bias of accelerometers turns with the body. It is drawn at
SAMPLE_HZ and linear in between.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from mock_autopilot.physics.components import maths
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.physics.quaternion_one import Four

SAMPLE_HZ = 25.0
RANDOM_SIZE_RAD = 0.021
"""1.2 degrees."""
COUNT_RAD = 1e-5
"""Unit of the recorded samples."""
RECORDED = Path(__file__).parents[1] / "data" / "attitude_error.npz"
BLOCK = 256
"""Samples drawn at once while a vehicle flies."""

AttitudeErrorSource = Literal["random", "px4-a", "px4-b", "px4-tight"]
"""A random walk, or a recorded flight; px4-tight had EKF2_EVP_NOISE = 0.01 and EKF2_EVA_NOISE = 0.05."""


@dataclass(frozen=True, kw_only=True)
class AttitudeErrorParams:
    """Error of the believed roll and pitch; `size_rad` and `time_s` may be arrays over a batch's vehicles, (...,)."""

    source: AttitudeErrorSource = "random"
    size_rad: float | Array | None = None
    """RMS of an axis; None: 1.2 degrees at random, a recorded flight as it was; 0: a perfect horizon."""
    time_s: float | Array = 5.0
    """Correlation time (1/e) of the random walk."""

    @property
    def present(self) -> bool:
        """Return True if any vehicle's horizon errs."""
        return bool(np.any(np.asarray(self.rms_rad) > 0.0))

    @property
    def rms_rad(self) -> float | Array:
        """Return the RMS of an axis, whether it was given or not."""
        if self.size_rad is not None:
            return self.size_rad
        return RANDOM_SIZE_RAD if self.source == "random" else recorded_rms_rad(self.source)


PERFECT_HORIZON = AttitudeErrorParams(size_rad=0.0)


@dataclass(frozen=True)
class Walk:
    """Random walks: after the sample `first`, (vehicles, 2), each is `keep` times the last plus `fresh` times a draw.

    `keep` and `fresh` are (vehicles,), `draws` (vehicles, samples, 2).
    """

    first: Array
    keep: Array
    fresh: Array
    draws: Array


class AttitudeErrorSamples:
    """The errors of vehicles side by side; each vehicle's come from its own generator, however many fly with it."""

    def __init__(self, params: AttitudeErrorParams, rngs: Sequence[np.random.Generator], lead: tuple[int, ...]) -> None:
        self._lead, self._rngs = lead, rngs
        if params.source == "random":
            self._size_rad = _each(params.rms_rad, len(rngs))
            self._keep = np.exp(-1.0 / (SAMPLE_HZ * _each(params.time_s, len(rngs))))
            self._now = self._size_rad * np.stack([rng.standard_normal(2) for rng in rngs])
            self._recorded: Array | None = None
        else:
            recorded = recorded_error_rad(params.source)
            self._size = _each(params.rms_rad, len(rngs)) / recorded_rms_rad(params.source)
            self._recorded = np.concatenate((recorded, recorded[::-1]))  # there and back again: no step at the ends
            self._at = np.array([rng.integers(len(self._recorded)) for rng in rngs])

    def more(self, count: int) -> Array:
        """Return the next samples (rad): believed less true roll and pitch, (count, *lead, 2)."""
        rows = self._walked(count) if self._recorded is None else self._read(self._recorded, count)
        return rows.reshape(count, *self._lead, 2)

    def walk(self, count: int) -> "Walk | None":
        """Return what `more` would work out, not worked out; None where a recorded flight is read."""
        if self._recorded is not None:
            return None
        draws = np.stack([rng.standard_normal((count, 2)) for rng in self._rngs])
        fresh = self._size_rad * np.sqrt(1.0 - self._keep**2)
        return Walk(self._now, self._keep[:, 0], fresh[:, 0], draws)

    def _walked(self, count: int) -> Array:
        draws = np.stack([rng.standard_normal((count, 2)) for rng in self._rngs], axis=1)
        fresh, rows = self._size_rad * np.sqrt(1.0 - self._keep**2), np.empty_like(draws)
        for row, draw in enumerate(draws):
            rows[row] = self._now
            self._now = self._keep * self._now + fresh * draw
        return rows

    def _read(self, recorded: Array, count: int) -> Array:
        index = (self._at + np.arange(count)[:, None]) % len(recorded)
        self._at = self._at + count
        return np.asarray(recorded[index] * self._size)


class AttitudeErrorWalk:
    """The error of one vehicle over time, drawn as far as it is asked for."""

    def __init__(self, params: AttitudeErrorParams, rng: np.random.Generator) -> None:
        self._samples = AttitudeErrorSamples(params, [rng], ())
        self._rows: list[list[float]] = []

    def at(self, time_s: float) -> tuple[float, float]:
        """Return believed less true roll and pitch (rad) at a time >= 0."""
        first = int(time_s * SAMPLE_HZ)
        while len(self._rows) < first + 2:
            self._rows += self._samples.more(BLOCK).tolist()
        share, (a, b), (c, d) = time_s * SAMPLE_HZ - first, self._rows[first], self._rows[first + 1]
        return a + share * (c - a), b + share * (d - b)


def turn_of(roll_rad: float, pitch_rad: float) -> Four:
    """Return a small error as the quaternion that turns the true attitude into the believed one: q_believed = q e."""
    x, y = 0.5 * roll_rad, 0.5 * pitch_rad
    per_length = 1.0 / maths(x).sqrt(1.0 + x * x + y * y)
    return per_length, x * per_length, y * per_length, 0.0


def turns_of(error_rad: Array) -> Array:
    """Return `turn_of` each error (..., 2), (..., 4), to the last bit."""
    half = 0.5 * error_rad
    per_length = 1.0 / np.sqrt(1.0 + half[..., 0] * half[..., 0] + half[..., 1] * half[..., 1])
    turns = np.zeros((*error_rad.shape[:-1], 4))
    turns[..., 0] = per_length
    turns[..., 1:3] = half * per_length[..., None]
    return turns


@cache
def recorded_error_rad(source: AttitudeErrorSource) -> Array:
    """Return a recorded flight's error of roll and pitch (rad), (n, 2), at SAMPLE_HZ."""
    with np.load(RECORDED) as stored:
        return np.asarray(stored[source] * COUNT_RAD)


def recorded_rms_rad(source: AttitudeErrorSource) -> float:
    """Return the RMS of an axis in a recorded flight, both axes together."""
    return math.sqrt(float((recorded_error_rad(source) ** 2).mean()))


def _each(value: float | Array, count: int) -> Array:
    """Return a value for each vehicle, (count, 1)."""
    return np.broadcast_to(np.asarray(value, dtype=float).reshape(-1, 1), (count, 1))
