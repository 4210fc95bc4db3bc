"""The end of landings as PX4 v1.17.0 told it, recorded in simulation (SIH quadrotor) on 2026-11-29.

Times are those of the recordings, s. EXTENDED_SYS_STATE came at 1 Hz there.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from companion.core.types import FlightMode

OFFBOARD, LAND, POSITION = FlightMode.OFFBOARD, FlightMode.LAND, FlightMode.POSITION


@dataclass(frozen=True)
class Heartbeat:
    """HEARTBEAT: armed bit and mode."""

    armed: bool
    mode: FlightMode


@dataclass(frozen=True)
class CurrentMode:
    """CURRENT_MODE."""

    mode: FlightMode


@dataclass(frozen=True)
class Landed:
    """EXTENDED_SYS_STATE: in the air or not."""

    in_air: bool


Message = Heartbeat | CurrentMode | Landed


@dataclass(frozen=True)
class Seen:
    """Content of the newest messages at a time."""

    time_s: float
    armed: bool
    mode: FlightMode
    in_air: bool


@dataclass(frozen=True)
class Landing:
    """One recording, from the moment at which the vehicle was another's."""

    name: str
    given_up_s: float
    """When we handed it over, or saw it taken."""
    taken: bool
    """PX4 or a pilot took it; False: we told PX4 to land."""
    messages: tuple[tuple[float, Message], ...]
    end_s: float
    """When the HEARTBEAT showed it disarmed."""

    def seen(self, period_s: float = 0.01) -> Iterator[Seen]:
        """Yield what is known at every cycle from `given_up_s` until half a second after the end."""
        time_s, armed, mode, in_air, left = self.given_up_s, True, OFFBOARD, True, list(self.messages)
        while time_s < self.end_s + 0.5:
            time_s += period_s
            while left and left[0][0] <= time_s:
                _, message = left.pop(0)
                if isinstance(message, Heartbeat):
                    armed, mode = message.armed, message.mode
                elif isinstance(message, CurrentMode):
                    mode = message.mode
                else:
                    in_air = message.in_air
            yield Seen(time_s, armed, mode, in_air)


LANDINGS = (
    Landing("motion capture silent for 1 s", 25.842, False, (
        (25.904, CurrentMode(LAND)), (25.996, Heartbeat(True, LAND)), (26.996, Heartbeat(True, LAND)),
        (27.996, Heartbeat(True, LAND)), (28.996, Heartbeat(True, LAND)), (29.996, Heartbeat(True, LAND)),
        (30.996, Heartbeat(True, LAND)), (31.996, Landed(False)), (31.996, Heartbeat(True, LAND)),
        (32.996, Heartbeat(True, LAND)), (33.768, CurrentMode(OFFBOARD)), (33.996, Heartbeat(False, OFFBOARD)),
    ), 33.996),
    Landing("motion capture gone", 25.673, False, (
        (25.736, CurrentMode(LAND)), (25.996, Heartbeat(True, LAND)), (26.996, Heartbeat(True, LAND)),
        (27.996, Heartbeat(True, LAND)), (28.996, Heartbeat(True, LAND)), (29.996, Heartbeat(True, LAND)),
        (30.996, Heartbeat(True, LAND)), (31.808, Landed(False)), (31.996, Heartbeat(True, LAND)),
        (32.996, Heartbeat(True, LAND)), (33.104, CurrentMode(OFFBOARD)), (33.996, Heartbeat(False, OFFBOARD)),
    ), 33.996),
    Landing("remote control lost", 26.084, True, (
        (26.084, CurrentMode(LAND)), (26.996, Heartbeat(True, LAND)), (27.996, Heartbeat(True, LAND)),
        (28.996, Heartbeat(True, LAND)), (29.996, Heartbeat(True, LAND)), (30.996, Heartbeat(True, LAND)),
        (31.996, Heartbeat(True, LAND)), (31.996, Landed(False)), (32.996, Heartbeat(True, LAND)),
        (33.368, CurrentMode(OFFBOARD)), (33.996, Heartbeat(False, OFFBOARD)),
    ), 33.996),
    Landing("setpoints and poses end together", 26.068, True, (
        (26.084, CurrentMode(LAND)), (26.996, Heartbeat(True, LAND)), (27.996, Heartbeat(True, LAND)),
        (28.996, Heartbeat(True, LAND)), (29.996, Heartbeat(True, LAND)), (30.996, Heartbeat(True, LAND)),
        (31.996, Heartbeat(True, LAND)), (32.900, Landed(False)), (32.996, Heartbeat(True, LAND)),
        (33.996, Heartbeat(True, LAND)), (34.212, CurrentMode(OFFBOARD)), (34.996, Heartbeat(False, OFFBOARD)),
    ), 34.996),
)  # fmt: skip

TOUCHDOWN_TO_LANDED_S = (0.83, 0.83, 0.83, 0.83, 0.83, 1.3, 1.3, 2.35, 2.35)
"""Time from touchdown until PX4 granted disarming, in nine landings; it was first asked 0.3 s after touchdown."""
