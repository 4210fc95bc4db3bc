"""The page's own process beside the service or the demo: settings on standard input, ends when that is closed."""

import asyncio
import logging
import os
import sys

import uvloop

from companion.adapters.system.realtime import beside_the_loop
from companion.core.errors import ConfigError
from companion.page.server import serve_page
from companion.page.settings import PageSettings


async def _serve(settings: PageSettings) -> None:
    """Serve until standard input ends."""
    stop = asyncio.Event()
    asyncio.get_running_loop().add_reader(0, lambda: None if os.read(0, 64) else stop.set())
    await serve_page(settings, lambda line: print(line, flush=True), stop)


def main() -> int:
    """Serve the page; print where it is, or why not, and return the exit code."""
    beside_the_loop()
    settings = PageSettings.model_validate_json(sys.stdin.buffer.readline())
    level = logging.ERROR if settings.quiet else logging.WARNING
    logging.basicConfig(level=level, format="%(levelname)s %(name)s: %(message)s")
    try:
        uvloop.run(_serve(settings))
    except ConfigError as error:
        print(f"error: {error}", flush=True)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
