"""A script as its author writes it, for tests that press Ctrl-C: `python -m tests.client.interrupted FORM NAME BROKER`.

FORM is asyncio or sync: it flies until it is interrupted; or raises: its own error comes while it is in the air.
"""

import asyncio
import sys

from companion.client import connect, sync

NAME, BROKER = sys.argv[2:4]


async def fly() -> None:
    async with connect(NAME, broker=BROKER) as vehicle:
        await vehicle.arm()
        await vehicle.goto((0.0, 0.0, 1.0))


def fly_without_asyncio(raises: bool) -> None:
    with sync.connect(NAME, broker=BROKER) as vehicle:
        vehicle.arm()
        if raises:
            raise ValueError("the script's own")
        vehicle.goto((0.0, 0.0, 1.0))


if sys.argv[1] == "asyncio":
    asyncio.run(fly())
else:
    fly_without_asyncio(sys.argv[1] == "raises")
