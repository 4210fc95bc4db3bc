"""Kill takes a slide and two seconds; nothing that happens by accident is one. The page's clock is moved by hand."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.packages import needs
from tests.page.browser import TURN_MS, opened, turn_until
from tests.page.fake_server import FakeServer

pytestmark = [pytest.mark.realtime, needs("chromium")]


@contextmanager
def flying(browser: Browser, one: FakeServer) -> Iterator[Page]:
    one.vehicle().phase = "hold"
    with opened(browser, one.url, "phone", by_hand=True) as page:
        turn_until(page, lambda: page.locator("#phase").text_content() == "hold")
        yield page


def wait(page: Page, time_ms: int) -> None:
    """Let the page's time pass; what the server answers comes after 0.1 s of it."""
    page.clock.run_for(100)
    page.wait_for_timeout(TURN_MS)
    page.clock.run_for(time_ms - 100)


def thumb(page: Page) -> tuple[float, float, float]:
    """Return the place of the thumb, and the right end."""
    box = page.locator("#kill").bounding_box()
    assert box is not None
    half = box["height"] / 2.0
    return box["x"] + half, box["y"] + half, box["x"] + box["width"] - half


def slide(page: Page, share: float) -> None:
    """Take the thumb and slide it so far."""
    x, y, end = thumb(page)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + share * (end - x), y, steps=4)


def confirmed(page: Page, one: FakeServer) -> list[tuple[str, str]]:
    """Return the kills that were commanded, once the server has answered whatever it was asked."""
    page.wait_for_timeout(3.0 * TURN_MS)
    return [(command["verb"], command.get("nonce", "")) for command in one.commands]


def test_a_slide_that_is_held_for_two_seconds_kills(browser: Browser, one: FakeServer) -> None:
    with flying(browser, one) as page:
        slide(page, 1.0)
        assert confirmed(page, one) == []
        wait(page, 1700)
        assert confirmed(page, one) == []
        expect(page.locator("#kill-text")).to_have_text("hold 0.3 s")
        wait(page, 400)
        assert confirmed(page, one) == [("kill", "n1")]
        page.mouse.up()
        wait(page, 200)
        expect(page.locator("output[data-answer=kill]")).to_contain_text("done: the motors stand")
        expect(page.locator("#phase")).to_have_text("terminated")


def test_taps_and_keys_do_not_kill(browser: Browser, one: FakeServer) -> None:
    with flying(browser, one) as page:
        x, y, end = thumb(page)
        for at in (x, (x + end) / 2.0, end):
            page.mouse.click(at, y)
            page.mouse.dblclick(at, y)
            page.mouse.move(at, y)
            page.mouse.down()
            wait(page, 2300)
            page.mouse.up()
        page.locator("#kill").focus()
        for key in ("Enter", "Space", "ArrowRight", "Shift+ArrowRight", "End"):
            page.keyboard.press(key)
        for key in ("Enter", "Space", "ArrowRight"):
            page.keyboard.down(key)
            wait(page, 2300)
            page.keyboard.up(key)
        assert confirmed(page, one) == []


def test_a_slide_that_is_shorter_or_let_go_does_not_kill(browser: Browser, one: FakeServer) -> None:
    with flying(browser, one) as page:
        slide(page, 0.9)
        wait(page, 2300)
        page.mouse.up()
        slide(page, 1.0)
        wait(page, 1500)
        page.mouse.up()
        expect(page.locator("#kill")).to_have_attribute("aria-valuenow", "0")
        _, y, end = thumb(page)
        page.mouse.move(end, y)
        page.mouse.down()  # at the end, where the thumb is not any more
        wait(page, 2300)
        page.mouse.up()
        slide(page, 1.0)
        wait(page, 1500)
        slide_back(page)
        wait(page, 1500)
        page.mouse.up()
        assert confirmed(page, one) == []


def slide_back(page: Page) -> None:
    """Slide a little back and to the end again: the two seconds begin again."""
    _, y, end = thumb(page)
    page.mouse.move(end - 60.0, y)
    page.mouse.move(end, y)


def test_two_keys_that_are_held_kill_and_letting_one_go_does_not(browser: Browser, one: FakeServer) -> None:
    with flying(browser, one) as page:
        page.locator("#kill").focus()
        page.keyboard.down("Shift")
        page.keyboard.down("ArrowRight")
        wait(page, 2000)
        page.keyboard.up("ArrowRight")
        wait(page, 2000)
        assert confirmed(page, one) == []
        page.keyboard.down("ArrowRight")
        wait(page, 1000)  # at the end, and the server has answered
        assert confirmed(page, one) == []
        wait(page, 2000)
        assert confirmed(page, one) == [("kill", "n1")]


def test_a_page_that_may_not_command_does_not_even_ask(browser: Browser, one: FakeServer) -> None:
    one.can_command = False
    with flying(browser, one) as page:
        slide(page, 1.0)
        wait(page, 2300)
        page.mouse.up()
        assert confirmed(page, one) == []
        expect(page.locator("#kill")).to_have_attribute("aria-disabled", "true")
        assert not one.asked
