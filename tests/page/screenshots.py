"""Pictures of the page for the documents: `python -m tests.page.screenshots` writes docs/images/page-*.png.

They show the page as it is, with the vehicles of the fake server; a folder may be given instead of docs/images.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from time import sleep

from PIL import Image
from playwright.sync_api import Browser, Page

from tests.page.browser import Scheme, chromium, opened
from tests.page.fake_server import FakeServer, fake_server

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "images"
MOST_BYTES = 150_000
_COLOURS = 256
_SETTLES_S = 0.5
"""Time for the page to show what it was sent."""


def main() -> None:
    """Write all pictures."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    with chromium() as browser, fake_server("vehicle") as one, fake_server("dauam-1", "dauam-2", "dauam-3") as three:
        shoot(browser, one, folder / "page-desktop.png", "desktop", track)
        shoot(browser, one, folder / "page-phone.png", "phone", track)
        shoot(browser, three, folder / "page-fault.png", "tablet", fault_of_three, "dark")
        shoot(browser, one, folder / "page-stale.png", "tablet", stale)
        shoot(browser, one, folder / "page-goto.png", "tablet", choose)


def shoot(
    browser: Browser,
    fake: FakeServer,
    path: Path,
    size: str,
    scene: Callable[[Page, FakeServer], None],
    scheme: Scheme = "light",
) -> None:
    """Play a scene and write its picture, with few colours."""
    fake.reset()
    with opened(browser, fake.url, size, scheme) as page:
        sleep(_SETTLES_S)
        scene(page, fake)
        sleep(_SETTLES_S)
        page.screenshot(path=path)
    with Image.open(path) as image:
        image.convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    assert path.stat().st_size < MOST_BYTES, f"{path.name} has {path.stat().st_size} bytes"


def command(page: Page, fake: FakeServer, verb: str, seconds: float) -> None:
    """Press a button and let the vehicles move."""
    page.locator(f"[data-command={verb}]").first.click()
    sleep(0.2)
    fake.fly(seconds)


def track(page: Page, fake: FakeServer) -> None:
    """Show a flight on an ellipse."""
    for verb, seconds in (("preflight", 1.0), ("arm", 2.0), ("takeoff", 8.0)):
        command(page, fake, verb, seconds)
    page.locator("#track-laps").fill("4")
    command(page, fake, "track", 32.0)
    page.evaluate("scrollTo(0, 0)")


def fault_of_three(page: Page, fake: FakeServer) -> None:
    """Show three vehicles, the first of which lands because of a fault."""
    page.locator("#whom-all").click()
    for verb, seconds in (("arm", 1.0), ("takeoff", 2.0)):
        command(page, fake, verb, seconds)
    for index, place in ((1, (2.5, 2.0, 1.8)), (2, (-2.0, 2.4, 1.2))):
        fake.vehicle(index).obey({"ref": 0, "verb": "goto", **dict(zip(("x_m", "y_m", "z_m"), place, strict=True))})
    command(page, fake, "track", 20.0)
    fake.vehicle().fail("mocap slow", "only 41 usable frames in the last second, at least 50 are needed", "land")
    fake.fly(0.6)
    page.evaluate("scrollTo(0, 0)")


def choose(page: Page, fake: FakeServer) -> None:
    """Show a place that was chosen in the plan."""
    for verb, seconds in (("arm", 1.0), ("takeoff", 4.0)):
        command(page, fake, verb, seconds)
    page.locator("#plan").click(position={"x": 300, "y": 120})
    page.locator("#goto-z").fill("1.6")
    page.locator(".view").scroll_into_view_if_needed()
    page.evaluate("document.querySelector('.view').scrollIntoView()")
    sleep(8.5)  # until the newest command is not shown large any more


def stale(page: Page, fake: FakeServer) -> None:
    """Show a page that hears nothing any more."""
    for verb, seconds in (("arm", 1.0), ("takeoff", 4.0)):
        command(page, fake, verb, seconds)
    page.evaluate("scrollTo(0, 0)")
    fake.silent = True
    sleep(3.0)


if __name__ == "__main__":
    main()
