"""PX4's modes, results and severities (numbers of the MAVLink common dialect and of PX4)."""

from dataclasses import dataclass
from enum import Enum, IntEnum

CUSTOM_MODE_ENABLED = 1
GUIDED_OR_AUTO = 4 | 8
STABILIZE = 16
AUTO_MAIN_MODE = 4
MANUAL_INPUT = 64
SAFETY_ARMED = 128
FORCE_MAGIC = 21196
"""param2 of the arm command that skips the checks."""


class Result(IntEnum):
    """Results of a command, MAV_RESULT in COMMAND_ACK."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Severity(IntEnum):
    """Severities of a STATUSTEXT, MAV_SEVERITY, those that PX4 was recorded to use."""

    EMERGENCY = 0
    CRITICAL = 2
    INFO = 6


class SystemStatus(IntEnum):
    """States of the system, MAV_STATE in HEARTBEAT."""

    NOT_READY = 0
    STANDBY = 3
    ACTIVE = 4
    FAILSAFE = 5


class LandedState(IntEnum):
    """Landed states, MAV_LANDED_STATE in EXTENDED_SYS_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKING_OFF = 3
    LANDING = 4


class Mode(Enum):
    """Flight modes by PX4's main and sub mode."""

    MANUAL = (1, 0)
    ALTITUDE = (2, 0)
    POSITION = (3, 0)
    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    MISSION = (4, 4)
    RTL = (4, 5)
    LAND = (4, 6)
    ACRO = (5, 0)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)
    DESCEND = (4, 12)
    """Blind descent; PX4 reports it as Land. (12 is its number of the navigation state; there is no custom mode.)"""

    @property
    def custom_mode(self) -> int:
        """Return HEARTBEAT.custom_mode: main mode in byte 2, sub mode in byte 3."""
        main, sub = Mode.LAND.value if self is Mode.DESCEND else self.value
        return int(main) << 16 | int(sub) << 24

    @property
    def is_auto(self) -> bool:
        """Return whether the autopilot flies this mode itself: Hold, Takeoff, Land, Return, Mission."""
        return self.custom_mode >> 16 & 0xFF == AUTO_MAIN_MODE

    @property
    def title(self) -> str:
        """Return the mode's name in PX4's texts."""
        return "Return" if self is Mode.RTL else self.name.capitalize()


@dataclass(frozen=True)
class Text:
    """One line for the ground station; PX4 ends a text that is also an event with a tab."""

    severity: Severity
    text: str


@dataclass(frozen=True)
class Position:
    """A position in the estimator's local frame (NED, m)."""

    x_m: float
    y_m: float
    z_m: float
