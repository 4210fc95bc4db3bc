"""What is wrong with the autopilot itself while its faults hold; pure."""

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
"""Four motors at fixed signals are never quite equal: so fast it begins to roll when nobody balances it."""
CAUGHT_S = 0.75
"""PX4's rate controller integrates a constant pull away in MC_ROLLRATE_P / MC_ROLLRATE_I."""


@dataclass(frozen=True)
class InjectedFaults:
    """Healthy unless said otherwise."""

    powered: bool = True
    hung: bool = False
    refuses_offboard: bool = False
    refuses_land: bool = False
    ignores_setpoints: bool = False
    tilt_off_rad: float = 0.0
    """Its horizon is rolled by this against the true one, and it flies by it."""
    heading_off_rad: float = 0.0
    """What it believes of its heading, less the truth, whatever vision says."""
    motor_roll_rad: float = 0.0
    """How far it rolls from the attitude it wants, at first."""
    motor_since_s: float = 0.0
    """On the autopilot's clock."""
    thrust_share: float = 1.0
    """Of the thrust that the motors would give."""

    def roll_off_rad(self, now_s: float) -> float:
        """How far the true roll is from the one that is asked for, at `now_s` of the autopilot's clock."""
        pulled_rad = self.motor_roll_rad and self.motor_roll_rad * math.exp((self.motor_since_s - now_s) / CAUGHT_S)
        return pulled_rad - self.tilt_off_rad

    def refuses(self, mode: Mode) -> bool:
        """Whether it does not go to this mode by command."""
        return (mode is Mode.OFFBOARD and self.refuses_offboard) or (mode is Mode.LAND and self.refuses_land)

    def lifeless(self, last: ActuatorDemand, rate_frd_radps: Array, since_s: float) -> ActuatorDemand:
        """What the airframe gets `since_s` after the last sign of life: nothing, or the last signals, unbalanced.

        `rate_frd_radps` is how it turned then.
        """
        if not self.powered:
            return replace(last, signal=0.0, motors_on=False)
        return replace(last, rate_sp_frd_radps=rate_frd_radps + np.array([TIPPING_RADPS2 * since_s, 0.0, 0.0]))

    @property
    def running(self) -> bool:
        """It hears, speaks and flies."""
        return self.powered and not self.hung


HEALTHY = InjectedFaults()


def rolled(q_wxyz: Array, roll_rad: float) -> Array:
    """Turned about its own x."""
    return quat.multiply(q_wxyz, quat.from_rotation_vector(np.array([roll_rad, 0.0, 0.0]))) if roll_rad else q_wxyz


def injected_faults_of(held: Sequence[ActiveFault], booted_s: float) -> InjectedFaults:
    """All of the autopilot's faults that are there, together; it booted at `booted_s` of simulated time."""
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
