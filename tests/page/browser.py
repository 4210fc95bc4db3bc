"""Debian's Chromium, driven by Playwright: one browser for a file of tests, a fresh context for each test."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from tests.packages import find_program

SIZES = {"phone": (390, 844), "tablet": (1024, 768), "desktop": (1440, 900)}
"""Widths and heights of the screens that the page is tested on, CSS pixels."""
Scheme = Literal["light", "dark"]
WATCH = """
const parse = JSON.parse;
JSON.parse = (text) => {
  const message = parse(text);
  if (message.type !== undefined) window.heardMs = performance.now();
  if (message.event?.kind === "fault") window.faultMs = performance.now();
  return message;
};
const note = () => {
  if (window.shownMs === undefined && document.querySelector(".fault")) window.shownMs = performance.now();
};
addEventListener("DOMContentLoaded", () =>
  new MutationObserver(note).observe(document, {subtree: true, childList: true}));
"""
"""Script that notes in the page when messages came and what they led to was shown, ms."""

TURN_MS = 20.0
"""Real time in which an answer of the server arrives."""
_MOST_TURNS = 500
"""Turns for which something is waited for, on a busy computer."""


@contextmanager
def chromium() -> Iterator[Browser]:
    """Run a headless Chromium until the block ends."""
    path = find_program("chromium")
    assert path is not None
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def opened(
    browser: Browser, url: str, size: str = "desktop", scheme: Scheme = "light", by_hand: bool = False
) -> Iterator[Page]:
    """Open a page in a context of its own; whatever it reports as an error fails the test.

    `by_hand`: its clock, timers and drawing advance only by `page.clock.run_for`.
    """
    width, height = SIZES[size]
    touch = size != "desktop"
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme, has_touch=touch)
    context.set_default_timeout(10_000)
    page = context.new_page()
    troubles: list[str] = []
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("console", lambda said: troubles.append(said.text) if said.type == "error" else None)
    page.add_init_script(WATCH)
    if by_hand:
        page.clock.install(time=0)
        page.clock.pause_at(1000)
    page.goto(url)
    yield page
    context.close()
    real = [one for one in troubles if "WebSocket connection" not in one and "Failed to load resource" not in one]
    if real:
        pytest.fail(f"the page reports: {real}")


def turn_until(page: Page, there: Callable[[], bool]) -> None:
    """Let the time of a page opened `by_hand` pass, 0.1 s at a time, until this is so."""
    for _ in range(_MOST_TURNS):
        page.clock.run_for(100)
        page.wait_for_timeout(TURN_MS)
        if there():
            return
    pytest.fail("what was waited for did not come")
