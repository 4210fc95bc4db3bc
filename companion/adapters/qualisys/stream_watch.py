"""Watch tasks of a stream: keep QTM's list of bodies current, and end a stream that has fallen silent."""

import asyncio
import logging

from qtm_rt.protocol import QRTCommandException

from companion.adapters.qualisys.bodies import RigidBody, rigid_bodies
from companion.adapters.qualisys.handshake import text
from companion.adapters.qualisys.link import Link
from companion.adapters.qualisys.packets import MalformedError
from companion.adapters.qualisys.source import QualisysSource

LOG = logging.getLogger(__name__)

EVERY_S = 1.0
"""Period at which the list is read in any case: QTM sends no event for a change that keeps the number of bodies."""
_FIRST_PAUSE_S = 0.02
"""Between two readings while the list does not fit the frames, doubled every time up to EVERY_S."""
SILENT_S = 3.0
_GLANCE_S = 0.1


async def keep_bodies_current(link: Link, source: QualisysSource, answer_s: float) -> None:
    """Read QTM's list of bodies whenever the source wants it, and every EVERY_S; until the link is closed.

    A QTM that does not answer within `answer_s` while frames wait to be believed ends the link.
    """
    pause_s, read = _FIRST_PAUSE_S, b""
    bodies: tuple[RigidBody, ...] = ()
    while not link.closed.done():
        wanted = await _wanted(source)
        doubts = source.doubts
        try:
            xml = await _answer(link, source, answer_s)
            if xml != read:  # or every second a list of many bodies would hold up the control loop
                bodies, read = rigid_bodies(xml), xml
        except (QRTCommandException, MalformedError) as error:
            LOG.debug("QTM's list of rigid bodies cannot be read: %s", text(error))
        except ConnectionError:
            return
        else:
            if source.doubts == doubts:  # otherwise it may have changed after QTM looked
                source.take_bodies(bodies)
        pause_s = min(2.0 * pause_s, EVERY_S) if wanted else _FIRST_PAUSE_S
        await asyncio.sleep(pause_s if wanted else 0.0)


async def _wanted(source: QualisysSource) -> bool:
    """Wait until the list is requested and return True; False when the period has elapsed."""
    try:
        async with asyncio.timeout(EVERY_S):
            await source.list_wanted.wait()
    except TimeoutError:
        return False
    return True


async def _answer(link: Link, source: QualisysSource, answer_s: float) -> bytes:
    asking = asyncio.ensure_future(link.settings("6d"))
    warned = False
    try:
        while not asking.done():
            await asyncio.wait([asking], timeout=answer_s)
            if not asking.done() and source.list_wanted.is_set():
                link.end("does not say any more which rigid bodies it has")
            elif not asking.done() and not warned:
                warned = True
                LOG.warning(
                    "QTM does not answer which rigid bodies it has: only a change of their number would be noticed"
                )
        return asking.result()
    finally:
        asking.cancel()


async def end_when_silent(link: Link, source: QualisysSource) -> None:
    """End the link when no frame has come for SILENT_S; until it is closed."""
    loop = asyncio.get_running_loop()
    packets, since_s = source.packets, loop.time()
    while not link.closed.done():
        await asyncio.wait([link.closed], timeout=_GLANCE_S)
        if source.packets != packets:
            packets, since_s = source.packets, loop.time()
        elif loop.time() - since_s >= SILENT_S:
            link.end(f"has sent no frames for {SILENT_S:g} s")
            return
