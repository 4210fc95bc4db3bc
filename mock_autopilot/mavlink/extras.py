"""Messages around the flight that PX4 sends and clients must digest, with the contents recorded from PX4 v1.17."""

import math
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.mavlink.messages import Message
from mock_autopilot.world import World

METADATA_URI = b"mftp://etc/extras/component_general.json.xz"
METADATA_CRC = 0x3115642B
GIMBAL_PITCHYAW, GIMBAL_CONFIGURE = 1000, 1001
GIMBAL_FIRST_S = 0.28
GIMBAL_RETRIES_S = (0.78, 1.29, 2.34)
MODES = (
    (1, 0, 0, "Manual"),
    (2, 0, 4, ""),
    (3, 0, 1, ""),
    (4, 4, 6, ""),
    (4, 3, 0, "Hold"),
    (4, 5, 5, ""),
    (5, 0, 0, "Acro"),
    (6, 0, 0, "Offboard"),
    (7, 0, 0, "Stabilized"),
    (4, 2, 8, ""),
    (4, 6, 7, ""),
)
"""AVAILABLE_MODES, those this mock knows: main mode, sub mode, standard mode, name where it is not a standard one."""


class RawMessage(mavlink.MAVLink_message):  # type: ignore[misc]  # pymavlink has no types
    """A message that pymavlink does not have: its id, its checksum seed and its bytes."""

    def __init__(self, id_: int, crc_extra: int, payload: bytes) -> None:
        super().__init__(id_, f"RAW_{id_}")
        self._seed = crc_extra
        self._bytes = payload

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the frame, with trailing zeros cut off as MAVLink 2 prescribes."""
        return bytes(self._pack(mav, self._seed, self._bytes, force_mavlink1=force_mavlink1))


def protocol_version(_world: World) -> Message:
    """Return PROTOCOL_VERSION: 2.00, from 1.00 to 2.03."""
    payload = bytes.fromhex("c8006400cb000000000000000000096fec250d20af33")
    return RawMessage(300, 217, payload)


def component_information(world: World) -> Message:
    """Return COMPONENT_INFORMATION (deprecated) with the metadata's URI."""
    head = round(world.uptime_s * 1e3).to_bytes(4, "little") + METADATA_CRC.to_bytes(4, "little") + bytes(4)
    return RawMessage(395, 0, head + METADATA_URI)


def component_metadata(world: World) -> Message:
    """Return COMPONENT_METADATA, which has replaced COMPONENT_INFORMATION."""
    head = round(world.uptime_s * 1e3).to_bytes(4, "little") + METADATA_CRC.to_bytes(4, "little")
    return RawMessage(397, 182, head + METADATA_URI)


def available_modes(_world: World) -> list[Message]:
    """Return AVAILABLE_MODES, one message per mode."""
    out = []
    for index, (main, sub, standard, name) in enumerate(MODES, start=1):
        custom = main << 16 | sub << 24
        out.append(mavlink.MAVLink_available_modes_message(len(MODES), index, standard, custom, 0, name.encode()))
    return out


class GimbalChatter:
    """PX4's search for a gimbal when a landing begins: commands to its own system, repeated without an answer."""

    def __init__(self) -> None:
        self._landing = False
        self._queue: list[tuple[float, Message]] = []

    def due(self, now_s: float, landing: bool) -> list[Message]:
        """Return the messages to send now; `landing` while the autopilot brings the vehicle down by itself."""
        if landing and not self._landing:
            self._queue = _chatter(now_s)
        self._landing = landing
        out = [message for at_s, message in self._queue if at_s <= now_s]
        self._queue = [(at_s, message) for at_s, message in self._queue if at_s > now_s]
        return out


def _chatter(now_s: float) -> list[tuple[float, Message]]:
    def configure(confirmation: int, primary: float) -> Message:
        params = (primary, primary, -1.0, -1.0, 0.0, 0.0, 0.0)
        return mavlink.MAVLink_command_long_message(1, 0, GIMBAL_CONFIGURE, confirmation, *params)

    unset = [math.nan] * 4
    look = mavlink.MAVLink_command_long_message(1, 0, GIMBAL_PITCHYAW, 0, *unset, *(2.0, 0.0, 0.0))
    first = now_s + GIMBAL_FIRST_S
    again = [(now_s + after_s, configure(count, 1.0)) for count, after_s in enumerate(GIMBAL_RETRIES_S, start=1)]
    return [(first, configure(0, 1.0)), (first, look), (first, configure(0, -3.0)), *again]
