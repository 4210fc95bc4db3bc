"""Control tables of the servos: the registers that this driver reads or writes. Pure.

Sources, with the sections "Control Table of EEPROM Area" and "... of RAM Area" of each:
- AX-12A, Protocol 1.0: https://emanual.robotis.com/docs/en/dxl/ax/ax-12a/
- XM430-W350, Protocol 2.0: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/
- XM430-W210, the same table: https://emanual.robotis.com/docs/en/dxl/x/xm430-w210/
"""

import math
from dataclasses import dataclass

_RPM = 2.0 * math.pi / 60.0


@dataclass(frozen=True)
class Register:
    """One entry of a control table."""

    address: int
    size: int
    unit: float = 1.0
    """SI value of one count."""
    signed: bool = False
    """Two's complement; the AX's sign bit is another thing, see `conversion`."""

    def raw(self, block: bytes, start: int) -> int:
        """Return the counts from `block`, which was read from address `start`; ValueError when it is not in there."""
        offset = self.address - start
        if offset < 0 or offset + self.size > len(block):
            raise ValueError(f"register {self.address} is not in the {len(block)} bytes from address {start}")
        return int.from_bytes(block[offset : offset + self.size], "little", signed=self.signed)

    def value(self, block: bytes, start: int) -> float:
        """Return the register's value in SI units; arguments and errors as in `raw`."""
        return self.raw(block, start) * self.unit

    def encoded(self, counts: int) -> bytes:
        """Return the bytes to write; OverflowError when `counts` does not fit."""
        return counts.to_bytes(self.size, "little", signed=self.signed)


@dataclass(frozen=True)
class Block:
    """Neighbouring registers that are read at once."""

    start: int
    end: int
    """First address behind it."""

    @property
    def length(self) -> int:
        """Size of the register, bytes."""
        return self.end - self.start


MODEL_NUMBER = Block(0, 2)
"""The same in both."""


class Xm:
    """Registers of XM430-W350 and XM430-W210 (protocol 2)."""

    MODEL_NUMBER = Register(0, 2)
    FIRMWARE = Register(6, 1)
    BAUD_CODE = Register(8, 1)
    RETURN_DELAY = Register(9, 1, 2e-6)
    DRIVE_MODE = Register(10, 1)
    OPERATING_MODE = Register(11, 1)
    SECONDARY_ID = Register(12, 1)
    PROTOCOL_TYPE = Register(13, 1)
    HOMING_OFFSET = Register(20, 4, 2.0 * math.pi / 4096.0, signed=True)
    TEMPERATURE_LIMIT = Register(31, 1)
    PWM_LIMIT = Register(36, 2, 1.0 / 885.0)
    VELOCITY_LIMIT = Register(44, 4, 0.229 * _RPM)
    MAX_POSITION = Register(48, 4)
    MIN_POSITION = Register(52, 4)
    STARTUP_CONFIGURATION = Register(60, 1)
    SHUTDOWN = Register(63, 1)
    TORQUE_ENABLE = Register(64, 1)
    STATUS_RETURN_LEVEL = Register(68, 1)
    HARDWARE_ERROR = Register(70, 1)
    POSITION_D_GAIN = Register(80, 2)
    POSITION_I_GAIN = Register(82, 2)
    POSITION_P_GAIN = Register(84, 2)
    FEEDFORWARD_2ND_GAIN = Register(88, 2)
    FEEDFORWARD_1ST_GAIN = Register(90, 2)
    BUS_WATCHDOG = Register(98, 1, signed=True)
    GOAL_PWM = Register(100, 2, 1.0 / 885.0, signed=True)
    PROFILE_ACCELERATION = Register(108, 4, 214.577 * _RPM / 60.0)
    """rad/s^2; the manual's 214.577 rev/min^2."""
    PROFILE_VELOCITY = Register(112, 4, 0.229 * _RPM)
    GOAL_POSITION = Register(116, 4, 2.0 * math.pi / 4096.0, signed=True)
    PRESENT_CURRENT = Register(126, 2, 2.69e-3, signed=True)
    PRESENT_VELOCITY = Register(128, 4, 0.229 * _RPM, signed=True)
    PRESENT_POSITION = Register(132, 4, 2.0 * math.pi / 4096.0, signed=True)
    PRESENT_VOLTAGE = Register(144, 2, 0.1)
    PRESENT_TEMPERATURE = Register(146, 1)

    IDENTITY = Block(0, 64)
    """The whole EEPROM; between its registers a servo answers zeros."""
    TUNING = Block(80, 102)
    """Gains, Bus Watchdog and Goal PWM, which last until the servo restarts."""
    HEALTH = Block(64, 71)
    """Torque Enable to Hardware Error Status."""
    STATE = Block(126, 147)
    """Present Current to Present Temperature, with two trajectory registers between: one contiguous read is shorter
    than two, and unlike indirect addresses it means the same after a reboot."""
    LAST_POSITION = 4095


