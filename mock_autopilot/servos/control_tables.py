"""Control tables of the servos on the simulated bus; pure data.

Sources (ROBOTIS e-manual): AX-12A https://emanual.robotis.com/docs/en/dxl/ax/ax-12a/, XM430-W350
https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/, XM430-W210 https://emanual.robotis.com/docs/en/dxl/x/xm430-w210/,
each under "Control Table". Torque Enable and Status Return Level of the XM count as RAM, everything below as EEPROM.
"""

import math
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Register:
    """One entry of a control table; values are raw, as on the wire."""

    address: int
    size: int
    """Bytes, least significant first."""
    name: str
    writable: bool = True
    default: int = 0
    minimum: int = 0
    """Below zero: two's complement."""
    maximum: int = 0
    eeprom: bool = False

    @property
    def end(self) -> int:
        """Return the first address after the register."""
        return self.address + self.size

    @property
    def signed(self) -> bool:
        """Return whether values are two's complement."""
        return self.minimum < 0


@dataclass(frozen=True, kw_only=True)
class Model:
    """A kind of servo: its table, the units of its registers and its protocol."""

    name: str
    number: int
    protocol: int
    registers: tuple[Register, ...]
    bauds: tuple[tuple[int, int], ...]
    """Register value and bits/s."""
    position_unit_rad: float
    centre: int
    """Raw position in the middle of the range."""
    velocity_unit_radps: float
    return_delay_unit_us: int = 2
    by_name: dict[str, Register] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_name", {register.name: register for register in self.registers})

    @property
    def size(self) -> int:
        """Return the number of bytes in the table."""
        return max(register.end for register in self.registers)

    @property
    def centre_rad(self) -> float:
        """Return the angle (rad) in the middle of the range."""
        return self.centre * self.position_unit_rad

    def baud_code(self, baud: int) -> int:
        """Return the register value for a baud rate; raise ValueError when this model does not have it."""
        for code, rate in self.bauds:
            if rate == baud:
                return code
        raise ValueError(f"{self.name} cannot talk at {baud} baud; it knows {', '.join(str(b) for _, b in self.bauds)}")

    def baud_of(self, code: int) -> int | None:
        """Return the baud rate (bits/s) of a register value, None for an invalid one."""
        return next((rate for known, rate in self.bauds if known == code), None)


def _rom(address: int, size: int, name: str, default: int, low: int = 0, high: int = 0) -> Register:
    return Register(
        address=address, size=size, name=name, writable=True, default=default, minimum=low, maximum=high, eeprom=True
    )


def _fixed(address: int, size: int, name: str, default: int = 0) -> Register:
    return Register(address=address, size=size, name=name, writable=False, default=default, eeprom=True)


def _ram(address: int, size: int, name: str, default: int, low: int = 0, high: int = 1) -> Register:
    return Register(address=address, size=size, name=name, writable=True, default=default, minimum=low, maximum=high)


def _live(address: int, size: int, name: str, low: int = 0) -> Register:
    return Register(address=address, size=size, name=name, writable=False, minimum=low)


_S32 = 2**31 - 1
_TURNS = 1_048_575
"""Extended positions: 256 turns either way."""
INDIRECT_COUNT = 28
"""Indirect Address and Indirect Data 1 to 28; 29 to 56 are left out of this mock."""


def _indirect() -> tuple[Register, ...]:
    addresses = (_ram(168 + 2 * i, 2, f"indirect_address_{i + 1}", 224 + i, 64, 661) for i in range(INDIRECT_COUNT))
    data = (_ram(224 + i, 1, f"indirect_data_{i + 1}", 0, 0, 255) for i in range(INDIRECT_COUNT))
    return (*addresses, *data)


