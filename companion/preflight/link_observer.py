"""Link to a law on the ground for a preflight without a service: it connects, and reports a vehicle that stands."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from companion.adapters.law_link.udp import VehicleLink, open_law_link
from companion.adapters.system.clock import MonotonicClock
from companion.config.companion_config import CompanionConfig
from companion.flight.estimate_step import LinkPoses
from companion.law_link.link_status import LinkStatus
from companion.law_link.vehicle_end import Shown

_REPORT_S = 0.04
_STANDING = Shown(
    airborne=False, cut=False, arming=False, phase=0, epoch=0, number=0, q_w_flu_wxyz=(1.0, 0.0, 0.0, 0.0), thrust=0.0
)


class ObservedLink:
    """Link that is looked at: its state, and the poses that come over it."""

    def __init__(self, link: VehicleLink, clock: MonotonicClock) -> None:
        self._link, self._clock = link, clock
        self.poses = LinkPoses(link.end)

    def status(self) -> LinkStatus:
        """Return the link's state now."""
        return self._link.end.status(self._clock.now_s())


@asynccontextmanager
async def open_link_observer(config: CompanionConfig) -> AsyncIterator[ObservedLink | None]:
    """Listen for a ground law, and yield the link; None for a law on board.

    A ground law that introduces itself gets a session, which ends when this does. Raises ConfigError for a key or port
    that cannot be used.
    """
    if not config.law.on_ground:
        yield None
        return
    clock = MonotonicClock()
    async with open_law_link(config, clock) as link:
        reporting = asyncio.create_task(_report(link, clock), name="companion.law_link")
        try:
            yield ObservedLink(link, clock)
        finally:
            reporting.cancel()
            await asyncio.gather(reporting, return_exceptions=True)


async def _report(link: VehicleLink, clock: MonotonicClock) -> None:
    """Answer the ground law, which measures the round trip by it."""
    while True:
        report = link.end.report(_STANDING, clock.now_s())
        if report is not None:
            link.send(report)
        await asyncio.sleep(_REPORT_S)
