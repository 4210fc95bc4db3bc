"""The paper's baseline: PID with the reference's acceleration fed forward (section 5.1)."""

from dataclasses import dataclass

import numpy as np

from companion.control.controller import ControlInput, ControlOutput, VehicleModel
from companion.control.gains import PidGains
from companion.types import Array


@dataclass(frozen=True)
class PidMemory:
    """Force of the integral (N), (..., 3)."""

    integral_n: Array


@dataclass(frozen=True)
class Pid:
    """U_c = -K_p e - K_i int e - K_d de/dt + m_t p_d'' + m_t g e_3; the paper prints it without gravity."""

    gains: PidGains
    vehicle: VehicleModel

    @property
    def preview_s(self) -> float:
        """The baseline looks at the present."""
        return 0.0

    def initial(self, first: ControlInput) -> PidMemory:
        """An empty integral."""
        return PidMemory(np.zeros_like(first.position_w_m))

    def step(self, memory: PidMemory, now: ControlInput) -> tuple[PidMemory, ControlOutput]:
        """One cycle; every cycle sends."""
        g, ref = self.gains, now.reference
        error = now.position_w_m - ref.position_w_m
        error_rate = now.velocity_w_mps - ref.velocity_w_mps
        grown = memory.integral_n + g.ki * error * now.dt_s
        integral = np.clip(grown, -g.integral_max_n, g.integral_max_n)
        force = -g.kp * error - integral - g.kd * error_rate + self.vehicle.mass_kg * ref.acceleration_w_mps2
        # u = U_c/m_t - g e_3, so the gravity the print leaves out cancels here and comes back with the conversion
        accel = force / self.vehicle.mass_kg - now.known_accel_w_mps2
        event = np.ones((*error.shape[:-1], 1))
        signals = {"x1": error, "integral_n": integral}
        return PidMemory(integral), ControlOutput(accel, event, signals)
