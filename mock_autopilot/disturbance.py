"""Wind, cables and whatever else pushes: a seeded force in world axes (N, NED)."""

import math
from dataclasses import dataclass

import numpy as np

from mock_autopilot.quaternion import Array

BLOCK = 1024
"""Random numbers are drawn in blocks; one at a time costs more than the physics they disturb."""


@dataclass(frozen=True)
class Sinusoid:
    """A slow periodic push."""

    amplitude_ned_n: tuple[float, float, float]
    period_s: float
    phase_rad: float = 0.0


@dataclass(frozen=True)
class Forces:
    """What the disturbance is made of."""

    constant_ned_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sinusoids: tuple[Sinusoid, ...] = ()
    noise_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviation of the Ornstein-Uhlenbeck part."""
    noise_time_s: float = 1.0
    """Its correlation time."""


class Disturbance:
    """Steps in fixed intervals; the same seed gives the same force."""

    def __init__(self, forces: Forces, rng: np.random.Generator, dt_s: float) -> None:
        self._forces = forces
        self._rng = rng
        self._constant = np.array(forces.constant_ned_n)
        self._amplitudes = np.array([wave.amplitude_ned_n for wave in forces.sinusoids]).reshape(-1, 3)
        self._rates = np.array([2.0 * math.pi / wave.period_s for wave in forces.sinusoids])
        self._phases = np.array([wave.phase_rad for wave in forces.sinusoids])
        self._keep = math.exp(-dt_s / forces.noise_time_s)
        self._fresh = np.array(forces.noise_n) * math.sqrt(1.0 - self._keep**2)
        self._noise = np.zeros(3)
        self._draws = np.empty((0, 3))
        self._next = 0

    def step(self, now_s: float) -> Array:
        """Force (N, NED, shape (3,)) of the step that ends at `now_s`."""
        if self._next >= len(self._draws):
            self._draws, self._next = self._rng.standard_normal((BLOCK, 3)), 0
        self._noise = self._keep * self._noise + self._fresh * self._draws[self._next]
        self._next += 1
        waves = np.sin(self._rates * now_s + self._phases) @ self._amplitudes
        return np.asarray(self._constant + waves + self._noise)
