"""Faults of the autopilot itself while they are active; pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mock_autopilot.faults.catalogue import Kind
from mock_autopilot.faults.schedule import ActiveFault
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.airframe import ActuatorDemand
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.px4.vocabulary import Mode

TIPPING_RADPS2 = 1.5
"""Roll acceleration of a vehicle without control: four motors at fixed signals are never quite equal."""
CAUGHT_S = 0.75
"""PX4's rate controller integrates a constant pull away in MC_ROLLRATE_P / MC_ROLLRATE_I."""


@dataclass(frozen=True, kw_only=True)
class InjectedFaults:
    """The active faults of the autopilot, combined; the defaults are a healthy one."""

    powered: bool = True
    hung: bool = False
    refuses_offboard: bool = False
    refuses_land: bool = False
    ignores_setpoints: bool = False
    tilt_off_rad: float = 0.0
    """Its horizon is rolled by this against the true one, and it flies by it."""
    heading_off_rad: float = 0.0
    """Error of the heading estimate (estimated less true), which vision does not correct."""
    motor_roll_rad: float = 0.0
    """Initial roll away from the attitude setpoint."""
    motor_since_s: float = 0.0
    """Begin of the motor's fault on the autopilot's clock."""
    thrust_share: float = 1.0
    """Share of the healthy motors' thrust that is left."""

    def roll_off_rad(self, now_s: float) -> float:
        """Return the true roll less the setpoint's (rad) at `now_s` of the autopilot's clock."""
        pulled_rad = self.motor_roll_rad and self.motor_roll_rad * math.exp((self.motor_since_s - now_s) / CAUGHT_S)
        return pulled_rad - self.tilt_off_rad

    def refuses(self, mode: Mode) -> bool:
        """Return whether a command to change to this mode is rejected."""
        return (mode is Mode.OFFBOARD and self.refuses_offboard) or (mode is Mode.LAND and self.refuses_land)

    def lifeless(self, last: ActuatorDemand, rate_frd_radps: Array, since_s: float) -> ActuatorDemand:
        """Return the demand `since_s` after the autopilot died or hung: motors off, or the last signals unbalanced.

        `rate_frd_radps` are the body rates at that moment.
        """
        if not self.powered:
            return replace(last, signal=0.0, motors_on=False)
        return replace(last, rate_sp_frd_radps=rate_frd_radps + np.array([TIPPING_RADPS2 * since_s, 0.0, 0.0]))

    @property
    def running(self) -> bool:
        """Return whether the autopilot has power and does not hang."""
        return self.powered and not self.hung


HEALTHY = InjectedFaults()


def rolled(q_wxyz: Array, roll_rad: float) -> Array:
    """Return an attitude turned by `roll_rad` about its own x axis."""
    return quat.multiply(q_wxyz, quat.from_rotation_vector(np.array([roll_rad, 0.0, 0.0]))) if roll_rad else q_wxyz


def injected_faults_of(held: Sequence[ActiveFault], booted_s: float) -> InjectedFaults:
    """Combine the autopilot's active faults; it booted at `booted_s` of simulated time."""
    ways = {(one.fault.kind, one.fault.how) for one in held}
    magnitude = {one.fault.how: one.fault.magnitude for one in held}
    return InjectedFaults(
        powered=(Kind.OFF, "") not in ways and "reboot" not in magnitude,
        hung=(Kind.STUCK, "") in ways,
        refuses_offboard="refuses offboard" in magnitude,
        refuses_land="refuses to land" in magnitude,
        ignores_setpoints="ignores setpoints" in magnitude,
        tilt_off_rad=magnitude.get("attitude off", 0.0),
        heading_off_rad=magnitude.get("heading off", 0.0),
        motor_roll_rad=magnitude.get("motor", 0.0),
        motor_since_s=max((one.since_s - booted_s for one in held if one.fault.how == "motor"), default=0.0),
        thrust_share=magnitude.get("weak", 1.0),
    )
