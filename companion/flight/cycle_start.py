"""Wait for the begin of the next control cycle, on the vehicle and on the ground."""

from companion.core.interfaces import Clock, MocapSource
from companion.flight.tick_timer import TickTimer


async def frame_or_deadline(mocap: MocapSource, clock: Clock, timer: TickTimer) -> float | None:
    """Wait for the frame that starts the next cycle or for the deadline; return the frame's arrival (s), or None.

    Raises MocapError when the connection to motion capture is lost.
    """
    while (left_s := timer.deadline_s - clock.now_s()) > 0.0:
        if await mocap.wait_frame(left_s):
            frame = mocap.latest()
            if frame is not None and not timer.frame_is_early(frame.received_s):
                return frame.received_s
    return None
