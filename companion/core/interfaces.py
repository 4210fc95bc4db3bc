"""What the service asks of a device, and the few exceptions a device may raise.

Adapters implement these; the flight loop and the tests know nothing else of them.
"""

from typing import Protocol

from companion.core.errors import ArmError, AutopilotError, CompanionError, ConfigError, FlightError, MocapError
from companion.core.types import ArmStatus, Array, AttitudeThrust, AutopilotStatus, MocapFrame

__all__ = [
    "ArmBus",
    "ArmError",
    "Autopilot",
    "AutopilotError",
    "Clock",
    "CompanionError",
    "ConfigError",
    "FlightError",
    "MocapError",
    "MocapSource",
    "OperatorLink",
    "WatchdogTimer",
]


class Clock(Protocol):
    """Monotonic time of this machine."""

    def now_s(self) -> float:
        """Seconds since some fixed instant; never goes back."""


class MocapSource(Protocol):
    """A stream of frames of one body; latest wins, nothing is queued."""

    def latest(self) -> MocapFrame | None:
        """The newest frame, or None before the first one."""

    async def wait_frame(self, timeout_s: float) -> bool:
        """Wait until a frame newer than the last `wait_frame` returned for is there; False on time-out.

        Raises MocapError when the connection is lost.
        """

    def why_silent(self) -> str:
        """Return the sentence that says why no frames come, as far as it is known; empty when it is not."""


class Autopilot(Protocol):
    """The flight controller in offboard mode."""

    def send_setpoint(self, setpoint: AttitudeThrust) -> None:
        """Send one attitude setpoint now (single vehicle: shapes (4,) and ())."""

    def send_vision(self, position_w_m: Array, q_w_flu_wxyz: Array) -> None:
        """Forward one motion-capture pose as external vision."""

    def status(self) -> AutopilotStatus:
        """The last known state; never waits."""

    def stop_stream(self) -> None:
        """No setpoint leaves any more, not even the last one again, until the next `send_setpoint`; never waits."""

    async def start_offboard(self) -> None:
        """Ask for OFFBOARD and wait until the autopilot itself shows it; AutopilotError with its reason otherwise."""

    async def arm(self) -> None:
        """Arm and wait until shown; AutopilotError with the autopilot's own reason otherwise."""

    async def disarm(self) -> None:
        """Disarm and wait until shown; AutopilotError with the autopilot's own reason otherwise."""

    async def land(self) -> None:
        """Hand over to the autopilot's own landing; AutopilotError when refused."""

    async def kill(self) -> None:
        """Stop the motors at once, also in the air."""


class WatchdogTimer(Protocol):
    """Ends this process when the control loop stops, so that no setpoint leaves it any more."""

    def renew(self) -> None:
        """Once a cycle while setpoints leave: so much time again from now."""

    def release(self) -> None:
        """Nothing is streamed any more: the process may take its time."""


class OperatorLink(Protocol):
    """The way to the operator's commands."""

    def age_s(self) -> float:
        """Since the broker was last there, s; 0 while it is. Never waits."""


class ArmBus(Protocol):
    """The servos of both arms. A broken servo shows in `status().faults`; nothing here raises because of one."""

    def status(self) -> ArmStatus:
        """The last known state; never waits."""

    def move(self, position_rad: Array) -> None:
        """Take new goals, (8,); never waits, the latest wins. A faulty or limp joint ignores its own."""

    def hold(self) -> None:
        """Bring every joint's goals to rest, and leave those that stand; never waits. Torque stays on."""

    async def torque_on(self) -> None:
        """Hold every joint where it is, without a jump; ArmError naming the joints that refuse."""

    async def torque_off(self) -> None:
        """Let every joint go limp; ArmError naming the joints that do not answer."""

    async def clear_faults(self) -> None:
        """Forget latched faults, rebooting what needs it (it loses torque); ArmError naming what is still wrong."""
