"""Sender lock: limits MAVSDK to the datagrams of one autopilot, on a port to which anybody may send.

The first autopilot heard is accepted, for as long as it is heard.
"""

import logging
import math
import struct
from dataclasses import dataclass

from companion.adapters.px4.sender_filter import Endpoint, SenderFilter
from companion.config.px4_config import Px4Config
from companion.core.interfaces import Clock

LOG = logging.getLogger(__name__)

_LISTENS = ("udpin://", "udp://:", "udp://0.0.0.0:")


_V1, _V2 = 0xFE, 0xFD
"""First byte of a MAVLink frame."""
_V1_HEADER, _V2_HEADER = 6, 10
_AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
_HEARTBEAT = 0
_NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID: a ground station, a gimbal, a camera."""
_NAMES = {0: "a generic autopilot", 3: "ArduPilot", 12: "PX4"}
_SILENT_S = 3.0
"""MAVSDK's limit; after it the autopilot may come from another address (a restarted router)."""
_FORGOTTEN_S = 5.0
"""Silence after which another autopilot is forgotten."""


@dataclass(frozen=True)
class Sender:
    """Sender fields of one MAVLink frame's header."""

    system: int
    component: int
    autopilot: int | None
    """HEARTBEAT's MAV_AUTOPILOT; None in other messages."""


def sender_of(datagram: bytes) -> Sender | None:
    """Return the sender of a datagram's first frame; None when it is not MAVLink."""
    header = {_V1: _V1_HEADER, _V2: _V2_HEADER}.get(datagram[0] if datagram else 0)
    if header is None or len(datagram) <= header:
        return None
    if datagram[0] == _V2:
        system, component, message = datagram[5], datagram[6], int.from_bytes(datagram[7:10], "little")
    else:
        system, component, message = struct.unpack_from("BBB", datagram, 3)
    kind = datagram[header + 5] if message == _HEARTBEAT and len(datagram) > header + 5 else None
    return Sender(system, component, kind)


class Admission:
    """Chooses the sender that is listened to, and remembers the other autopilots."""

    def __init__(self, system_id: int | None) -> None:
        """`system_id` is the autopilot's that is flown; None: any."""
        self._system_id = system_id
        self.accepted: Endpoint | None = None
        self.accepted_s = -math.inf
        self._others: dict[Endpoint, tuple[float, int, str]] = {}

    def hear(self, endpoint: Endpoint, datagram: bytes, now_s: float, heard_s: float) -> bool:
        """Process a datagram of another sender; True when this sender is to be accepted from now on.

        `heard_s` is when the accepted one was heard last, -inf before.
        """
        sender = sender_of(datagram) if endpoint != self.accepted else None  # a broadcast comes here, too
        if sender is None or sender.component != _AUTOPILOT or sender.autopilot == _NO_AUTOPILOT:
            return False
        silent = now_s - max(heard_s, self.accepted_s) > _SILENT_S
        if self._system_id in {None, sender.system} and (self.accepted is None or silent):
            self.accepted, self.accepted_s = endpoint, now_s
            self._others.pop(endpoint, None)
            return True
        _, _, kind = self._others.get(endpoint, (now_s, sender.system, "autopilot"))
        if sender.autopilot is not None:
            kind = _NAMES.get(sender.autopilot, "autopilot")
        self._others[endpoint] = (now_s, sender.system, kind)
        return False

    def other_autopilots(self, now_s: float) -> dict[Endpoint, tuple[int, str]]:
        """Return the other autopilots heard lately: number and kind."""
        return {
            endpoint: (system, kind)
            for endpoint, (at_s, system, kind) in self._others.items()
            if now_s - at_s < _FORGOTTEN_S
        }


class SenderLock:
    """Sender choice on an open UDP port; links with one peer (serial, TCP, udpout) need none."""

    def __init__(self, config: Px4Config, clock: Clock) -> None:
        """Attach the filter to the port that MAVSDK has opened."""
        self._clock, self._admission = clock, Admission(config.system_id)
        self.heard_s = -math.inf
        """When the autopilot was heard last, on our clock."""
        self.warning = ""
        """Reason why frames of every sender are accepted; empty while the filter works."""
        self._filter: SenderFilter | None = None
        if config.url.startswith(_LISTENS):
            host, _, port = config.url.partition("://")[2].rpartition(":")
            try:
                self._filter = SenderFilter(host or "0.0.0.0", int(port))  # noqa: S104 - where MAVSDK listens
            except OSError as error:
                self.warning = (
                    f"frames of every sender on {config.url} are taken: the kernel does not filter them: {error}"
                )

    def look(self) -> None:
        """Process other senders' datagrams, and accept the autopilot's present sender."""
        if self._filter is None:
            return
        now_s, before = self._clock.now_s(), self._admission.accepted
        for sender, datagram in self._filter.others():
            if self._admission.hear(sender, datagram, now_s, self.heard_s):
                self._filter.accept(sender)
                if before is not None:
                    LOG.warning("the autopilot is heard from %s:%d now, and no more from %s:%d", *sender, *before)

    def other_autopilots(self) -> dict[int, list[str]]:
        """Return the other autopilots on the port by their number, each in a few words."""
        found: dict[int, list[str]] = {}
        for (host, port), (system, kind) in self._admission.other_autopilots(self._clock.now_s()).items():
            found.setdefault(system, []).append(f"system {system} ({kind} at {host}:{port})")
        return found

    def close(self) -> None:
        """Close the filter and its socket."""
        if self._filter is not None:
            self._filter.close()
