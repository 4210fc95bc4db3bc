"""What PX4 says of itself, as it arrives: status, texts, and where its own estimator believes to be.

Telemetry arrives on MAVSDK's one thread for callbacks, in order, and replaces frozen values that any thread may read.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mavsdk.plugins.telemetry import LandedState, Telemetry

from companion.adapters.px4.direct import Px4Direct
from companion.control.frames import flip_quat, flip_yz
from companion.ports import Clock
from companion.types import Array, AutopilotStatus, FlightMode

_TEXTS = 50
"""STATUSTEXTs that are kept."""
_FROM_VISION = 2 | 8 | 256
"""ESTIMATOR_STATUS_FLAGS: horizontal velocity, position, and its prediction; without GPS, only vision gives them.

A recorded PX4 v1.17 shows 229 without vision, 495 on the ground and 367 in the air with it.
"""


def _in_air(state: LandedState) -> bool | None:
    return None if state is LandedState.UNKNOWN else state is not LandedState.ON_GROUND


def _nowhere() -> Array:
    return np.full(3, np.nan)


@dataclass(frozen=True)
class LocalEstimate:
    """PX4's local position estimate (EKF2) in W, provided that its origin is motion capture's."""

    time_s: float = -math.inf
    """Arrival of the newest position on our monotonic clock; -inf before the first. It comes without vision, too."""
    position_w_m: Array = field(default_factory=_nowhere)
    """Shape (3,); NaN before the first."""
    velocity_w_mps: Array = field(default_factory=_nowhere)
    """Shape (3,); NaN before the first."""
    flags_s: float = -math.inf
    """Arrival of the newest flags; they come at 1 Hz."""
    flags: int = 0
    """ESTIMATOR_STATUS_FLAGS of MAVLink."""

    @property
    def vision_fused(self) -> bool:
        """Whether the estimate comes from measurements of its position; indoors that is vision."""
        return self.flags & _FROM_VISION == _FROM_VISION


class Px4Heard:
    """The newest of everything."""

    def __init__(self, system: Any, direct: Px4Direct, clock: Clock) -> None:
        self._system, self._direct, self._clock = system, direct, clock
        self._telemetry = Telemetry(system)
        level = np.array([1.0, 0.0, 0.0, 0.0])
        self.status = AutopilotStatus(True, -math.inf, False, FlightMode.OTHER, None, math.nan, math.nan, level, "")
        self.local = LocalEstimate()
        self._mode_s = -math.inf
        self._texts: list[tuple[float, str]] = []
        self._subscribe()

    def mode_since(self, since_s: float) -> FlightMode | None:
        """The mode, if a message showed it after `since_s` on our clock."""
        return self.status.mode if self._mode_s > since_s else None

    def armed_since(self, since_s: float) -> bool | None:
        """Whether armed, if a HEARTBEAT showed it after `since_s` on our clock."""
        return self.status.armed if self.status.heartbeat_s > since_s else None

    def texts_since(self, time_s: float) -> list[str]:
        """STATUSTEXTs since `time_s` on our clock, oldest first."""
        return [text for at_s, text in self._texts if at_s >= time_s]

    def _subscribe(self) -> None:
        t = self._telemetry
        self._system.subscribe_is_connected(lambda up, _: self._update(connected=up))
        self._direct.on_heartbeat(self._on_heartbeat)
        self._direct.on_current_mode(self._on_current_mode)
        self._direct.on("ESTIMATOR_STATUS", self._on_estimator)
        t.subscribe_landed_state(lambda state, _: self._update(in_air=_in_air(state)))
        t.subscribe_attitude_quaternion(lambda q, _: self._on_attitude(q))
        t.subscribe_position_velocity_ned(lambda ned, _: self._on_local(ned.position, ned.velocity))
        t.subscribe_battery(
            lambda b, _: self._update(battery_fraction=b.remaining_percent / 100.0, battery_v=b.voltage_v)
        )
        t.subscribe_status_text(lambda text, _: self._on_text(text.text))

    def _update(self, **changes: Any) -> None:
        self.status = replace(self.status, **changes)

    def _on_heartbeat(self, armed: bool, mode: FlightMode) -> None:
        now_s = self._clock.now_s()
        self._update(armed=armed, mode=mode, heartbeat_s=now_s, heard_s=now_s)
        self._mode_s = now_s

    def _on_current_mode(self, mode: FlightMode) -> None:
        now_s = self._clock.now_s()
        self._update(mode=mode, heard_s=now_s)
        self._mode_s = now_s

    def _on_attitude(self, q: Any) -> None:
        """At 50 Hz, the most frequent message we take: it shows that the autopilot is there, and since when."""
        boot_s = q.timestamp_us * 1e-6
        if boot_s < self.status.boot_s:  # it has forgotten what we asked for
            self._direct.ask_for_current_mode(lambda _granted: None)
        attitude, now_s = flip_quat(np.array([q.w, q.x, q.y, q.z])), self._clock.now_s()
        self._update(q_w_flu_wxyz=attitude, attitude_s=now_s, heard_s=now_s, boot_s=boot_s)

    def _on_local(self, position: Any, velocity: Any) -> None:
        self.local = replace(
            self.local,
            time_s=self._clock.now_s(),
            position_w_m=flip_yz(np.array([position.north_m, position.east_m, position.down_m])),
            velocity_w_mps=flip_yz(np.array([velocity.north_m_s, velocity.east_m_s, velocity.down_m_s])),
        )

    def _on_estimator(self, fields: dict[str, Any]) -> None:
        self.local = replace(self.local, flags=fields["flags"], flags_s=self._clock.now_s())

    def _on_text(self, text: str) -> None:
        text = text.strip()
        self._texts = [*self._texts[1 - _TEXTS :], (self._clock.now_s(), text)]
        self._update(last_text=text)