class Ax:
    """Registers of AX-12A (protocol 1)."""

    MODEL_NUMBER = Register(0, 2)
    FIRMWARE = Register(2, 1)
    BAUD_CODE = Register(4, 1)
    RETURN_DELAY = Register(5, 1, 2e-6)
    MIN_POSITION = Register(6, 2)
    """CW Angle Limit; zero in both limits is wheel mode."""
    MAX_POSITION = Register(8, 2)
    TEMPERATURE_LIMIT = Register(11, 1)
    MAX_TORQUE = Register(14, 2)
    STATUS_RETURN_LEVEL = Register(16, 1)
    SHUTDOWN = Register(18, 1)
    TORQUE_ENABLE = Register(24, 1)
    GOAL_POSITION = Register(30, 2, math.radians(300.0 / 1023.0))
    MOVING_SPEED = Register(32, 2, 0.111 * _RPM)
    TORQUE_LIMIT = Register(34, 2, 1.0 / 1023.0)
    PRESENT_POSITION = Register(36, 2, math.radians(300.0 / 1023.0))
    """The manual rounds the unit to 0.29 degrees; position 1023 is 300 degrees."""
    PRESENT_SPEED = Register(38, 2, 0.111 * _RPM)
    PRESENT_LOAD = Register(40, 2, 1.0 / 1023.0)
    PRESENT_VOLTAGE = Register(42, 1, 0.1)
    PRESENT_TEMPERATURE = Register(43, 1)

    IDENTITY = Block(0, 19)
    STATE = Block(24, 44)
    """Torque Enable to Present Temperature: state and health in one."""
    LAST_POSITION = 1023


@dataclass(frozen=True)
class Model:
    """Properties of one servo model: protocol, registers, units and ranges."""

    name: str
    number: int
    """Model Number, register 0."""
    protocol: int
    goal: Register
    position: Register
    last_position: int
    state: Block
    lowest_firmware: int
    """0: any. XM: Drive Mode (10), which must be looked at, is there from 38."""


_XM = (2, Xm.GOAL_POSITION, Xm.PRESENT_POSITION, Xm.LAST_POSITION, Xm.STATE, 38)
MODELS = {
    "AX-12A": Model("AX-12A", 12, 1, Ax.GOAL_POSITION, Ax.PRESENT_POSITION, Ax.LAST_POSITION, Ax.STATE, 0),
    "XM430-W350": Model("XM430-W350", 1020, *_XM),
    "XM430-W210": Model("XM430-W210", 1030, *_XM),
}

OTHER_MODELS = {
    18: "AX-18A", 29: "MX-28", 30: "MX-28", 300: "AX-12W", 310: "MX-64", 311: "MX-64", 320: "MX-106", 321: "MX-106",
    350: "XL-320", 1000: "XH430-W350", 1010: "XH430-W210", 1040: "XH430-V350", 1050: "XH430-V210", 1060: "XL430-W250",
    1070: "XC430-W150", 1080: "XC430-W240", 1120: "XM540-W270", 1130: "XM540-W150",
}  # fmt: skip
"""Model Number (0) of servos that this driver does not know, so that the wrong one is named."""

POSITION_MODE = 3
OPERATING_MODES = {
    0: "current control",
    1: "velocity control",
    3: "position control",
    4: "extended position control",
    5: "current-based position control",
    16: "PWM control",
}
"""XM, Operating Mode (11)."""

LIKELY_BAUDS = {
    1: (1_000_000, 57_600, 115_200, 500_000, 400_000, 250_000, 200_000, 19_200, 9_600),
    2: (57_600, 1_000_000, 115_200, 2_000_000, 3_000_000, 4_000_000, 4_500_000, 9_600),
}
"""By protocol: all rates of an AX and of an XM, from the factory's own on, to look for a servo that is not found."""

XM_RATED_CURRENT_A = 2.3
"""Stall current at 12 V, "Specifications"; the whole of what `effort` is a share of."""

OVERHEATING, OVERLOAD = 0x04, 0x20
"""The same bits in the XM's Hardware Error Status (70) and Shutdown (63), in the AX's error byte and Shutdown (18)."""
XM_HARDWARE_ERRORS = {
    0x01: "input voltage out of range",
    OVERHEATING: "overheating",
    0x08: "motor encoder broken",
    0x10: "electrical shock, or too little power",
    OVERLOAD: "overload",
}
"""XM, "Shutdown (63)"."""
AX_ALARMS = {0x01: "input voltage out of range", OVERHEATING: "overheating", OVERLOAD: "overload"}
"""AX, "Alarm LED / Shutdown"; the other bits of the error byte speak of the instruction, not of the servo."""
ALERT = 0x80
"""Protocol 2.0, error field: look at the Hardware Error Status."""


def ax_baud(code: int) -> float:
    """Return the bits/s of an AX's Baud Rate (4): 2 000 000 / (code + 1)."""
    return 2e6 / (code + 1)
