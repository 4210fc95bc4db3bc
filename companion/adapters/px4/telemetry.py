"""Telemetry from PX4: status, texts, and its local position estimate.

Messages arrive on MAVSDK's one thread for callbacks, in order, and replace frozen values that any thread may read. They
are taken by message and not by MAVSDK's Telemetry: that takes the newest battery's state for the battery's, fails on a
text that is no UTF-8 and prints its bytes, and asks for HOME_POSITION for ever.
"""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from companion.adapters.px4.mavlink import Px4Mavlink
from companion.adapters.system.log_lines import LineLimit, printable
from companion.core.interfaces import Clock
from companion.core.types import NOT_HEARD, Array, BatteryReading, FlightMode, unknown_vector
from companion.geometry.frames import flip_quat, flip_yz

LOG = logging.getLogger(__name__)

_TEXTS = 50
"""STATUSTEXTs that are kept."""
_FROM_VISION = 2 | 8 | 256
"""ESTIMATOR_STATUS_FLAGS: horizontal velocity, position, and its prediction; without GPS, only vision gives them.

A recorded PX4 v1.17 shows 229 without vision, 495 on the ground and 367 in the air with it.
"""
_LANDED_UNKNOWN, _ON_GROUND = 0, 1
"""MAV_LANDED_STATE; the others are in the air, taking off and landing."""
_DENIED = "denied"
"""In PX4's words for an arming or disarming that it refuses."""
_LAST_PIECE_S = 0.5
"""The pieces of a long text come at once: later than this, the rest was lost."""


_PIECE = 50
"""Characters of one STATUSTEXT; a shorter piece is the last one."""


_NOT_MEASURED = 65535
"""UINT16_MAX, mV."""


def reading(fields: dict[str, Any]) -> BatteryReading:
    """Return one BATTERY_STATUS as SI values; NaN for what PX4 does not know: a charge of -1 %, no cell's voltage."""
    cells = [mv for mv in fields["voltages"] if mv != _NOT_MEASURED]
    cells += [mv for mv in fields.get("voltages_ext") or () if mv]  # 0: no such cell
    percent = fields["battery_remaining"]
    return BatteryReading(
        id=fields["id"],
        fraction=percent / 100.0 if percent >= 0 else math.nan,
        voltage_v=1e-3 * sum(cells) if cells else math.nan,
    )


def merged(known: Sequence[BatteryReading], new: BatteryReading) -> tuple[BatteryReading, ...]:
    """Return the readings with the new one in the place of its battery's last; by number."""
    others = [one for one in known if one.id != new.id]
    return tuple(sorted((*others, new), key=lambda one: one.id))


def flight_battery(known: Sequence[BatteryReading], configured: int | None) -> BatteryReading:
    """Return the reading of the configured battery, else of the lowest number heard; all unknown if there is none."""
    for one in known:
        if configured is None or one.id == configured:
            return one
    return BatteryReading(id=-1 if configured is None else configured, fraction=math.nan, voltage_v=math.nan)


@dataclass(frozen=True)
class TextPieces:
    """A text whose last piece has not come yet; MAVLink's `id` says which pieces belong together, 0: a whole text."""

    id: int = 0
    text: str = ""

    def add(self, id_: int, piece: str) -> tuple["TextPieces", tuple[str, ...]]:
        """Return what is still incomplete and the texts that are whole now; one whose end was lost ends here."""
        lost_end = (self.text,) if self.text and id_ != self.id else ()
        text = self.text + piece if id_ and id_ == self.id else piece
        if id_ and len(piece) >= _PIECE:
            return TextPieces(id_, text), lost_end
        return TextPieces(), (*lost_end, text)


@dataclass(frozen=True)
class LocalEstimate:
    """PX4's local position estimate (EKF2) in W, provided that its origin is motion capture's."""

    time_s: float = -math.inf
    """Arrival of the newest position on our monotonic clock; -inf before the first. It comes without vision, too."""
    position_w_m: Array = field(default_factory=unknown_vector)
    """Shape (3,); NaN before the first."""
    velocity_w_mps: Array = field(default_factory=unknown_vector)
    """Shape (3,); NaN before the first."""
    flags_s: float = -math.inf
    """Arrival of the newest flags; they come at 1 Hz."""
    flags: int = 0
    """ESTIMATOR_STATUS_FLAGS of MAVLink."""

    @property
    def vision_fused(self) -> bool:
        """True when EKF2 fuses position measurements; indoors these are vision."""
        return self.flags & _FROM_VISION == _FROM_VISION


