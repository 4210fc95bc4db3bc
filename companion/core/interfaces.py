"""Interfaces of the devices that the service drives, and the exceptions that a device may raise.

Adapters implement them; the flight loop and the tests depend on nothing else of an adapter.
"""

from typing import Protocol

from companion.core.errors import ArmError, AutopilotError, CompanionError, ConfigError, FlightError, MocapError
from companion.core.types import ArmStatus, Array, AttitudeThrust, AutopilotStatus, GroundPose, MocapFrame, OtherService

__all__ = [
    "ArmBus",
    "ArmError",
    "Autopilot",
    "AutopilotError",
    "Clock",
    "CompanionError",
    "ConfigError",
    "FlightError",
    "GroundPoses",
    "MocapError",
    "MocapSource",
    "OperatorLink",
    "WatchdogTimer",
]


class Clock(Protocol):
    """Monotonic clock of this computer."""

    def now_s(self) -> float:
        """Return the seconds since some fixed instant; never decreases."""


class MocapSource(Protocol):
    """Stream of frames of one body; the latest wins, nothing is queued."""

    def latest(self) -> MocapFrame | None:
        """Return the newest frame, or None before the first one."""

    async def wait_frame(self, timeout_s: float) -> bool:
        """Wait for a frame newer than the one the last `wait_frame` returned for; return False on time-out.

        Raises MocapError when the connection is lost.
        """

    def why_silent(self) -> str:
        """Return a sentence that says why no frames arrive; empty when the reason is not known."""


class GroundPoses(Protocol):
    """Poses that come with the commands of a law on the ground; the latest wins, nothing is queued."""

    def latest_pose(self) -> GroundPose | None:
        """Return the newest pose, or None before the first one; never waits."""


class Autopilot(Protocol):
    """The flight controller in offboard mode."""

    def send_setpoint(self, setpoint: AttitudeThrust) -> None:
        """Send one attitude setpoint now (single vehicle: shapes (4,) and ())."""

    def send_vision(self, position_w_m: Array, q_w_flu_wxyz: Array) -> None:
        """Forward one motion-capture pose as external vision."""

    def status(self) -> AutopilotStatus:
        """Return the last known state; never waits."""

    def stop_stream(self) -> None:
        """Stop sending setpoints, also repeated ones, until the next `send_setpoint`; never waits."""

    async def start_offboard(self) -> None:
        """Request OFFBOARD and wait until the autopilot reports it; AutopilotError with its reason otherwise."""

    async def arm(self) -> None:
        """Arm and wait until the autopilot reports it; AutopilotError with the autopilot's own reason otherwise."""

    async def disarm(self) -> None:
        """Disarm and wait until the autopilot reports it; AutopilotError with the autopilot's own reason otherwise."""

    async def land(self) -> None:
        """Hand over to the autopilot's own landing; AutopilotError when it rejects that."""

    async def kill(self) -> None:
        """Stop the motors at once, also in the air."""


class WatchdogTimer(Protocol):
    """Timer that ends this process when the control loop stops, so that it sends no more setpoints."""

    def renew(self) -> None:
        """Restart the timer; called once a cycle while setpoints are sent."""

    def release(self) -> None:
        """Stop the timer; called when setpoints are no longer sent."""


class OperatorLink(Protocol):
    """Connection to the operator's commands."""

    def age_s(self) -> float:
        """Return the time since the broker was last connected (s); 0 while it is. Never waits."""

    def others(self) -> tuple[OtherService, ...]:
        """Return the services of other vehicles that are heard on the broker now. Never waits."""


class ArmBus(Protocol):
    """Servos of both arms. A broken servo is reported in `status().faults`; nothing here raises because of one."""

    def status(self) -> ArmStatus:
        """Return the last known state; never waits."""

    def move(self, position_rad: Array) -> None:
        """Set new goals, (8,); never waits, the latest wins. A faulty or limp joint ignores its goal."""

    def hold(self) -> None:
        """Bring every moving goal to rest and leave the others; never waits. Torque stays on."""

    async def torque_on(self) -> None:
        """Hold every joint where it is, without a jump; ArmError naming the joints that refuse."""

    async def torque_off(self) -> None:
        """Switch the torque of every joint off; ArmError naming the joints that do not answer."""

    async def clear_faults(self) -> None:
        """Clear latched faults, rebooting servos that need it (torque is lost); ArmError naming what is still wrong."""
