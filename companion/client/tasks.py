"""Cancellation of asyncio tasks that also survives a lost cancellation."""

import asyncio
from typing import Any

_AGAIN_S = 0.1


async def end(task: "asyncio.Task[Any]") -> None:
    """Cancel a task repeatedly until it has ended.

    Python 3.11's wait_for, which aiomqtt uses, loses a cancellation that coincides with the awaited result.
    """
    while not task.done():
        task.cancel()
        await asyncio.wait({task}, timeout=_AGAIN_S)
