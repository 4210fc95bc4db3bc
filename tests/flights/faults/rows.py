"""Description of one fault flight: how the fault is made, when, and what must come of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.config.safety_config import SafetyConfig
from companion.supervisor.faults import FailsafeAction, Fault, Stage, reaction_to
from tests.flights.simulated import BRISK, Flight
from tests.flights.test_simulated_arms import mock_arms

RULES = SafetyConfig().rules()
"""The limits that fly: the configuration's own."""

CONFIG = CompanionConfig(flight=BRISK)
"""Configuration of all but a few rows; its fence judges all."""

FRAME_S = 0.02
"""A fault shows in the next frame (10 ms), and a pose is 10 ms old when it is used."""
CYCLE_S = 0.01
PX4_S = 0.02
"""PX4 looks at its commands and modes at 50 Hz."""
MODE_S = 0.05
"""PX4 tells its mode 20 times a second (CURRENT_MODE)."""
BOOT_S = 1.0
"""PX4's boot to its first HEARTBEAT."""
REAL_S = 0.15
"""Real time only: two processes and their sockets on a computer that does other things as well."""


def within(recognised_s: float, extra_s: float = 0.0) -> float:
    """Longest reaction: the rule's own time, what the physics or the stream need first, and one pass of the loop."""
    return recognised_s + extra_s + FRAME_S + CYCLE_S + PX4_S


class End(StrEnum):
    """End of a flight, by the mock's truth."""

    LANDED = "landed"
    """Down and disarmed after a landing of ours that the fault began."""
    HANDED_OVER = "handed over"
    """Down and disarmed after a landing of PX4's."""
    PILOT = "pilot"
    """Somebody else flies, and nothing of ours is sent."""
    TERMINATED = "terminated"
    """The motors stopped in the air, by us or by the fault itself; or it fell, and its dead autopilot cannot disarm."""
    FLIES_ON = "flies on"
    """Until the operator lands."""
    NOT_STARTED = "not started"
    """It never left the ground."""
    IN_THE_AIR = "still in the air"
    """Nobody wants to see this one."""


class When(StrEnum):
    """In which part of a flight the fault begins."""

    GROUND = "armed"
    LIFT_OFF = "lift-off"
    """Beginning on the ground: the thrust ramps up, and motion capture sees nothing of it."""
    TAKEOFF = "takeoff"
    HOVER = "hover"
    TRACK = "track"
    LANDING = "landing"
    HANDED_OVER = "handed over"
    """While PX4 lands."""
    SWINGING = "arms moving"
    """In hover, both arms on their way; flown with ARMS."""


STAGES = {
    When.GROUND: Stage.GROUND,
    When.LIFT_OFF: Stage.FLYING,
    When.TAKEOFF: Stage.FLYING,
    When.HOVER: Stage.FLYING,
    When.TRACK: Stage.FLYING,
    When.LANDING: Stage.LANDING,
    When.HANDED_OVER: Stage.HANDED_OVER,
    When.SWINGING: Stage.FLYING,
}

Act = Callable[[Flight], None]
"""Makes something go wrong that the mock has no word for."""


@dataclass(frozen=True)
class Conditions:
    """Conditions of the flight; keywords of tests.flights.simulated.fly."""

    config: CompanionConfig = CONFIG
    law: str = "etnn"
    """Name as in config/controllers/."""
    more: dict[str, Any] = field(default_factory=dict)


ARMS = Conditions(
    CompanionConfig(flight=BRISK, arms=ArmsConfig()), more={"arms": mock_arms(), "real_driver": True}
)  # fmt: skip
"""With both arms, as in config/mock.toml, and their real driver."""


@dataclass(frozen=True)
class Row:
    """One flight in simulated time."""

    fault: Fault
    """Fault as which it is recognised."""
    variant: str
    """Thing that goes wrong."""
    make: tuple[str | Act, ...]
    """Sentences for the mock, or what does it; the first one is the fault's begin."""
    ends: End
    limit_s: float
    """Longest time from the beginning of the fault to the reaction."""
    when: When = When.HOVER
    harmless: bool = False
    """Too short or too small to end a flight, whatever the table says of its longer brothers."""
    patience_s: float = 4.0
    """If nothing has come of it after so long, the operator lands."""
    flown_with: Conditions = Conditions()

    @property
    def name(self) -> str:
        """Return the name of this row in the table."""
        return f"{self.fault}: {self.variant}, {self.when}"

    @property
    def reaction(self) -> FailsafeAction:
        """Return the reaction by faults.TABLE; WARN for a harmless row."""
        return FailsafeAction.WARN if self.harmless else reaction_to(self.fault, STAGES[self.when])
