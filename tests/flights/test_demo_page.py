"""The demo with its page: the address at once, one login, and a command from the page that ends the script."""

import json
import re
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection, connect

from tests.flights.command import start

pytestmark = pytest.mark.realtime
PATIENCE_S = 30.0


def logged_in(host: str, token: str) -> str:
    """Return the cookie that the printed token gives."""
    headers = {"content-type": "application/json", "origin": f"http://{host}"}
    asked = urllib.request.Request(f"http://{host}/login", json.dumps({"token": token}).encode(), headers)
    with urllib.request.urlopen(asked, timeout=PATIENCE_S) as answer:
        return "; ".join(one.partition(";")[0] for one in answer.headers.get_all("set-cookie"))


async def first(page: ClientConnection, fits: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Return the first message that fits."""
    while True:
        message: dict[str, Any] = json.loads(await page.recv())
        if fits(message):
            return message


async def test_landing_from_the_page_ends_the_demo(tmp_path: Path) -> None:
    running = await start("demo", "--page", "--free-ports", "--out", tmp_path)
    line = await running.until_line("page: ")
    found = re.search(r"page: http://(127\.0\.0\.1:\d+)/#token=(\S+)", line)
    assert found is not None, line
    host, token = found[1], found[2]
    cookie = {"cookie": logged_in(host, token)}
    async with connect(f"ws://{host}/ws", origin=f"http://{host}", additional_headers=cookie) as page:  # type: ignore[arg-type]
        climbs = await first(page, lambda said: said["type"] == "state" and said["state"]["phase"] == "takeoff")
        land = {"type": "command", "ref": 1, "vehicle": climbs["vehicle"], "verb": "land"}
        await page.send(json.dumps(land))
        assert (await first(page, lambda said: said["type"] == "reply"))["answer"] == "accepted"
    ran = await running.ended()
    assert ran.code == 1, ran.said
    assert "the operator ordered it" in ran.out
    assert "ended by the operator before its task; landed, disarmed" in ran.out
    assert ran.err == ""
