"""Source of frames on a vehicle that they do not reach: it waits, and none comes."""

import asyncio

from companion.core.types import MocapFrame


class NoFrames:
    """MocapSource without frames."""

    def latest(self) -> MocapFrame | None:
        """Return None: there is never a frame."""
        return None

    async def wait_frame(self, timeout_s: float) -> bool:
        """Wait for the whole time, and return False."""
        await asyncio.sleep(timeout_s)
        return False

    def why_silent(self) -> str:
        """Return the reason."""
        return "frames do not reach the vehicle (law.onboard_mocap = false)"
