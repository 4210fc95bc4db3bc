"""Sender lock: limits MAVSDK to the autopilot's datagrams on a port to which anybody may send."""

import logging
import math

from companion.adapters.px4.admission import Admission
from companion.adapters.px4.sender_filter import SenderFilter
from companion.config.px4_config import Px4Config
from companion.core.interfaces import Clock

LOG = logging.getLogger(__name__)

_LISTENS = ("udpin://", "udp://:", "udp://0.0.0.0:")


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

    def strangers(self) -> dict[int, list[str]]:
        """Return the other autopilots on the port by their number, each in a few words."""
        found: dict[int, list[str]] = {}
        for (host, port), (system, kind) in self._admission.strangers(self._clock.now_s()).items():
            found.setdefault(system, []).append(f"system {system} ({kind} at {host}:{port})")
        return found

    def close(self) -> None:
        """Close the filter and its socket."""
        if self._filter is not None:
            self._filter.close()
