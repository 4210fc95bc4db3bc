"""Interface between autopilot and airframe: sensor state in, actuator demand out."""

from dataclasses import dataclass
from typing import NamedTuple

from mock_autopilot.physics.quaternion import Array
from mock_autopilot.physics.quaternion_one import Four, Three
from mock_autopilot.px4.estimator import Motion


@dataclass(frozen=True)
class ActuatorDemand:
    """The autopilot's setpoint for the airframe, in true world coordinates."""

    q_sp_wxyz: Array
    rate_sp_frd_radps: Array | None
    signal: float
    """Motor signal 0..1, NaN for none."""
    motors_on: bool


class SensorState(NamedTuple):
    """The truth the sensors see, relative to the start position; world NED, body FRD."""

    motion: Motion
    q_ned_frd_wxyz: Four
    rate_frd_radps: Three
