"""The page is accessible, small, and says why it does not command without a login."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe  # type: ignore[import-untyped]
from playwright.sync_api import Browser, Page, expect

from tests.packages import needs
from tests.page.browser import SIZES, Scheme, opened
from tests.page.fake_server import PASSWORD, STATIC, FakeServer

pytestmark = [pytest.mark.realtime, needs("chromium")]

MOST_BYTES = 150_000
SCHEMES: tuple[Scheme, ...] = ("light", "dark")


def violations(page: Page) -> list[str]:
    found = Axe().run(page)
    return [f"{one['id']}: {[node['target'] for node in one['nodes']]}" for one in found.response["violations"]]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_axe_finds_nothing_on_any_screen(browser: Browser, three: FakeServer, scheme: Scheme) -> None:
    three.vehicle().fail("mocap slow", "only 41 usable frames in the last second", "land")
    three.vehicle(1).fail("broker gone", "no connection to the broker", "warn")
    three.vehicle(2).phase = "hold"
    with opened(browser, three.url, "desktop", scheme) as page:
        page.locator("#whom-all").click()
        page.locator("[data-command=preflight]").click()
        expect(page.locator("output[data-answer=preflight]")).to_contain_text("accepted")
        three.fly(1.0)
        expect(page.locator("#checks li")).to_have_count(10)
        for size, (width, height) in SIZES.items():
            page.set_viewport_size({"width": width, "height": height})
            assert violations(page) == [], size


def test_axe_finds_nothing_in_a_flight_or_in_the_login(browser: Browser, one: FakeServer) -> None:
    one.password = True
    one.vehicle().phase = "track"
    for scheme in SCHEMES:
        with opened(browser, one.url, "desktop", scheme) as page:
            expect(page.locator("#phase")).to_have_text("track")
            page.locator("#plan").click()
            assert violations(page) == [], scheme
            page.locator("#login").click()
            assert violations(page) == [], (scheme, "login")


def test_without_a_login_no_button_commands_and_each_says_why(browser: Browser, one: FakeServer) -> None:
    one.password = True
    with opened(browser, one.url) as page:
        expect(page.locator("#rights")).to_have_text("read-only: log in to command")
        page.locator("[data-command=abort]").click(force=True)  # it says that it is disabled, and answers
        expect(page.locator("#login-box")).to_be_visible()
        page.locator("#password").fill("wrong")
        page.keyboard.press("Enter")
        expect(page.locator("#login-says")).to_have_text("wrong password")
        page.locator("#password").fill(PASSWORD)
        page.keyboard.press("Enter")
        expect(page.locator("#login-box")).to_be_hidden()
        expect(page.locator("#rights")).to_have_text("may command")
        assert one.commands == []
        page.locator("[data-command=preflight]").click()
        expect(page.locator("output[data-answer=preflight]")).to_contain_text("accepted")
        page.locator("#logout").click()
        expect(page.locator("#rights")).to_have_text("read-only: log in to command")


def test_a_server_without_a_password_says_that_it_only_shows(browser: Browser, one: FakeServer) -> None:
    one.can_command = False
    with opened(browser, one.url) as page:
        expect(page.locator("#rights")).to_have_text("read-only: the server has no password file")
        page.locator("[data-command=hold]").click(force=True)
        expect(page.locator("#login-box")).to_be_hidden()
        assert one.commands == []


def test_the_room_turns_by_mouse_wheel_and_keys(browser: Browser, one: FakeServer) -> None:
    with opened(browser, one.url) as page:
        expect(page.locator("#phase")).to_have_text("standby")
        scene = page.locator("#scene")
        seen = {picture(page)}
        box = scene.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 200, box["y"] + 200)
        page.mouse.down()
        page.mouse.move(box["x"] + 260, box["y"] + 180)
        page.mouse.up()
        seen.add(picture(page))
        page.mouse.wheel(0, -300)
        seen.add(picture(page))
        scene.focus()
        for key in ("ArrowLeft", "ArrowUp", "-"):
            page.keyboard.press(key)
            seen.add(picture(page))
        page.locator("#follow").click()
        seen.add(picture(page))
        assert len(seen) == 7


def test_two_fingers_zoom_the_room_and_leave_the_bottom_row_in_reach(browser: Browser, one: FakeServer) -> None:
    with opened(browser, one.url, "phone") as page:
        expect(page.locator("#phase")).to_have_text("standby")
        scene = page.locator("#scene")
        start = picture(page)
        scene.press("+")
        nearer = picture(page)
        scene.press("0")
        assert picture(page) == start != nearer
        with fingers(page, corner_of(page, "#scene")) as put:
            put((100, 150), (200, 150))
            put((100, 150), (220, 150))  # 1.2 times as far apart, as the key does
            assert picture(page) == nearer
            put((100, 150), (200, 150))
            assert picture(page) == start
            put((100, 150))
            put((140, 150))
        turned = picture(page)
        assert turned not in {start, nearer}, "the finger that is left turns it"
        with fingers(page, corner_of(page, "#plan")) as put:
            for apart in range(100, 260, 20):
                put((150 - apart / 2, 150), (150 + apart / 2, 150))
        assert page.locator("#goto-x").input_value() == "", "no place was chosen"
        assert still(page) > 2.0
        assert one.commands == []
        assert in_sight(page, "[data-command=abort]")


def still(page: Page) -> float:
    """Wait until the page's zoom and the bottom row no longer move; return the zoom."""
    before, now = None, [0.0, 1.0]
    for _ in range(200):
        if now == before and abs(now[1]) < 1.0:
            break
        page.wait_for_timeout(100)
        before, now = (
            now,
            page.evaluate(
                """() => { const {offsetTop, height, scale} = visualViewport;
              return [scale, document.querySelector("#bar").getBoundingClientRect().bottom - offsetTop - height]; }"""
            ),
        )
    return float(now[0])


