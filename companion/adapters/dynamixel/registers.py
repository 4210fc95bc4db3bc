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
    sign_bit: int = 0
    """AX: this bit set means clockwise, a negative value; 0: none."""

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


@dataclass(frozen=True)
class Answer:
    """Registers of one servo from address `start` on, and the error byte that came with them."""

    start: int
    data: bytes
    error: int

    def raw(self, register: Register) -> int:
        """Return the register's counts; ValueError when it is not among those that were read."""
        offset = register.address - self.start
        if offset < 0 or offset + register.size > len(self.data):
            raise ValueError(
                f"register {register.address} is not in the {len(self.data)} bytes from address {self.start}"
            )
        raw = int.from_bytes(self.data[offset : offset + register.size], "little", signed=register.signed)
        if not register.sign_bit:
            return raw
        magnitude = raw & (register.sign_bit - 1)
        return -magnitude if raw & register.sign_bit else magnitude

    def value(self, register: Register) -> float:
        """Return the register's value in SI units; ValueError as `raw`."""
        return self.raw(register) * register.unit


XM_RATED_CURRENT_A = 2.3
"""Stall current at 12 V, "Specifications"; the whole of what `effort` is a share of."""

MODEL_NUMBER = Block(0, 2)


class Xm:
    """Registers of XM430-W350 and XM430-W210 (protocol 2)."""

    MODEL_NUMBER = Register(0, 2)
    FIRMWARE = Register(6, 1)
    BAUD_CODE = Register(8, 1)
    RETURN_DELAY = Register(9, 1, 2e-6)
    DRIVE_MODE = Register(10, 1)
    OPERATING_MODE = Register(11, 1)
    SECONDARY_ID = Register(12, 1)
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
    PRESENT_EFFORT = Register(126, 2, 2.69e-3 / XM_RATED_CURRENT_A, signed=True)
    """Present Current, 2.69 mA a count."""
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
    PRESENT_VELOCITY = Register(38, 2, 0.111 * _RPM, sign_bit=0x400)
    """Present Speed."""
    PRESENT_EFFORT = Register(40, 2, 1.0 / 1023.0, sign_bit=0x400)
    """Present Load."""
    PRESENT_VOLTAGE = Register(42, 1, 0.1)
    PRESENT_TEMPERATURE = Register(43, 1)

    IDENTITY = Block(0, 19)
    STATE = HEALTH = Block(24, 44)
    """Torque Enable to Present Temperature: state and health in one."""
    LAST_POSITION = 1023


@dataclass(frozen=True)
class Model:
    """Properties of one servo model."""

    name: str
    number: int
    """Model Number, register 0."""
    protocol: int
    table: type[Ax] | type[Xm]
    lowest_firmware: int
    """0: any. XM: Drive Mode (10), which must be looked at, is there from 38."""


MODELS = {
    "AX-12A": Model("AX-12A", 12, 1, Ax, 0),
    "XM430-W350": Model("XM430-W350", 1020, 2, Xm, 38),
    "XM430-W210": Model("XM430-W210", 1030, 2, Xm, 38),
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
