"""Effect of the arms' commanded motion on the vehicle, as an acceleration the law can subtract from its command.

Two things: the links' reaction force, and the tilt that their torque and the shifted centre of mass cause. The attitude
loop answers a torque like a setpoint, so a tilt of d / omega_n^2 is to be expected from an angular acceleration d; the
autopilot's own integrator trims a lasting torque out, which is a high-pass on d.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.arms.dynamics import com_shift_flu_m, reaction_force_b_n, reaction_torque_b_nm
from companion.arms.model import ArmModel
from companion.control.controller import VehicleModel
from companion.core.types import Array, JointMotion
from companion.geometry.array_math import stack, unstack


@dataclass(frozen=True)
class Airframe:
    """Properties that set the vehicle's response to forces and torques."""

    mass_kg: float
    gravity_mps2: float
    inertia_kgm2: tuple[float, float, float]
    attitude_bandwidth_radps: float
    integrator_s: float
    """Time constant with which the autopilot trims out a lasting torque."""


def turning_b_radps2(model: ArmModel, airframe: Airframe, motion: JointMotion) -> Array:
    """Return the angular acceleration that the arms cause, before any reaction to it, (..., 3), body FLU.

    The links' reaction, and the thrust, which in a hover is the weight, beside the centre of mass.
    """
    x, y, _ = unstack(com_shift_flu_m(model, motion.position_rad, airframe.mass_kg))
    weight_n = airframe.mass_kg * airframe.gravity_mps2
    lever = stack(-weight_n * y, weight_n * x, 0.0 * x)  # - r x m g e_3: what hangs in front pulls the nose down
    return np.asarray((reaction_torque_b_nm(model, motion) + lever) / np.array(airframe.inertia_kgm2))


def trimmed_b_radps2(trimmed: Array, turning: Array, airframe: Airframe, dt_s: float) -> Array:
    """Return the part of `turning` that the autopilot's integrator trims out after another `dt_s`."""
    return np.asarray(trimmed + (turning - trimmed) * -np.expm1(-dt_s / airframe.integrator_s))


def tilt_accel_b_mps2(untrimmed_b_radps2: Array, airframe: Airframe) -> Array:
    """Return the horizontal acceleration (..., 3) of the tilt that a torque holds against the attitude loop."""
    roll, pitch, _ = unstack(untrimmed_b_radps2 / airframe.attitude_bandwidth_radps**2)
    return stack(airframe.gravity_mps2 * pitch, -airframe.gravity_mps2 * roll, 0.0 * roll)


def force_accel_b_mps2(model: ArmModel, airframe: Airframe, across: JointMotion, upward: JointMotion) -> Array:
    """Return the acceleration (..., 3) by the links' reaction force: x, y of one motion, z of the other."""
    ahead, above = (reaction_force_b_n(model, motion) / airframe.mass_kg for motion in (across, upward))
    (x, y, _), (_, _, z) = unstack(ahead), unstack(above)
    return stack(x, y, z)


@dataclass(frozen=True)
class Leads:
    """Times after which a setpoint sent now acts, less the servos' own delay (s)."""

    across_s: float
    """Through the attitude loop, a second-order lag, late by 2 zeta / omega."""
    upward_s: float
    """Through the rotors' first-order lag."""
    turning_s: float
    """A torque meets the same attitude loop as the setpoint that is to counter it: only the delay counts."""


def leads_of(vehicle: VehicleModel, servo_lag_s: float) -> Leads:
    """Return the leads of a vehicle whose joints follow their goals `servo_lag_s` late."""
    across_s = vehicle.setpoint_delay_s + 2.0 * vehicle.attitude_damping / vehicle.attitude_bandwidth_radps
    upward_s = vehicle.thrust_delay_s + vehicle.thrust_lag_s
    return Leads(across_s - servo_lag_s, upward_s - servo_lag_s, vehicle.setpoint_delay_s - servo_lag_s)


class ArmFeedforward:
    """Acceleration that the arms' commanded motion gives the vehicle, cycle by cycle, less what is trimmed out."""

    def __init__(
        self, model: ArmModel, airframe: Airframe, leads: Leads, period_s: float, with_tilt: bool = True
    ) -> None:
        self._model, self._airframe, self._leads = model, airframe, leads
        self._period_s, self._with_tilt = period_s, with_tilt
        self.reset()

    def reset(self) -> None:
        """Begin as on the ground, with nothing trimmed out."""
        self._trimmed_b = np.zeros(3)

    def step(self, motion_at: Callable[[float], JointMotion], time_s: float) -> Array:
        """Return the acceleration (3,), body FLU, when a setpoint of `time_s` has its effect; once a cycle."""
        leads = self._leads
        across, upward = motion_at(time_s + leads.across_s), motion_at(time_s + leads.upward_s)
        force = force_accel_b_mps2(self._model, self._airframe, across, upward)
        if not self._with_tilt:
            return force
        turning = turning_b_radps2(self._model, self._airframe, motion_at(time_s + leads.turning_s))
        self._trimmed_b = trimmed_b_radps2(self._trimmed_b, turning, self._airframe, self._period_s)
        return np.asarray(force + tilt_accel_b_mps2(turning - self._trimmed_b, self._airframe))
