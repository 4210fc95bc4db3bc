"""Tasks that are to end."""

import asyncio
from typing import Any

_AGAIN_S = 0.1


async def end(task: "asyncio.Task[Any]") -> None:
    """Cancel it until it has ended: Python 3.11's wait_for, which aiomqtt waits with, loses a cancellation that comes
    together with what it waits for.
    """
    while not task.done():
        task.cancel()
        await asyncio.wait({task}, timeout=_AGAIN_S)
