"""Disturbance force of wind, cables and the like: seeded, in world axes (N, NED)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from mock_autopilot.physics.quaternion import Array
from mock_autopilot.physics.quaternion_one import Three

BLOCK = 1024
"""Random numbers are drawn in blocks; one at a time costs more than the physics they disturb."""


@dataclass(frozen=True)
class Sinusoid:
    """One sinusoidal component of the force."""

    amplitude_ned_n: tuple[float, float, float]
    """Largest force, world NED."""
    period_s: float
    """Time of one cycle."""
    phase_rad: float = 0.0
    """Phase at the start."""


@dataclass(frozen=True)
class Forces:
    """The components of the disturbance: constant, sinusoids, noise."""

    constant_ned_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sinusoids: tuple[Sinusoid, ...] = ()
    noise_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviation of the Ornstein-Uhlenbeck part."""
    noise_time_s: float = 1.0
    """Its correlation time."""


class Disturbance:
    """The force over time in fixed steps; the same seed gives the same force."""

    def __init__(self, forces: Forces, rng: np.random.Generator, dt_s: float) -> None:
        self._forces = forces
        self._rng = rng
        self._keep = math.exp(-dt_s / forces.noise_time_s)
        self._fresh = [sigma * math.sqrt(1.0 - self._keep**2) for sigma in forces.noise_n]
        self._noise = [0.0, 0.0, 0.0]
        self._draws: list[list[float]] = []

    def step(self, now_s: float) -> Array:
        """Return the force (N, NED, shape (3,)) of the step that ends at `now_s`."""
        return np.array(self.step_one(now_s))

    def step_one(self, now_s: float) -> Three:
        """Do what `step` does, in floats."""
        if not self._draws:
            self._draws = self._rng.standard_normal((BLOCK, 3)).tolist()
        draw = self._draws.pop()
        force = list(self._forces.constant_ned_n)
        for axis in range(3):
            self._noise[axis] = self._keep * self._noise[axis] + self._fresh[axis] * draw[axis]
            force[axis] += self._noise[axis]
        for wave in self._forces.sinusoids:
            swing = math.sin(2.0 * math.pi * now_s / wave.period_s + wave.phase_rad)
            for axis in range(3):
                force[axis] += swing * wave.amplitude_ned_n[axis]
        x, y, z = force
        return x, y, z


def force_series(forces: Forces, rngs: Sequence[np.random.Generator], dt_s: float, steps: int) -> Array:
    """Return the forces (N, NED, (steps, vehicles, 3)) of the first `steps` steps, equal to Disturbance.step's.

    Each vehicle draws its own noise from its generator, as a Disturbance with it would; all else is the same for all.
    """
    keep, fresh = noise_of(forces, dt_s)
    noise = np.stack([_draws(rng, steps) for rng in rngs], axis=1) * fresh
    for before, now in pairwise(noise):
        now += keep * before  # noqa: PLW2901 - in place
    noise += steady_series(forces, dt_s, steps)[:, None]
    return noise


def noise_of(forces: Forces, dt_s: float) -> tuple[float, Array]:
    """Return the share of the noise that a step keeps, and the deviation (N) of what it adds, (3,)."""
    keep = math.exp(-dt_s / forces.noise_time_s)
    return keep, np.array(forces.noise_n) * math.sqrt(1.0 - keep**2)


@lru_cache(maxsize=8)
def steady_series(forces: Forces, dt_s: float, steps: int) -> Array:
    """Return the force that is no noise (N, NED, (steps, 3))."""
    time_s = np.arange(1, steps + 1) * dt_s
    steady = np.tile(forces.constant_ned_n, (steps, 1))
    for wave in forces.sinusoids:
        swing = np.sin(2.0 * math.pi * time_s / wave.period_s + wave.phase_rad)
        steady += swing[:, None] * np.array(wave.amplitude_ned_n)
    return steady


def _draws(rng: np.random.Generator, steps: int) -> Array:
    """Return random numbers (steps, 3), each block from its end, as Disturbance takes them."""
    blocks = [rng.standard_normal((BLOCK, 3))[::-1] for _ in range(-(-steps // BLOCK))]
    return np.concatenate(blocks)[:steps]
