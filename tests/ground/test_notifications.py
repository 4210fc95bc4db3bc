"""Signs of life of the law on the ground to systemd, while there is neither motion capture nor vehicle."""

import asyncio
import secrets
import socket
from pathlib import Path

from companion.adapters.system.systemd import Notifier
from companion.flight.assembly import controller_of
from companion.ground.ground_service import serve_law
from tests.law_link.local import split_config


async def test_it_shows_that_it_lives_while_it_waits_for_motion_capture_and_vehicle(tmp_path: Path) -> None:
    config = split_config(tmp_path)
    name = f"dauam-test-{secrets.token_hex(8)}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(f"\0{name}")
        systemd.setblocking(False)
        stop = asyncio.Event()
        notifier = Notifier(f"@{name}", 0.04)
        running = asyncio.create_task(serve_law(config, controller_of(config, "pid"), stop, notifier))
        said: list[str] = []
        async with asyncio.timeout(10.0):
            while said.count("WATCHDOG=1") < 3:
                said.append((await asyncio.get_running_loop().sock_recv(systemd, 1024)).decode())
        assert "STATUS=pid: no vehicle answers" in said
        stop.set()
        await running