def in_sight(page: Page, selector: str) -> bool:
    """Return whether all of an element is in that part of the page that is seen."""
    seen: bool = page.evaluate(
        """(selector) => { const {offsetLeft, offsetTop, width, height} = visualViewport;
          const {left, top, right, bottom} = document.querySelector(selector).getBoundingClientRect();
          return left >= offsetLeft && right <= offsetLeft + width && top >= offsetTop &&
            bottom <= offsetTop + height; }""",
        selector,
    )
    return seen


@contextmanager
def fingers(page: Page, corner: tuple[float, float]) -> Iterator[Callable[..., None]]:
    """Yield a function that puts fingers on places, px from a corner on the screen, and lifts those not given."""
    devtools = page.context.new_cdp_session(page)
    down: list[dict[str, float]] = []

    def put(*places: tuple[float, float]) -> None:
        points = [{"x": corner[0] + x, "y": corner[1] + y, "id": number} for number, (x, y) in enumerate(places)]
        kind, told = "touchStart" if len(points) > len(down) else "touchMove", points
        if len(points) < len(down):
            kind, told = "touchEnd", down[len(points) :]
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": told})
        down[:] = points

    yield put
    put()
    devtools.detach()


def corner_of(page: Page, selector: str) -> tuple[float, float]:
    """Scroll to an element and return the place of its upper left corner."""
    page.locator(selector).scroll_into_view_if_needed()
    box = page.locator(selector).bounding_box()
    assert box is not None
    return box["x"], box["y"]


def picture(page: Page) -> str:
    page.wait_for_timeout(120)  # a tick of the page and the frame after it
    return str(page.evaluate("document.getElementById('scene').toDataURL()"))


def test_the_colours_follow_the_switch(browser: Browser, one: FakeServer) -> None:
    def ground() -> str:
        return str(page.evaluate("getComputedStyle(document.body).backgroundColor"))

    with opened(browser, one.url, scheme="dark") as page:
        grounds = [ground()]
        for choice in ("Light", "Dark", "Auto"):
            page.locator("#theme").click()
            expect(page.locator("#theme")).to_have_text(choice)
            grounds.append(ground())
        assert grounds[0] == grounds[2] == grounds[3] != grounds[1]


def palettes() -> dict[str, dict[str, str]]:
    """Return the colours of the style sheet by the head of their block."""
    css = (STATIC / "style.css").read_text(encoding="utf-8")
    blocks = re.findall(r"(:root[^{]*)\{([^}]*--page:[^}]*)\}", css)
    return {head.strip(): dict(re.findall(r"--([\w-]+): (#\w+);", body)) for head, body in blocks}


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours as WCAG 2 defines it, 1 to 21."""
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def luminance(colour: str) -> float:
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    shares = [int(digits[i : i + 2], 16) / 255.0 for i in (0, 2, 4)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shares)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_every_text_has_enough_contrast_in_both_schemes() -> None:
    light, dark, automatic = palettes().values()
    assert dark == automatic, "dark by choice and dark by the device are the same"
    for colours in (light, dark):
        tones = [name.removesuffix("-ink") for name in colours if name.endswith("-ink")]
        pairs = [(f"{tone}-ink", tone) for tone in tones]
        on_panel = ["ink", "soft", *(name for name in colours if name.endswith("-text") or name[:8] == "vehicle-")]
        pairs += [(name, "panel") for name in on_panel] + [("ink", "button"), ("ink", "field"), ("ink", "page")]
        low = {pair: contrast(colours[pair[0]], colours[pair[1]]) for pair in pairs}
        assert {pair: value for pair, value in low.items() if value < 4.5} == {}


def test_the_page_is_small_and_has_nothing_inline() -> None:
    files = [path for path in STATIC.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= MOST_BYTES
    html = (STATIC / "index.html").read_text(encoding="utf-8")
    assert "style=" not in html
    assert "<script>" not in html
    for script in STATIC.rglob("*.js"):
        check_script(script)


def check_script(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "http://", "https://"):
        assert word not in text.replace("http://www.w3.org/2000/svg", ""), f"{path.name}: {word}"
    assert " == " not in text, path.name
    assert " != " not in text, path.name
