"""Baseline law of the paper: PID with feed-forward of the reference's acceleration (section 5.1)."""

from dataclasses import dataclass

import numpy as np

from companion.control.controller import ControlInput, ControlOutput
from companion.control.gains import PidGains
from companion.core.types import Array


@dataclass(frozen=True)
class PidMemory:
    """Acceleration of the integral (m/s^2), (..., 3)."""

    integral_mps2: Array


@dataclass(frozen=True)
class Pid:
    """Law U_c/m_t = -K_p e - K_i int e - K_d de/dt + p_d'' + g e_3, gains per kilogram; printed without gravity."""

    gains: PidGains

    @property
    def preview_s(self) -> float:
        """Preview of the reference, s: none."""
        return 0.0

    def initial(self, first: ControlInput) -> PidMemory:
        """Return the memory at lift-off: an integral of 0."""
        return PidMemory(np.zeros_like(first.position_w_m))

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> PidMemory:
        """Return the integral that compensates a known disturbance (m/s^2), (..., 3)."""
        most = self.gains.integral_max_mps2
        return PidMemory(np.clip(known_disturbance_w_mps2 + 0.0 * now.position_w_m, -most, most))

    def step(self, memory: PidMemory, now: ControlInput) -> tuple[PidMemory, ControlOutput]:
        """Return the memory and the command of one cycle; every cycle sends."""
        g, ref = self.gains, now.reference
        error = now.position_w_m - ref.position_w_m
        error_rate = now.velocity_w_mps - ref.velocity_w_mps
        grown = memory.integral_mps2 + g.ki_per_s3 * error * now.dt_s
        integral = np.clip(grown, -g.integral_max_mps2, g.integral_max_mps2)
        # u = U_c/m_t - g e_3, so the gravity the print leaves out cancels here and comes back with the conversion
        feedback = g.kp_per_s2 * error + integral + g.kd_per_s * error_rate
        accel = ref.acceleration_w_mps2 - feedback - now.known_accel_w_mps2
        event = np.ones((*error.shape[:-1], 1))
        return PidMemory(integral), ControlOutput(accel, event, {"x1": error, "integral_mps2": integral})
