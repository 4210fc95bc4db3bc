"""Alarms: faults are noticed at once, a stale page within a second; and text of others stays text."""

import re
import time

import pytest
from playwright.sync_api import Browser, expect

from tests.packages import needs
from tests.page.browser import TURN_MS, opened, turn_until
from tests.page.fake_server import FakeServer

pytestmark = [pytest.mark.realtime, needs("chromium")]

FAULT_MS = 300.0
EVIL = '<img src=x onerror="window.evil=1"><script>window.evil=1</script>'


def test_a_fault_is_shown_with_reason_and_reaction_within_300_ms(browser: Browser, three: FakeServer) -> None:
    delays_ms = []
    for size in ("phone", "tablet", "desktop"):
        three.reset()
        with opened(browser, three.url, size) as page:
            expect(page.locator(".card .word")).to_have_text(["standby"] * 3)
            three.vehicle().phase = "hold"
            expect(page.locator("#phase")).to_have_text("hold")
            three.vehicle().fail("mocap slow", "only 41 usable frames in the last second", "land")
            fault = page.locator("#faults .fault")
            expect(fault).to_contain_text("mocap slow only 41 usable frames in the last second→ it lands where it is")
            expect(fault).to_have_attribute("data-tone", "alarm")
            expect(page.locator("#now")).to_have_attribute("data-tone", "alarm")
            expect(page.locator(".card").first).to_contain_text("mocap slow")
            delays_ms.append(page.evaluate("window.shownMs - window.faultMs"))
            assert fault.evaluate("node => node.getBoundingClientRect().top < innerHeight"), "without scrolling"
            three.vehicle().recover("mocap slow")
            expect(page.locator("#faults")).to_contain_text("Why: only 41")  # it still lands because of it
            three.fly(3.0)
            expect(page.locator("#faults")).to_contain_text("The flight ended: only 41")
            expect(page.locator("#now")).to_have_attribute("data-tone", "warn")
    assert max(delays_ms) < FAULT_MS, delays_ms
    assert min(delays_ms) >= 0.0


def test_a_vehicle_that_is_not_in_view_shows_what_it_reacts_to(browser: Browser, three: FakeServer) -> None:
    with opened(browser, three.url) as page:
        expect(page.locator(".card .word")).to_have_text(["standby"] * 3)
        three.vehicle(1).fail("broker gone", "no connection to the broker", "warn")
        three.vehicle(2).fail("traffic", "1.4 m from dauam-1 in 0.8 s", "hold")
        expect(page.locator("#faults .fault")).to_have_count(1)
        expect(page.locator("#faults .fault")).to_contain_text(
            "dauam-3: traffic 1.4 m from dauam-1 in 0.8 s→ it brakes"
        )
        expect(page.locator("#now")).to_have_attribute("data-tone", "idle")


def test_a_warning_is_a_warning_and_ends(browser: Browser, one: FakeServer) -> None:
    with opened(browser, one.url) as page:
        one.vehicle().fail("broker gone", "no connection to the broker for 2.1 s", "warn")
        expect(page.locator("#now")).to_have_attribute("data-tone", "warn")
        expect(page.locator("#faults .fault")).to_contain_text("only a warning: the flight goes on")
        one.vehicle().recover("broker gone")
        expect(page.locator("#now")).to_have_attribute("data-tone", "idle")
        expect(page.locator("#faults")).to_be_hidden()
        one.vehicle().warnings = ("this flight is not recorded",)
        expect(page.locator("#faults")).to_contain_text("this flight is not recorded")


def test_a_page_opened_later_shows_the_fault_with_its_reason(browser: Browser, one: FakeServer) -> None:
    one.vehicle().fail("battery low", "24 % is below 25 %", "land")
    one.fly(0.1)
    with opened(browser, one.url) as page:
        expect(page.locator("#faults .fault")).to_contain_text("battery low 24 % is below 25 %→ it lands where it is")
        expect(page.locator("#log")).to_contain_text("battery low")


