"""A session by clicks against the real thing: mocks, service and `companion page` as processes of their own."""

import asyncio
import os
import re
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from companion.page.passwords import PasswordHash
from tests.flights.command import start
from tests.flights.served import NO_ARMS, Site, mocks, serving
from tests.packages import needs
from tests.page.browser import chromium, opened
from tests.ports import free_port

pytestmark = [pytest.mark.realtime, needs("chromium")]

PASSWORD = "beside the net"
_NICE = 10
STEP_MS = 40_000.0
"""Far beyond what a step takes here."""


async def test_a_flight_by_clicks_with_service_and_page(tmp_path: Path) -> None:
    site, port, secret = Site.embedded(tmp_path), free_port(), tmp_path / "page.hash"
    PasswordHash.of(PASSWORD).write(secret)
    async with mocks(site, NO_ARMS), serving(site.config(arms=False), tmp_path / "log") as served:
        await served.says("the vehicle is there")
        page = await start("page", "--port", str(port), "--page-password", secret, *site.options())
        await page.until_line("page: http")
        try:
            with ThreadPoolExecutor(1, initializer=_behind_the_flight) as beside:
                url = f"http://127.0.0.1:{port}/"
                await asyncio.get_running_loop().run_in_executor(beside, by_clicks, url)
        finally:
            page.send(signal.SIGTERM)
            ended = await page.ended()
        assert ended.code == 0, ended.said
        assert "Traceback" not in ended.said
    assert len(list(site.records.glob("*.mcap"))) == 1


def _behind_the_flight() -> None:
    """Give this thread, and the browser that it starts, what the flight leaves: a tablet has a processor of its own."""
    os.setpriority(os.PRIO_PROCESS, 0, _NICE)


def by_clicks(url: str) -> None:
    with chromium() as browser, opened(browser, url, "phone") as page:
        shows(page, "#phase", "standby")
        log_in(page)
        done(page, "preflight")
        expect(page.locator("#checks li").nth(10)).to_be_visible()
        expect(page.locator("#checks-sum")).to_have_text(re.compile(r"^\d+ of \d+ pass$"))
        done(page, "arm")
        shows(page, "#phase", "armed")
        page.locator("#takeoff-height").fill("0.6")
        done(page, "takeoff")
        shows(page, "#phase", "hold")
        go_by_a_tap(page)
        track_then_hold(page)
        done(page, "land")
        shows(page, "#phase", "disarmed")
        expect(page.locator("#links")).to_contain_text(".mcap")
        expect(page.locator("#log")).to_contain_text("land done")


def log_in(page: Page) -> None:
    shows(page, "#rights", "read-only: log in to command")
    page.locator("#login").click()
    page.locator("#password").fill(PASSWORD)
    page.keyboard.press("Enter")
    shows(page, "#rights", "may command")
    shows(page, "#phase", "standby")


def go_by_a_tap(page: Page) -> None:
    plan = page.locator("#plan")
    box = plan.bounding_box()
    assert box is not None
    plan.click(position={"x": box["width"] / 2.0 + 15.0, "y": box["height"] / 2.0 - 10.0})
    expect(page.locator("#goto-z")).to_have_value("0.6")
    page.locator("#goto-z").fill("0.8")
    done(page, "goto")
    expect(page.locator("#t-height")).to_have_text(re.compile(r"^0\.[78]\d m$"))


def track_then_hold(page: Page) -> None:
    for field, value in (("laps", "1"), ("period", "8"), ("size", "0.5")):
        page.locator(f"#track-{field}").fill(value)
    page.locator("[data-command=track]").click()
    shows(page, "#phase", "track")
    expect(page.locator("#t-still")).to_have_text(re.compile(r"^\d+ s$"))
    expect(page.locator("#t-updates")).to_have_text(re.compile(r"^\d+ %$"))
    done(page, "hold")
    expect(page.locator("output[data-answer=track]")).to_contain_text("failed")
    shows(page, "#phase", "hold")


def done(page: Page, verb: str) -> None:
    page.locator(f"[data-command={verb}]").first.click()
    expect(page.locator(f"output[data-answer={verb}]")).to_contain_text("done", timeout=STEP_MS)


def shows(page: Page, place: str, text: str) -> None:
    expect(page.locator(place)).to_have_text(text, timeout=STEP_MS)
