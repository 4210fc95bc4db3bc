"""Frames of known motions for the estimator's tests."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from companion.core.types import Array, MocapFrame
from companion.estimation.estimator import EstimatorParams, EstimatorState, step
from companion.geometry.frames import matrix_from_quat, quat_from_rotation_vector, quat_multiply

OFFSET_S = 300.0
"""Our clock minus the cameras'."""
DELAY_S = 0.010
PARAMS = EstimatorParams(delay_s=DELAY_S)
NOISELESS = replace(PARAMS, drop_repeats=False)


@dataclass(frozen=True)
class Sway:
    """Along x and about the nose, both as sines of one frequency; everything else rests."""

    radps: float
    speed_mps: float = 0.5
    tilt_rad: float = 0.2

    def position_m(self, t: float) -> Array:
        return np.array([self.speed_mps / self.radps * np.sin(self.radps * t), 0.0, 1.0])

    def velocity_mps(self, t: float) -> Array:
        return np.array([self.speed_mps * np.cos(self.radps * t), 0.0, 0.0])

    def acceleration_mps2(self, t: float) -> Array:
        return np.array([-self.speed_mps * self.radps * np.sin(self.radps * t), 0.0, 0.0])

    def q(self, t: float) -> Array:
        return quat_from_rotation_vector(np.array([self.tilt_rad * np.sin(self.radps * t), 0.0, 0.0]))

    def rate_radps(self, t: float) -> Array:
        return np.array([self.tilt_rad * self.radps * np.cos(self.radps * t), 0.0, 0.0])


def frame(
    number: int, position_m: Iterable[float] = (0.0, 0.0, 1.0), q: Array | None = None, stamp_s: float | None = None
) -> MocapFrame:
    """One frame, level unless told; 10 ms apart."""
    stamp_s = 0.01 * number if stamp_s is None else stamp_s
    rotation = np.eye(3) if q is None else matrix_from_quat(q)
    position = np.array(list(position_m), dtype=float)
    return MocapFrame(
        frame=number,
        stamp_s=stamp_s,
        received_s=stamp_s + OFFSET_S + DELAY_S,
        position_w_m=position,
        rotation_w_b=rotation,
        residual_m=0.0005,
    )


def lost(number: int) -> MocapFrame:
    """A frame without the body."""
    nan = float("nan")
    return replace(frame(number), position_w_m=np.full(3, nan), rotation_w_b=np.full((3, 3), nan), residual_m=nan)


def noisy(sway: Sway, count: int, seed: int = 1, noise_m: float = 3e-4, noise_rad: float = 2e-3) -> list[MocapFrame]:
    """Frames as the cameras see them, with errors of normal size."""
    rng = np.random.default_rng(seed)

    def seen(k: int) -> MocapFrame:
        turned = quat_multiply(sway.q(0.01 * k), quat_from_rotation_vector(noise_rad * rng.normal(size=3)))
        return frame(k, sway.position_m(0.01 * k) + noise_m * rng.normal(size=3), turned)

    return [seen(k) for k in range(count)]


def followed(
    frames: Iterable[MocapFrame],
    params: EstimatorParams = PARAMS,
    state: EstimatorState | None = None,
    accel_input: Callable[[float], Array] | None = None,
) -> list[EstimatorState]:
    """The estimator's states after each of the frames."""
    states = []
    state = state or EstimatorState()
    for taken in frames:
        known = accel_input(taken.stamp_s - 0.005) if accel_input is not None else None
        state = step(state, taken, params, known)
        states.append(state)
    return states