def test_a_silent_server_makes_the_page_stale_within_a_second(browser: Browser, one: FakeServer) -> None:
    with opened(browser, one.url, by_hand=True) as page:
        turn_until(page, lambda: page.locator("#phase").text_content() == "standby")
        one.silent = True
        page.wait_for_timeout(10.0 * TURN_MS)  # what was on its way has come, at most 0.1 s of the page's time ago
        page.clock.run_for(600)
        expect(page.locator("#stale")).to_be_hidden()
        page.clock.run_for(300)
        expect(page.locator("#stale-why")).to_contain_text("Stale: the page's server says nothing since ")
        assert page.evaluate("getComputedStyle(document.querySelector('main')).filter") == "grayscale(1)"
        one.silent = False
        turn_until(page, page.locator("#stale").is_hidden)


def test_a_vehicle_without_states_is_stale_while_the_server_beats(browser: Browser, three: FakeServer) -> None:
    with opened(browser, three.url) as page:
        expect(page.locator(".card .word")).to_have_text(["standby"] * 3)
        three.publishing = False
        began_s = time.monotonic()
        expect(page.locator("#stale-why")).to_contain_text("Stale: dauam-1 says nothing since ")
        assert time.monotonic() - began_s < 2.0
        expect(page.locator(".card").nth(1)).to_contain_text("no state for")
        expect(page.locator("#links")).to_contain_text("says nothing")
        capture = page.locator("#links li", has_text="motion capture")
        expect(capture).to_have_attribute("data-tone", "none")
        expect(capture).to_contain_text(re.compile(r"old, [\d.]+ s ago$"))
        three.send({"type": "broker", "linked": False, "why": "connection refused"})
        expect(page.locator("#stale-why")).to_contain_text("no connection to the broker")


def test_a_lost_connection_comes_back_and_open_commands_are_said_to_be_unknown(
    browser: Browser, one: FakeServer
) -> None:
    with opened(browser, one.url) as page:
        page.locator("[data-command=preflight]").click()
        expect(page.locator("output[data-answer=preflight]")).to_contain_text("accepted")
        one.refusing = True
        one.drop()
        expect(page.locator("#link")).to_have_text("no connection")
        expect(page.locator("output[data-answer=preflight]")).to_contain_text("unknown: the connection broke")
        page.locator("[data-command=hold]").click()
        expect(page.locator("output[data-answer=hold]")).to_contain_text("not sent: no connection")
        one.refusing = False
        expect(page.locator("#link")).to_have_text("live")
        expect(page.locator("#stale")).to_be_hidden()
        page.locator("[data-command=abort]").click()
        expect(page.locator("output[data-answer=abort]")).to_contain_text("done")
        assert [command["verb"] for command in one.commands] == ["preflight", "abort"], (
            "nothing is sent twice, or later"
        )


def test_what_others_write_is_never_markup(browser: Browser, one: FakeServer) -> None:
    vehicle = one.vehicle()
    with opened(browser, one.url) as page:
        expect(page.locator("#phase")).to_have_text("standby")
        vehicle.fail(EVIL, EVIL, EVIL)
        vehicle.phase, vehicle.reason, vehicle.controller, vehicle.warnings = EVIL, EVIL, EVIL, (EVIL,)
        vehicle.say("log", EVIL, name=EVIL)
        vehicle.others = [{"body": EVIL, "position_w_m": [1.0, 1.0, 1.0], "age_s": 0.0, "distance_m": 1.0}]
        one.send({"type": "error", "ref": None, "text": EVIL})
        one.send({"type": "about", "vehicle": "vehicle", "about": {**vehicle.about(), "controllers": [EVIL]}})
        one.send({"type": "broker", "linked": False, "why": EVIL})
        for place in ("#phase", "#faults", "#log", "#links", "#last", "#controller-name"):
            expect(page.locator(place)).to_contain_text(EVIL)
        assert page.evaluate("window.evil") is None
        assert page.evaluate("document.querySelectorAll('img, main script').length") == 0


def test_it_works_without_any_other_network(browser: Browser, one: FakeServer) -> None:
    with opened(browser, one.url) as page:
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.route("**/*", lambda route: route.continue_() if route.request.url.startswith(one.url) else route.abort())
        page.reload()
        expect(page.locator("#phase")).to_have_text("standby")
        assert asked
        assert all(url.startswith((one.url, one.url.replace("http", "ws"))) for url in asked), asked
