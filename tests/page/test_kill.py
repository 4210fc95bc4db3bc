"""Kill takes a slide and two seconds; nothing that happens by accident is one."""

from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page, expect

from tests.packages import needs
from tests.page.browser import opened
from tests.page.fake_server import FakeServer

pytestmark = needs("chromium")


@contextmanager
def flying(browser: Browser, one: FakeServer) -> Iterator[Page]:
    one.vehicle().phase = "hold"
    with opened(browser, one.url, "phone") as page:
        expect(page.locator("#phase")).to_have_text("hold")
        yield page


def thumb(page: Page) -> tuple[float, float, float]:
    """Return the place of the thumb, and the right end."""
    box = page.locator("#kill").bounding_box()
    assert box is not None
    half = box["height"] / 2.0
    return box["x"] + half, box["y"] + half, box["x"] + box["width"] - half


def test_a_slide_that_is_held_for_two_seconds_kills(browser: Browser, one: FakeServer) -> None:
    with flying(browser, one) as page:
        x, y, end = thumb(page)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(end, y, steps=5)
        page.wait_for_timeout(1500)
        assert one.commands == []
        expect(page.locator("#kill-text")).to_contain_text("hold 0.")
        expect(page.locator("output[data-answer=kill]")).to_contain_text("done: the motors stand")
        page.mouse.up()
        sent = [(command["verb"], command["confirm"], command["nonce"]) for command in one.commands]
        assert sent == [("kill", "kill", "n1")]
        expect(page.locator("#phase")).to_have_text("terminated")


def test_nothing_shorter_kills(browser: Browser, one: FakeServer) -> None:
    with flying(browser, one) as page:
        x, y, end = thumb(page)
        kill = page.locator("#kill")
        page.mouse.click(x, y)
        page.mouse.dblclick(x, y)
        page.mouse.click(end, y)
        kill.tap() if page.evaluate("navigator.maxTouchPoints") else kill.click()
        kill.focus()
        for key in ("Enter", "Space", "ArrowRight", "Shift+ArrowRight", "End"):
            page.keyboard.press(key)
        page.keyboard.down("Enter")
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(end, y, steps=3)  # to the end, and let go after 1.2 s
        page.wait_for_timeout(1200)
        page.mouse.up()
        page.mouse.down()  # at the end, where the thumb is not any more
        page.wait_for_timeout(600)
        page.mouse.up()
        page.mouse.move(x, y)
        page.mouse.down()  # held for long, but not slid to the end
        page.mouse.move((x + end) / 2.0, y, steps=3)
        page.wait_for_timeout(2300)
        page.mouse.up()
        page.keyboard.up("Enter")
        assert one.commands == []
        expect(kill).to_have_attribute("aria-valuenow", "0")


def test_the_keyboard_kills_with_two_keys_held(browser: Browser, one: FakeServer) -> None:
    with flying(browser, one) as page:
        page.locator("#kill").focus()
        page.keyboard.down("Shift")
        page.keyboard.down("ArrowRight")
        page.wait_for_timeout(1500)
        assert one.commands == []
        expect(page.locator("output[data-answer=kill]")).to_contain_text("done")
        page.keyboard.up("ArrowRight")
        page.keyboard.up("Shift")
        assert [command["verb"] for command in one.commands] == ["kill"]
