"""Tasks beside a block of code, or beside each other: none outlives the other."""

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from typing import Any


@asynccontextmanager
async def background(work: Coroutine[Any, Any, None], name: str) -> AsyncIterator[None]:
    """Run `work` in a task of this name beside the block; errors of the task are not raised here."""
    task = asyncio.create_task(work, name=name)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def first_of(*works: Coroutine[Any, Any, object] | asyncio.Future[Any]) -> None:
    """Run all, of which some may run already, until the first ends, and cancel the others; raise its error."""
    tasks = [
        work
        if isinstance(work, asyncio.Future)
        else asyncio.create_task(work, name=f"companion.{getattr(work, '__name__', 'work')}")
        for work in works
    ]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
