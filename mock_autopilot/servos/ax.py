"""An AX-12A: Protocol 1.0, error bits in every answer, torque limit 0 after a shutdown. Pure.

Source: https://emanual.robotis.com/docs/en/dxl/ax/ax-12a/. Only joint mode is simulated; wheel mode (both angle limits
0) stands still. Writing Goal Position switches torque on: the e-manual does not say so, but its predecessor (AX-12
User's Manual, example 18) moves a servo by Goal Position and Moving Speed alone. One compliance slope and margin, the
CCW one, holds for both directions. The overload bit stays until its cause is gone and Torque Limit is written again;
heat and voltage bits go with their cause.
"""

import math
import struct

from mock_autopilot.servos.config import ServoConfig
from mock_autopilot.servos.memory import Refusal
from mock_autopilot.servos.motor import AX_12A
from mock_autopilot.servos.packets import Error1
from mock_autopilot.servos.servo import Servo

FULL_LOAD = 1023
CLOCKWISE = 1024
"""Direction bit of speeds and loads."""

_LIVE_AT = 36
_LIVE = struct.Struct("<HHHBBB")
"""Present Position to Registered."""
_UNLOCKED = range(24, 36)
"""With Lock set only these addresses take values (AX-12 User's Manual, example 20)."""


class AxServo(Servo):
    """An AX-12A servo."""

    def __init__(self, config: ServoConfig, voltage_v: float, ambient_c: float) -> None:
        self._overload_latched = False
        self._error = 0
        super().__init__(config, AX_12A, voltage_v, ambient_c)

    def _forget(self) -> None:
        self._overload_latched, self._error = False, 0
        super()._forget()
        self.table.put("torque_limit", self.table.get("max_torque"))
        self._adjust()

    @property
    def error(self) -> int:
        """Return the error bits for overload, overheating and input voltage."""
        return self._error

    def raw_position(self) -> int:
        """Return the present angle in its units, 0 to 1023."""
        return min(max(super().raw_position(), 0), 1023)

    def write(self, address: int, data: bytes) -> Refusal | None:
        """Write to its table, unless Lock is set."""
        locked = self.table.get("lock") and not (address in _UNLOCKED and address + len(data) - 1 in _UNLOCKED)
        return Refusal.LOCKED if locked else super().write(address, data)

    def refuses(self, wanted: dict[str, int], eeprom: bool) -> Refusal | None:  # noqa: ARG002
        """Return the refusal of a goal outside the angle limits, else None."""
        goal, get = wanted.get("goal_position"), self.table.get
        if goal is not None and not get("cw_angle_limit") <= goal <= get("ccw_angle_limit"):
            return Refusal.OVER_LIMIT
        return None

    def obey(self, written: dict[str, int]) -> None:
        """Adjust the motor; a goal switches torque on."""
        if "goal_position" in written and "torque_enable" not in written:
            self.table.put("torque_enable", 1)
        if written.get("torque_limit"):
            self._overload_latched = False
        self._adjust()
        if "goal_position" in written or "torque_enable" in written:
            self.motor.go_to(self.table.get("goal_position") * self.model.position_unit_rad)
        self._power()

    def _power(self) -> None:
        get = self.table.get
        joint_mode = get("cw_angle_limit") or get("ccw_angle_limit")
        self.motor.power(on=bool(self.torque_on and joint_mode and get("torque_limit")))

    def _adjust(self) -> None:
        get, motor, unit = self.table.get, self.motor, self.model.position_unit_rad
        motor.gain_per_rad = 1.0 / (get("ccw_compliance_slope") * unit)
        motor.margin_rad = get("ccw_compliance_margin") * unit
        motor.pwm_limit = get("torque_limit") / FULL_LOAD
        speed = get("moving_speed") & 0x3FF
        motor.profile_limit_radps = speed * self.model.velocity_unit_radps if speed else math.inf

    def protect(self, time_s: float) -> None:  # noqa: ARG002
        """Set the error bits; torque limit 0 for what Shutdown contains."""
        self._overload_latched = self._overload_latched or self._overload_seen()
        self._error = (
            (Error1.OVERLOAD if self._overload_latched else 0)
            | (Error1.OVERHEATING if self._heat_seen() else 0)
            | (Error1.INPUT_VOLTAGE if self._voltage_seen() else 0)
        )
        if self._error & self.table.get("shutdown") and self.table.get("torque_limit"):
            self.table.put("torque_limit", 0)
            self._adjust()
            self._power()

    def refresh(self) -> None:
        """Update registers 36 to 44 and 46 with the present values."""
        motor, unit = self.motor, self.model.velocity_unit_radps
        values = (
            self.raw_position(),
            _with_direction(motor.rate_radps / unit),
            _with_direction(motor.pwm_share * FULL_LOAD),
            round(10.0 * self.voltage_v),
            self.raw_temperature,
            int(self.registered is not None),
        )
        _LIVE.pack_into(self.table.bytes, _LIVE_AT, *values)
        under_way = abs(motor.goal_rad - motor.angle_rad) > 2 * motor.margin_rad and abs(motor.rate_radps) > unit
        self.table.put("moving", int(motor.powered and (motor.profile_ongoing or under_way)))


def _with_direction(value: float) -> int:
    """Return a register value of ten bits of magnitude, with the direction bit above them."""
    size = min(round(abs(value)), FULL_LOAD)
    return size + CLOCKWISE if value < 0.0 and size else size
