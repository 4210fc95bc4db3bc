"""Child process that ends when its standard input is closed."""

import asyncio


async def end(process: asyncio.subprocess.Process, within_s: float) -> None:
    """Close its standard input and wait; killed where it does not end within so long."""
    assert process.stdin is not None
    process.stdin.close()
    try:
        async with asyncio.timeout(within_s):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()
