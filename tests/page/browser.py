"""Debian's Chromium, driven by Playwright: one browser for a file of tests, a fresh context for each test."""

from collections.abc import Iterator
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
  if (document.body.classList.contains("stale")) window.staleMs ??= performance.now() - window.heardMs;
};
addEventListener("DOMContentLoaded", () => new MutationObserver(note).observe(document, {subtree: true, childList: true,
  attributes: true, attributeFilter: ["class"]}));
"""
"""Script that notes in the page when messages came and what they led to was shown, ms."""


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
