"""A recorded PX4 heard by the companion's own reader, message by message, on the recording's clock."""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from companion.adapters.px4 import mavlink
from companion.adapters.px4.mavlink import Px4Mavlink
from companion.adapters.px4.telemetry import Px4Telemetry
from tests.mock_autopilot.reenact.session import Session
from tests.mock_autopilot.reenact.tlog import Decoder, Frame

ATTITUDE_PERIOD_S = 0.02
AUTOPILOT = 1


@dataclass
class HandClock:
    """A clock that shows what it is set to."""

    time_s: float = 0.0

    def now_s(self) -> float:
        return self.time_s


@dataclass(frozen=True, kw_only=True)
class PluginMessage:
    """A message as MAVSDK hands it out."""

    component_id: int
    fields_json: str


class FakeSystem:
    """Stand-in with the parts of MAVSDK's System that the reader needs."""

    def get_system_id(self) -> int:
        return 1

    def subscribe_is_connected(self, take: Callable[[bool, Any], None]) -> None:
        take(True, None)


class FakePlugin:
    """MAVSDK's MavlinkDirect, with messages from a recording."""

    def __init__(self, _system: Any) -> None:
        self._takes: dict[str, Callable[[PluginMessage, Any], None]] = {}

    def subscribe_message(self, name: str, take: Callable[[PluginMessage, Any], None]) -> None:
        self._takes[name] = take

    def hand_out(self, name: str, fields: dict[str, Any]) -> None:
        """Give a message to whoever wants it; JSON has no NaN."""
        if name in self._takes:
            known = {
                key: None if isinstance(value, float) and math.isnan(value) else value for key, value in fields.items()
            }
            self._takes[name](PluginMessage(component_id=AUTOPILOT, fields_json=json.dumps(known)), None)


class RecordedPx4:
    """The companion's view of a session, advanced step by step."""

    def __init__(self, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(mavlink, "MavlinkDirect", FakePlugin)
        self.clock = HandClock()
        self.reboots = 0
        system = FakeSystem()
        reader = Px4Mavlink(system)
        self._plugin: Any = reader._plugin
        self.heard = Px4Telemetry(system, reader, self.clock, None, self._rebooted)
        self._silent_s = session.silent_s
        self._messages = _messages(session)

    def _rebooted(self) -> None:
        self.reboots += 1

    def advance(self, to_s: float) -> None:
        """Pass all messages up to this time to the reader."""
        while self._messages and self._messages[0][0] <= to_s:
            at_s, name, fields = self._messages.pop(0)
            self.clock.time_s = at_s
            self._plugin.hand_out(name, fields)
        self.clock.time_s = to_s


def _messages(session: Session) -> list[tuple[float, str, dict[str, Any]]]:
    """Return what PX4 told, and between that an attitude at 50 Hz, which is how the companion knows it is there."""
    decoder = Decoder()
    decoded = [(one.at_s, decoder.message(Frame(at_s=one.at_s, raw=one.raw))) for one in session.told]
    told = [(at_s, m.get_type(), m.to_dict()) for at_s, m in decoded if m is not None]
    return sorted([*told, *_attitudes(session)], key=lambda one: one[0])


def _attitudes(session: Session) -> Iterator[tuple[float, str, dict[str, Any]]]:
    booted_s = 0.0
    for step in range(math.floor(session.ends_at_s / ATTITUDE_PERIOD_S)):
        at_s = step * ATTITUDE_PERIOD_S
        booted_s = max([booted_s, *(on_s for _, on_s in session.silent_s if on_s <= at_s)])
        if not any(off_s < at_s < on_s for off_s, on_s in session.silent_s):
            upright = {"q1": 1.0, "q2": 0.0, "q3": 0.0, "q4": 0.0, "rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.0}
            yield at_s, "ATTITUDE_QUATERNION", {"time_boot_ms": round((at_s - booted_s) * 1e3), **upright}
