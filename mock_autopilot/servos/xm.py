"""An XM430: Protocol 2.0, EEPROM locked by torque, latched hardware errors, bus watchdog. Pure.

Source: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/. Only the position modes (3, 4, 5) move it; drive modes
other than 0 (reverse, time-based profile, torque by goal) are refused as out of range. A goal survives Torque Enable
going off and on, so that a host which does not bring the goal up to date makes it jump. An input voltage error that
Shutdown does not contain goes with its cause; all others stay until a reboot.
"""

import math
import struct

from mock_autopilot.servos.config import ServoConfig
from mock_autopilot.servos.control_tables import INDIRECT_COUNT
from mock_autopilot.servos.memory import Refusal
from mock_autopilot.servos.motor import XM430_W210, XM430_W350
from mock_autopilot.servos.packets import ALERT
from mock_autopilot.servos.servo import Servo

VOLTAGE_ERROR, HEAT_ERROR, OVERLOAD_ERROR = 0x01, 0x04, 0x20
"""Bits of Hardware Error Status and Shutdown."""
FULL_PWM = 885
CURRENT_UNIT_A = 2.69e-3
PROFILE_ACCEL_UNIT_RADPS2 = 214.577 * 2.0 * math.pi / 3600.0
WATCHDOG_UNIT_S = 0.02
WATCHDOG_BIT = -1
MOST_HOMING_OFFSET = 1024
"""Homing offsets in position control; others are ignored there, e-manual, "Homing Offset(20)"."""
STARTUP_TORQUE_ON = 0x01
"""Bits of Startup Configuration."""
_LAST_ID = 252

_LIVE_AT = 120
_LIVE = struct.Struct("<HBBhhiiiiHB")
"""Realtime Tick to Present Temperature."""
_INDIRECT_DATA = 224
_GOALS = frozenset({"goal_pwm", "goal_current", "goal_velocity", "goal_position"})
_POSITION_MODES = frozenset({3, 4, 5})


