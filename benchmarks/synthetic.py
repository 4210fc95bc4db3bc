"""Made-up inputs for the pure stages: a vehicle that follows an ellipse, with errors of centimetres and degrees."""

from dataclasses import dataclass

import numpy as np

from companion.control.controller import ControlInput
from companion.core.types import Array, AttitudeThrust, MocapFrame, Reference, VehicleState
from companion.geometry.frames import matrix_from_quat, quat_from_rotation_vector
from companion.trajectories.reference import Ellipse

AGE_S = 0.01
_TRAJECTORY = Ellipse(np.array([0.0, 0.0, 1.2]))


@dataclass(frozen=True)
class Motion:
    """Motion of synthetic vehicles; `phase_rad` (*lead, 3) makes each one different."""

    phase_rad: Array
    period_s: float

    def input(self, cycle: int) -> ControlInput:
        """Return the inputs of the law in one cycle."""
        vehicle, reference = self.vehicle(cycle), self.reference(cycle)
        asked = np.asarray(0.5 * np.sin(2.0 * cycle * self.period_s + self.phase_rad))
        return ControlInput(
            position_w_m=vehicle.position_w_m,
            velocity_w_mps=vehicle.velocity_w_mps,
            q_w_flu_wxyz=vehicle.q_w_flu_wxyz,
            rate_flu_radps=vehicle.rate_flu_radps,
            age_s=AGE_S,
            reference=reference,
            sent_accel_w_mps2=asked,
            dt_s=self.period_s,
        )

    def vehicle(self, cycle: int) -> VehicleState:
        """Near the reference, rocking: 2 cm at 2 rad/s, 3 degrees at 3 rad/s."""
        time_s, phase, reference = cycle * self.period_s, self.phase_rad, self.reference(cycle)
        tilt = 0.05 * np.sin(3.0 * time_s + phase)
        return VehicleState(
            time_s,
            reference.position_w_m + 0.02 * np.sin(2.0 * time_s + phase),
            reference.velocity_w_mps + 0.04 * np.cos(2.0 * time_s + phase),
            quat_from_rotation_vector(tilt),
            np.asarray(0.15 * np.cos(3.0 * time_s + phase)),
        )

    def reference(self, cycle: int) -> Reference:
        """The ellipse, the same for every vehicle."""
        at, like = _TRAJECTORY.at(5.0 + cycle * self.period_s), np.zeros_like(self.phase_rad)
        return Reference(
            like + at.position_w_m, like + at.velocity_w_mps, like + at.acceleration_w_mps2, at.yaw_rad + 0.3
        )

    def frame(self, cycle: int) -> MocapFrame:
        """Return the motion-capture frame of one vehicle, with 0.3 mm of noise."""
        vehicle = self.vehicle(cycle)
        noise_m = np.random.default_rng(cycle).normal(0.0, 3e-4, 3)
        rotation = matrix_from_quat(vehicle.q_w_flu_wxyz)
        stamp_s = cycle * self.period_s
        return MocapFrame(
            frame=cycle,
            stamp_s=stamp_s,
            received_s=stamp_s + AGE_S,
            position_w_m=vehicle.position_w_m + noise_m,
            rotation_w_b=rotation,
            residual_m=5e-4,
        )

    def setpoint(self, cycle: int) -> AttitudeThrust:
        """A setpoint inside all limits, near the one before it."""
        tilt = 0.1 * np.sin(1.5 * cycle * self.period_s + self.phase_rad)
        return AttitudeThrust(quat_from_rotation_vector(tilt), 0.5 + 0.05 * np.asarray(tilt[..., 0]))


def motion(lead: tuple[int, ...], period_s: float) -> Motion:
    """One vehicle, or as many as `lead` says."""
    phase_rad = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, (*lead, 3))
    return Motion(phase_rad, period_s)