def _xm430(number: int, current_limit: int, velocity_limit: int) -> tuple[Register, ...]:
    return (
        _fixed(0, 2, "model_number", number),
        _fixed(2, 4, "model_information"),
        _fixed(6, 1, "firmware_version"),
        _rom(7, 1, "id", 1, 0, 252),
        _rom(8, 1, "baud_rate", 1, 0, 7),
        _rom(9, 1, "return_delay_time", 250, 0, 254),
        _rom(10, 1, "drive_mode", 0, 0, 0),
        _rom(11, 1, "operating_mode", 3, 0, 16),
        _rom(12, 1, "secondary_id", 255, 0, 255),
        _rom(13, 1, "protocol_type", 2, 1, 2),
        _rom(20, 4, "homing_offset", 0, -1_044_479, 1_044_479),
        _rom(24, 4, "moving_threshold", 10, 0, 1023),
        _rom(31, 1, "temperature_limit", 80, 0, 100),
        _rom(32, 2, "max_voltage_limit", 160, 95, 160),
        _rom(34, 2, "min_voltage_limit", 95, 95, 160),
        _rom(36, 2, "pwm_limit", 885, 0, 885),
        _rom(38, 2, "current_limit", current_limit, 0, current_limit),
        _rom(44, 4, "velocity_limit", velocity_limit, 0, 1023),
        _rom(48, 4, "max_position_limit", 4095, 0, 4095),
        _rom(52, 4, "min_position_limit", 0, 0, 4095),
        _rom(60, 1, "startup_configuration", 0, 0, 3),
        _rom(63, 1, "shutdown", 52, 0, 255),
        _ram(64, 1, "torque_enable", 0),
        _ram(65, 1, "led", 0),
        _ram(68, 1, "status_return_level", 2, 0, 2),
        _live(69, 1, "registered_instruction"),
        _live(70, 1, "hardware_error_status"),
        _ram(76, 2, "velocity_i_gain", 1920, 0, 16383),
        _ram(78, 2, "velocity_p_gain", 100, 0, 16383),
        _ram(80, 2, "position_d_gain", 0, 0, 16383),
        _ram(82, 2, "position_i_gain", 0, 0, 16383),
        _ram(84, 2, "position_p_gain", 800, 0, 16383),
        _ram(88, 2, "feedforward_2nd_gain", 0, 0, 16383),
        _ram(90, 2, "feedforward_1st_gain", 0, 0, 16383),
        _ram(98, 1, "bus_watchdog", 0, -1, 127),
        _ram(100, 2, "goal_pwm", 885, -885, 885),
        _ram(102, 2, "goal_current", current_limit, -current_limit, current_limit),
        _ram(104, 4, "goal_velocity", 0, -_S32, _S32),
        _ram(108, 4, "profile_acceleration", 0, 0, 32767),
        _ram(112, 4, "profile_velocity", 0, 0, 32767),
        _ram(116, 4, "goal_position", 0, -_TURNS, _TURNS),
        _live(120, 2, "realtime_tick"),
        _live(122, 1, "moving"),
        _live(123, 1, "moving_status"),
        _live(124, 2, "present_pwm", -885),
        _live(126, 2, "present_current", -1),
        _live(128, 4, "present_velocity", -1),
        _live(132, 4, "present_position", -1),
        _live(136, 4, "velocity_trajectory", -1),
        _live(140, 4, "position_trajectory", -1),
        _live(144, 2, "present_input_voltage"),
        _live(146, 1, "present_temperature"),
        *_indirect(),
    )


_AX12A = (
    _fixed(0, 2, "model_number", 12),
    _fixed(2, 1, "firmware_version"),
    _rom(3, 1, "id", 1, 0, 253),
    _rom(4, 1, "baud_rate", 1, 0, 254),
    _rom(5, 1, "return_delay_time", 250, 0, 254),
    _rom(6, 2, "cw_angle_limit", 0, 0, 1023),
    _rom(8, 2, "ccw_angle_limit", 1023, 0, 1023),
    _rom(11, 1, "temperature_limit", 70, 0, 70),
    _rom(12, 1, "min_voltage_limit", 60, 50, 160),
    _rom(13, 1, "max_voltage_limit", 140, 50, 160),
    _rom(14, 2, "max_torque", 1023, 0, 1023),
    _rom(16, 1, "status_return_level", 2, 0, 2),
    _rom(17, 1, "alarm_led", 36, 0, 127),
    _rom(18, 1, "shutdown", 36, 0, 127),
    _ram(24, 1, "torque_enable", 0),
    _ram(25, 1, "led", 0),
    _ram(26, 1, "cw_compliance_margin", 1, 0, 255),
    _ram(27, 1, "ccw_compliance_margin", 1, 0, 255),
    _ram(28, 1, "cw_compliance_slope", 32, 2, 254),
    _ram(29, 1, "ccw_compliance_slope", 32, 2, 254),
    _ram(30, 2, "goal_position", 0, 0, 1023),
    _ram(32, 2, "moving_speed", 0, 0, 2047),
    _ram(34, 2, "torque_limit", 1023, 0, 1023),
    _live(36, 2, "present_position"),
    _live(38, 2, "present_speed"),
    _live(40, 2, "present_load"),
    _live(42, 1, "present_voltage"),
    _live(43, 1, "present_temperature"),
    _live(44, 1, "registered_instruction"),
    _live(46, 1, "moving"),
    _ram(47, 1, "lock", 0),
    _ram(48, 2, "punch", 32, 32, 1023),
)

_RPM = 2.0 * math.pi / 60.0
_XM_BAUDS = tuple(enumerate((9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)))
_AX_BAUDS = (
    (1, 1_000_000), (3, 500_000), (4, 400_000), (7, 250_000), (9, 200_000), (16, 115_200), (34, 57_600), (103, 19_200),
    (207, 9_600),
)  # fmt: skip


def _xm(name: str, number: int, velocity_limit: int) -> Model:
    registers = _xm430(number, 1193, velocity_limit)
    return Model(
        name=name,
        number=number,
        protocol=2,
        registers=registers,
        bauds=_XM_BAUDS,
        position_unit_rad=2.0 * math.pi / 4096,
        centre=2048,
        velocity_unit_radps=0.229 * _RPM,
    )


MODELS = (
    _xm("XM430-W350", 1020, 200),
    _xm("XM430-W210", 1030, 330),
    Model(
        name="AX-12A",
        number=12,
        protocol=1,
        registers=_AX12A,
        bauds=_AX_BAUDS,
        position_unit_rad=math.radians(300.0) / 1023,
        centre=512,
        velocity_unit_radps=0.111 * _RPM,
    ),
)


def model_named(name: str) -> Model:
    """Return the model of that name; raise KeyError when there is none."""
    for model in MODELS:
        if model.name == name:
            return model
    raise KeyError(name)