class XmServo(Servo):
    """An XM430-W350 or XM430-W210 servo."""

    def __init__(self, config: ServoConfig, voltage_v: float, ambient_c: float) -> None:
        self.latched = 0
        self._hardware_error = 0
        self._time_s = 0.0
        spec = XM430_W210 if config.model == "XM430-W210" else XM430_W350
        self._current_nm = CURRENT_UNIT_A * spec.stall_nm / spec.stall_a
        super().__init__(config, spec, voltage_v, ambient_c)

    def _set_up(self) -> None:
        super()._set_up()
        self.table.put("operating_mode", self.config.operating_mode)

    def _forget(self) -> None:
        self.latched = self._hardware_error = 0
        super()._forget()
        self._adjust()
        if self.table.get("startup_configuration") & STARTUP_TORQUE_ON:
            self.write(self.table.model.by_name["torque_enable"].address, b"\x01")

    @property
    def protocol(self) -> int:
        """Return the protocol of its Protocol Type register."""
        return self.table.get("protocol_type")

    @property
    def secondary_id(self) -> int | None:
        """Return its Secondary ID; None from 253 on, which switch it off."""
        value = self.table.get("secondary_id")
        return value if value <= _LAST_ID and value != self.id else None

    @property
    def _homing_offset(self) -> int:
        offset = self.table.get("homing_offset")
        return 0 if self._mode == 3 and abs(offset) > MOST_HOMING_OFFSET else offset

    @property
    def error(self) -> int:
        """Return the alert bit while Hardware Error Status is not zero."""
        return ALERT if self._hardware_error else 0

    @property
    def _mode(self) -> int:
        return self.table.get("operating_mode")

    def raw_position(self) -> int:
        """Return the present angle in pulses, homing offset included."""
        return super().raw_position() + self._homing_offset

    def read(self, address: int, size: int) -> bytes | Refusal:
        """Return bytes from its table; indirect data come from the addresses they point to."""
        plain = super().read(address, size)
        if isinstance(plain, Refusal) or not self._is_indirect(address, size):
            return plain
        return bytes(self.table.bytes[self._place(at)] for at in range(address, address + size))

    def write(self, address: int, data: bytes) -> Refusal | None:
        """Write to its table; indirect data go to the addresses they point to."""
        if not self._is_indirect(address, len(data)):
            return super().write(address, data)
        runs: list[tuple[int, bytearray]] = []
        for at, byte in enumerate(data, start=address):
            place = self._place(at)
            if runs and runs[-1][0] + len(runs[-1][1]) == place:
                runs[-1][1].append(byte)
            else:
                runs.append((place, bytearray([byte])))
        refusals = [super(XmServo, self).write(place, bytes(run)) for place, run in runs]
        return next((refusal for refusal in refusals if refusal is not None), None)

    @staticmethod
    def _is_indirect(address: int, size: int) -> bool:
        return address < _INDIRECT_DATA + INDIRECT_COUNT and address + size > _INDIRECT_DATA

    def _place(self, address: int) -> int:
        index = address - _INDIRECT_DATA
        if not 0 <= index < INDIRECT_COUNT:
            return address
        target = self.table.get(f"indirect_address_{index + 1}")
        return target if target < self.model.size else address

    def refuses(self, wanted: dict[str, int], eeprom: bool) -> Refusal | None:
        """Return the refusal: EEPROM is locked while torque is on, goals must keep other registers' limits."""
        if eeprom and self.torque_on:
            return Refusal.LOCKED
        if _GOALS & wanted.keys() and self.table.get("bus_watchdog") == WATCHDOG_BIT:
            return Refusal.OUT_OF_RANGE
        if wanted.get("bus_watchdog", 0) < 0 or wanted.get("operating_mode", 3) not in {0, 1, 3, 4, 5, 16}:
            return Refusal.OUT_OF_RANGE
        if wanted.get("torque_enable") and self.latched & self.table.get("shutdown"):
            return Refusal.SHUT_DOWN
        return Refusal.OVER_LIMIT if self._beyond_limits(wanted) else None

    def _beyond_limits(self, wanted: dict[str, int]) -> bool:
        get = self.table.get
        low, high = get("min_position_limit"), get("max_position_limit")
        goal = wanted.get("goal_position")
        return (
            (goal is not None and self._mode == 3 and not low <= goal <= high)
            or abs(wanted.get("goal_pwm", 0)) > get("pwm_limit")
            or abs(wanted.get("goal_current", 0)) > get("current_limit")
            or abs(wanted.get("goal_velocity", 0)) > get("velocity_limit")
        )

    def obey(self, written: dict[str, int]) -> None:
        """Adjust the motor to the registers, then set its goal."""
        self._adjust()
        if "goal_position" in written or "torque_enable" in written:
            goal = self.table.get("goal_position") - self._homing_offset
            self.motor.go_to(goal * self.model.position_unit_rad)
        if "torque_enable" in written:
            self.motor.power(on=self.torque_on and self._mode in _POSITION_MODES)

    def _adjust(self) -> None:
        get, motor = self.table.get, self.motor
        motor.gain_per_rad = get("position_p_gain") / 128.0 / FULL_PWM / self.model.position_unit_rad
        motor.pwm_limit = min(get("pwm_limit"), abs(get("goal_pwm"))) / FULL_PWM
        current = abs(get("goal_current")) if self._mode == 5 else get("current_limit")
        motor.current_limit_nm = current * self._current_nm
        speed, accel = get("profile_velocity"), get("profile_acceleration")
        motor.profile_limit_radps = speed * self.model.velocity_unit_radps if speed else math.inf
        motor.profile_accel_radps2 = accel * PROFILE_ACCEL_UNIT_RADPS2 if accel else math.inf

    def tend(self, dt_s: float, time_s: float) -> None:
        """Update temperature and protection, and the bus watchdog."""
        self._time_s = time_s
        watchdog = self.table.get("bus_watchdog")
        if watchdog > 0 and self.torque_on and time_s - self.heard_s > watchdog * WATCHDOG_UNIT_S:
            self.table.put("bus_watchdog", WATCHDOG_BIT)
            self.table.put("profile_velocity", 0)
            self.table.put("profile_acceleration", 0)
            self._adjust()
            self.motor.go_to(self.motor.angle_rad)
        super().tend(dt_s, time_s)

    def protect(self, time_s: float) -> None:  # noqa: ARG002
        """Latch overload and heat, show the voltage; torque off for what Shutdown contains."""
        shutdown = self.table.get("shutdown")
        live = VOLTAGE_ERROR if self._voltage_seen() else 0
        self.latched |= OVERLOAD_ERROR if self._overload_seen() else 0
        self.latched |= HEAT_ERROR if self._heat_seen() else 0
        self.latched |= live & shutdown
        self._hardware_error = self.latched | live
        if self.latched & shutdown and self.torque_on:
            self.table.put("torque_enable", 0)
            self.motor.power(on=False)

    def refresh(self) -> None:
        """Update registers 69, 70 and 120 to 146 with the present values."""
        table, motor, model = self.table, self.motor, self.model
        table.put("registered_instruction", int(self.registered is not None))
        table.put("hardware_error_status", self._hardware_error)
        offset = self._homing_offset
        place, speed = motor.profile
        rate = round(motor.rate_radps / model.velocity_unit_radps)
        values = (
            round(1000.0 * self._time_s) % 32768,
            int(abs(rate) > table.get("moving_threshold")),
            self._moving_status(),
            round(motor.pwm_share * FULL_PWM),
            round(motor.torque_nm / self._current_nm),
            rate,
            round(motor.angle_rad / model.position_unit_rad) + offset,
            round(speed / model.velocity_unit_radps),
            round(place / model.position_unit_rad) + offset,
            round(10.0 * self.voltage_v),
            self.raw_temperature,
        )
        _LIVE.pack_into(table.bytes, _LIVE_AT, *values)

    def _moving_status(self) -> int:
        motor = self.motor
        in_position = abs(motor.goal_rad - motor.angle_rad) < 20 * self.model.position_unit_rad
        profile = 0x00
        if motor.profile_limit_radps != math.inf:
            profile = 0x10 if motor.profile_accel_radps2 == math.inf else 0x30
        return profile | (0x02 if motor.profile_ongoing else 0) | int(in_position)
