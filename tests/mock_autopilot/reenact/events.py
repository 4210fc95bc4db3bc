"""PX4's messages on a link as events: answers, texts, and every change of a repeated state.

The same code reads the recording and the mock's own frames, so both are seen as a client sees them.
"""

import re
import struct
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

RESULTS = {0: "ACCEPTED", 1: "TEMPORARILY_REJECTED", 2: "DENIED", 3: "UNSUPPORTED", 4: "FAILED"}
COMMANDS = {21: "NAV_LAND", 22: "NAV_TAKEOFF", 176: "DO_SET_MODE", 400: "ARM_DISARM", 511: "SET_MESSAGE_INTERVAL",
            512: "REQUEST_MESSAGE", 1000: "GIMBAL_PITCHYAW", 1001: "GIMBAL_CONFIGURE"}  # fmt: skip
TERRAIN_HEIGHT = 64
"""ESTIMATOR_STATUS bit of the height above ground: PX4's comes and goes by chance, several times a minute."""
BATTERY_STEP = 10
FAILSAFE_OVER = "failsafe over"
REPLIES = frozenset({"AUTOPILOT_VERSION", "GPS_GLOBAL_ORIGIN"})


@dataclass(frozen=True, kw_only=True)
class Event:
    """One thing PX4 told; `channel` is the message it came by."""

    at_s: float
    link: str
    channel: str
    what: str


def normalised(text: str) -> str:
    """A text without its closing tab and with every number as #."""
    return re.sub(r"\d+(\.\d+)?", "#", text.rstrip("\t"))


class EventReader:
    """Turns the messages of one link into events; feed it in order."""

    def __init__(self, link: str) -> None:
        self._link = link
        self._seen: dict[str, Any] = {}
        self._chunks: dict[int, str] = {}
        self.events: list[Event] = []

    def take(self, at_s: float, message: Any) -> list[Event]:
        """Return the events of this message that are new."""
        reader = READERS.get(message.get_type())
        told = [] if reader is None else reader(self, message)
        new = [Event(at_s=at_s, link=self._link, channel=channel, what=what) for channel, what in told]
        self.events += new
        return new

    def forget_charge(self) -> None:
        """Skip the steps of the charge since the last message: they fell into a stretch that was left out."""
        self._seen.pop("charge", None)

    # -- one reader per message ------------------------------------------------------------------

    def _ack(self, m: Any) -> list[tuple[str, str]]:
        return [("COMMAND_ACK", f"{COMMANDS.get(m.command, m.command)} {RESULTS.get(m.result, m.result)}")]

    def _text(self, m: Any) -> list[tuple[str, str]]:
        """Join the chunks of a long text; a full chunk is followed by the next one."""
        part = m.text if isinstance(m.text, str) else m.text.decode(errors="replace")
        whole = self._chunks.pop(m.id, "") + part
        if m.id and len(part) == 50:
            self._chunks[m.id] = whole
            return []
        return [("STATUSTEXT", f"{m.severity}: {normalised(whole)}")]

    def _heartbeat(self, m: Any) -> list[tuple[str, str]]:
        main, sub = m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF
        return self._changed("HEARTBEAT", f"{m.base_mode}, {main}/{sub}, {m.system_status}")

    def _mode(self, m: Any) -> list[tuple[str, str]]:
        flown, wanted = (f"{c >> 16 & 0xFF}/{c >> 24 & 0xFF}" for c in (m.custom_mode, m.intended_custom_mode))
        what = flown if flown == wanted else f"{flown}, wanted {wanted}"
        before = self._seen.get("CURRENT_MODE", "")
        told = self._changed("CURRENT_MODE", what)
        over = flown == wanted and before.endswith(f"wanted {wanted}")
        return [("CURRENT_MODE", f"{what}, {FAILSAFE_OVER}")] if told and over else told

    def _landed(self, m: Any) -> list[tuple[str, str]]:
        states = {1: "on ground", 2: "in air", 3: "taking off", 4: "landing"}
        return self._changed("EXTENDED_SYS_STATE", states.get(m.landed_state, str(m.landed_state)))

    def _sys_status(self, m: Any) -> list[tuple[str, str]]:
        bits = [
            ("present", m.onboard_control_sensors_present),
            ("enabled", m.onboard_control_sensors_enabled),
            ("healthy", m.onboard_control_sensors_health),
        ]
        out = [one for name, value in bits for one in self._bits("SYS_STATUS", name, value, _sensor)]
        return out + self._charge(m.battery_remaining)

    def _charge(self, percent: int) -> list[tuple[str, str]]:
        """Every ten percent on the way down, and full again."""
        step = -(-percent // BATTERY_STEP) * BATTERY_STEP
        before, self._seen["charge"] = self._seen.get("charge", step), step
        if step < before:
            return [("battery", f"at {step} %")]
        return [("battery", "full again")] if step == 100 and before < 100 else []

    def _battery(self, m: Any) -> list[tuple[str, str]]:
        return self._changed("BATTERY_STATUS", f"charge_state {m.charge_state}")

    def _estimator(self, m: Any) -> list[tuple[str, str]]:
        return self._bits("ESTIMATOR_STATUS", "flag", m.flags & ~TERRAIN_HEIGHT, str)

    def _command(self, m: Any) -> list[tuple[str, str]]:
        name = COMMANDS.get(m.command, m.command)
        return [("COMMAND_LONG", f"{name} p1={m.param1:g} confirmation={m.confirmation}")]

    def _param(self, m: Any) -> list[tuple[str, str]]:
        return [("PARAM_VALUE", f"{m.param_id} = {param_value(m):g}")]

    def _reply(self, m: Any) -> list[tuple[str, str]]:
        return [("reply", m.get_type())]

    def _changed(self, channel: str, what: str) -> list[tuple[str, str]]:
        before, self._seen[channel] = self._seen.get(channel), what
        return [] if what == before else [(channel, what)]

    def _bits(self, channel: str, name: str, value: int, title: Any) -> list[tuple[str, str]]:
        """One event per bit that turned; the first value is one event."""
        key = f"{channel} {name}"
        before, self._seen[key] = self._seen.get(key), value
        if before is None:
            return [(channel, f"{name} {value:#x} at first")]
        turned = [1 << bit for bit in range(32) if (before ^ value) >> bit & 1]
        return [(channel, f"{name} {'+' if value & bit else '-'}{title(bit)}") for bit in turned]


def _sensor(bit: int) -> str:
    known = mavlink.enums["MAV_SYS_STATUS_SENSOR"].get(bit)
    name = known.name if known is not None else hex(bit)
    return name.removeprefix("MAV_SYS_STATUS_").removeprefix("SENSOR_")


def param_value(m: Any) -> float:
    """PARAM_VALUE's number; integers lie byte by byte in the float."""
    return (
        float(m.param_value) if m.param_type == 9 else float(struct.unpack("<i", struct.pack("<f", m.param_value))[0])
    )


READERS = {
    "COMMAND_ACK": EventReader._ack,
    "STATUSTEXT": EventReader._text,
    "HEARTBEAT": EventReader._heartbeat,
    "CURRENT_MODE": EventReader._mode,
    "EXTENDED_SYS_STATE": EventReader._landed,
    "SYS_STATUS": EventReader._sys_status,
    "BATTERY_STATUS": EventReader._battery,
    "ESTIMATOR_STATUS": EventReader._estimator,
    "COMMAND_LONG": EventReader._command,
    "PARAM_VALUE": EventReader._param,
    **dict.fromkeys(REPLIES, EventReader._reply),
}