class Px4Telemetry:
    """Newest status, texts and local position received from PX4."""

    def __init__(
        self, system: Any, mavlink: Px4Mavlink, clock: Clock, battery_id: int | None, rebooted: Callable[[], None]
    ) -> None:
        """`battery_id` is the battery that carries the vehicle, None: the lowest number heard.

        `rebooted` is called on MAVSDK's thread when the autopilot has rebooted and lost the requested message rates.
        """
        self._system, self._mavlink, self._clock = system, mavlink, clock
        self._battery_id, self._rebooted = battery_id, rebooted
        self.status = replace(NOT_HEARD, system_id=system.get_system_id())
        self.local = LocalEstimate()
        self._mode_s = -math.inf
        self._texts: list[tuple[float, str]] = []
        self._pieces, self._pieces_s = TextPieces(), -math.inf
        self._lines = LineLimit()
        self._subscribe()

    def mode_since(self, since_s: float) -> FlightMode | None:
        """Return the mode if a message after `since_s` on our clock showed it, else None."""
        return self.status.mode if self._mode_s > since_s else None

    def armed_since(self, since_s: float) -> bool | None:
        """Return the armed state if a HEARTBEAT after `since_s` on our clock showed it, else None."""
        return self.status.armed if self.status.heartbeat_s > since_s else None

    def texts_since(self, time_s: float) -> list[str]:
        """Return STATUSTEXTs since `time_s` on our clock, oldest first."""
        return [text for at_s, text in self._texts if at_s >= time_s]

    def _subscribe(self) -> None:
        on = self._mavlink.on
        self._system.subscribe_is_connected(lambda up, _: self._update(connected=up))
        self._mavlink.on_heartbeat(self._on_heartbeat)
        self._mavlink.on_current_mode(self._on_current_mode)
        on("ESTIMATOR_STATUS", self._on_estimator)
        on("EXTENDED_SYS_STATE", self._on_landed)
        on("ATTITUDE_QUATERNION", self._on_attitude)
        on("LOCAL_POSITION_NED", self._on_local)
        on("BATTERY_STATUS", lambda fields: self._on_battery(reading(fields)))
        on("STATUSTEXT", self._on_text)

    def _update(self, **changes: Any) -> None:
        self.status = replace(self.status, **changes)

    def _on_heartbeat(self, armed: bool, mode: FlightMode) -> None:
        now_s = self._clock.now_s()
        if armed != self.status.armed and _DENIED in self.status.last_text.lower():
            self._update(last_text="")  # "Disarming denied: not landed" is over once it is disarmed
        self._update(armed=armed, mode=mode, heartbeat_s=now_s, heard_s=now_s)
        self._mode_s = now_s
        self._give_up_pieces()

    def _on_current_mode(self, mode: FlightMode, failsafe: bool) -> None:
        now_s = self._clock.now_s()
        self._update(mode=mode, failsafe=failsafe, heard_s=now_s)
        self._mode_s = now_s

    def _on_attitude(self, fields: dict[str, Any]) -> None:
        """Handle the attitude, at 50 Hz the most frequent message: it also shows reboots."""
        boot_s = fields["time_boot_ms"] * 1e-3
        if boot_s < self.status.boot_s:
            self._rebooted()
        attitude, now_s = flip_quat(_floats(fields, "q1", "q2", "q3", "q4")), self._clock.now_s()
        rate = flip_yz(_floats(fields, "rollspeed", "pitchspeed", "yawspeed"))
        self._update(q_w_flu_wxyz=attitude, rate_flu_radps=rate, attitude_s=now_s, heard_s=now_s, boot_s=boot_s)

    def _on_local(self, fields: dict[str, Any]) -> None:
        """Handle position and velocity, at 30 Hz by default, as recorded from PX4 v1.17."""
        velocity, now_s = flip_yz(_floats(fields, "vx", "vy", "vz")), self._clock.now_s()
        position = flip_yz(_floats(fields, "x", "y", "z"))
        self.local = replace(self.local, time_s=now_s, position_w_m=position, velocity_w_mps=velocity)
        self._update(velocity_w_mps=velocity, velocity_s=now_s)

    def _on_estimator(self, fields: dict[str, Any]) -> None:
        self.local = replace(self.local, flags=fields["flags"], flags_s=self._clock.now_s())

    def _on_landed(self, fields: dict[str, Any]) -> None:
        state = fields["landed_state"]
        self._update(in_air=None if state == _LANDED_UNKNOWN else state != _ON_GROUND)

    def _on_battery(self, new: BatteryReading) -> None:
        batteries = merged(self.status.batteries, new)
        ours = flight_battery(batteries, self._battery_id)
        self._update(batteries=batteries, battery_id=ours.id, battery_fraction=ours.fraction, battery_v=ours.voltage_v)

    def _on_text(self, fields: dict[str, Any]) -> None:
        self._pieces, whole = self._pieces.add(fields.get("id") or 0, fields["text"])
        self._pieces_s = self._clock.now_s()
        self._keep_texts(whole)

    def _give_up_pieces(self) -> None:
        """Accept a long text whose last piece was lost."""
        if self._pieces.text and self._clock.now_s() - self._pieces_s > _LAST_PIECE_S:
            pieces, self._pieces = self._pieces, TextPieces()
            self._keep_texts((pieces.text,))

    def _keep_texts(self, texts: tuple[str, ...]) -> None:
        for text in filter(None, map(printable, texts)):
            now_s = self._clock.now_s()
            self._texts = [*self._texts[1 - _TEXTS :], (now_s, text)]
            self._update(last_text=text, text_s=now_s)
            self._lines.log(partial(LOG.info, "the autopilot says: %s%s", text))


def _floats(fields: dict[str, Any], *names: str) -> Array:
    """Return fields as an array; JSON has no NaN, so that it is null there."""
    return np.array([math.nan if fields[name] is None else fields[name] for name in names])
