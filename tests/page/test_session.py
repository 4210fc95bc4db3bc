"""A session by clicks, from preflight to landing, against a fake server: on three screens, and with three vehicles."""

import re

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.packages import needs
from tests.page.browser import SIZES, TURN_MS, opened
from tests.page.fake_server import FakeServer

pytestmark = [pytest.mark.realtime, needs("chromium")]


NOTHING_YET = re.compile(r"^no (vehicle|state) yet$")
"""Phase before a vehicle is known, and before its first state."""


def press(page: Page, verb: str) -> None:
    expect(page.locator("#phase")).not_to_have_text(NOTHING_YET)
    page.locator(f"[data-command={verb}]").first.click()


def answers(page: Page, verb: str, text: str) -> None:
    expect(page.locator(f"output[data-answer={verb}]")).to_contain_text(text)


def in_the_air(page: Page, fake: FakeServer) -> None:
    for verb in ("arm", "takeoff"):
        press(page, verb)
        answers(page, verb, "accepted")
        fake.fly(2.0)
        answers(page, verb, "done")
    expect(page.locator("#phase")).to_have_text("hold")


@pytest.mark.parametrize("size", SIZES)
def test_a_whole_session_by_clicks(browser: Browser, one: FakeServer, size: str) -> None:
    with opened(browser, one.url, size) as page:
        expect(page.locator("#phase")).to_have_text("standby")
        press(page, "preflight")
        answers(page, "preflight", "accepted")
        one.fly(1.0)
        answers(page, "preflight", "done: it may arm, 1 warning")
        expect(page.locator("#checks-sum")).to_have_text("9 of 10 pass")
        expect(page.locator("#checks li")).to_have_count(10)
        expect(page.locator("#checks li").first).to_contain_text("→ set LimitRTPRIO=20")

        press(page, "takeoff")
        answers(page, "takeoff", "refused: the vehicle is disarmed")
        in_the_air(page, one)
        expect(page.locator("#t-height")).to_have_text("1.20 m")

        go_by_a_tap(page, one)
        page.locator("#track-laps").fill("1")
        page.locator("#track-size").fill("0.8")
        page.locator("#track-arms").select_option("swing")
        press(page, "track")
        answers(page, "track", "accepted: to the start of ellipse, then 12 s")
        assert one.commands[-1].items() >= {"curve": "ellipse", "laps": 1, "size": 0.8, "arms": "swing"}.items()
        expect(page.locator("#phase")).to_have_text("track")
        one.fly(4.0)
        expect(page.locator("#t-still")).to_have_text(re.compile(r"^[78] s$"))

        page.locator("#controller-name").select_option("pid")
        press(page, "controller")
        answers(page, "controller", "done: pid flies")
        abort = page.locator("[data-command=abort]")
        before = abort.bounding_box()
        press(page, "hold")
        answers(page, "hold", "done")
        assert abort.bounding_box() == before, "an answer moves no button away from a finger"
        press(page, "land")
        answers(page, "land", "accepted")
        expect(page.locator("#now")).to_have_attribute("data-tone", "land")
        one.fly(2.0)
        answers(page, "land", "done")
        expect(page.locator("#phase")).to_have_text("disarmed")
        expect(page.locator("#log")).to_contain_text("land done")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "nothing is wider than the screen"


def go_by_a_tap(page: Page, fake: FakeServer) -> None:
    """Choose a place in the plan, look at it, give a height, and go there."""
    plan = page.locator("#plan")
    plan.scroll_into_view_if_needed()
    box = plan.bounding_box()
    assert box is not None
    right_m = 0.1 * box["width"] / 2.0
    plan.click(position={"x": box["width"] / 2.0 + right_m, "y": box["height"] / 2.0})
    expect(page.locator("#goto-y")).to_have_value(re.compile(r"^-?0(\.0\d)?$"))
    expect(page.locator("#goto-z")).to_have_value("1.2")
    x_m = float(page.locator("#goto-x").input_value())
    assert x_m > 0.1
    assert fake.commands[-1]["verb"] != "goto", "a tap alone commands nothing"
    page.locator("#goto-z").fill("1.6")
    press(page, "goto")
    answers(page, "goto", "accepted")
    assert fake.commands[-1].items() >= {"verb": "goto", "x_m": x_m, "z_m": 1.6}.items()
    fake.fly(2.0)
    answers(page, "goto", "done")
    expect(page.locator("#t-height")).to_have_text("1.60 m")


def test_the_arms_are_commanded_where_there_are_some(browser: Browser, one: FakeServer) -> None:
    with opened(browser, one.url) as page:
        in_the_air(page, one)
        before = len(one.commands)
        for number, do in enumerate(("ready", "stow", "hold", "limp", "clear", "play"), 1):
            page.locator(f"[data-command=arms][data-do={do}]").click()
            while len(one.commands) < before + number:
                page.wait_for_timeout(TURN_MS)
            expect(page.locator("#last")).to_contain_text("arms done")
        sent = [(command["do"], command.get("motion")) for command in one.commands if command["verb"] == "arms"]
        bare = [(do, None) for do in ("ready", "stow", "hold", "limp", "clear")]
        assert sent == [*bare, ("play", "reach")]


def test_abort_disarms_on_the_ground_and_resume_says_why_not(browser: Browser, one: FakeServer) -> None:
    with opened(browser, one.url) as page:
        press(page, "resume")
        answers(page, "resume", "refused: this service has the vehicle")
        press(page, "arm")
        answers(page, "arm", "accepted")
        one.fly(1.0)
        expect(page.locator("#phase")).to_have_text("armed")
        press(page, "abort")
        answers(page, "abort", "done: disarmed")
        expect(page.locator("#phase")).to_have_text("disarmed")


def test_who_presses_before_a_vehicle_is_known_is_told(browser: Browser, one: FakeServer) -> None:
    one.vehicles.clear()
    with opened(browser, one.url) as page:
        expect(page.locator("#rights")).to_contain_text("may command")
        page.locator("[data-command=hold]").click()
        expect(page.locator("#last")).to_contain_text("refused: the page knows no vehicle yet")
    assert one.commands == []


def test_commands_go_to_one_vehicle_or_to_all_that_are_chosen(browser: Browser, three: FakeServer) -> None:
    names = list(three.names)
    with opened(browser, three.url, "tablet") as page:
        expect(page.locator(".card")).to_have_count(3)
        page.locator("#whom-all").click()
        for verb in ("arm", "takeoff"):
            press(page, verb)
            answers(page, verb, "all accepted")
            three.fly(2.0)
            answers(page, verb, "all done")
        assert [command["vehicle"] for command in three.commands] == names * 2
        expect(page.locator(".card .word")).to_have_text(["hold"] * 3)

        page.locator(".card button").nth(1).click()  # look at the second: commands go to it alone
        press(page, "land")
        answers(page, "land", f"{names[1]} accepted")
        three.fly(2.0)
        assert [command["vehicle"] for command in three.commands[6:]] == [names[1]]
        expect(page.locator(".card .word")).to_have_text(["hold", "disarmed", "hold"])
        expect(page.locator("#phase")).to_have_text("disarmed")

        page.locator(".card input").nth(1).click()
        expect(page.locator("#targets")).to_have_text(f"to {names[1]}")  # never to nobody
        page.locator(".card input").nth(2).check()
        page.locator(".card input").nth(1).uncheck()
        expect(page.locator("#targets")).to_have_text(f"to {names[2]}")
        press(page, "abort")
        answers(page, "abort", f"{names[2]} accepted")
        three.fly(2.0)
        assert [command["vehicle"] for command in three.commands[7:]] == [names[2]]


def test_vehicles_stand_in_the_servers_order_and_a_later_one_takes_no_commands(
    browser: Browser, three: FakeServer
) -> None:
    hello = {"type": "hello", "can_command": True, "password": False, "version": "0.1.0", "time_s": 0.0}
    first, second, third = three.names
    three.publishing = False
    with opened(browser, three.url, "tablet", by_hand=True) as page:

        def greets(*names: str) -> None:
            three.send({**hello, "vehicles": names})
            page.wait_for_timeout(50)  # until it has come
            page.clock.run_for(200)
            expect(page.locator(".card .name")).to_have_text(list(names))

        while page.evaluate("window.heardMs") is None:
            page.wait_for_timeout(20)
        greets(second, third)
        expect(page.locator("#whom-one")).to_have_text(second)
        greets(first, second)  # found a moment later
        expect(page.locator("#whom-one")).to_have_text(first)
        page.clock.run_for(2500)
        greets(third, first)  # a vehicle that comes later
        expect(page.locator("#whom-one")).to_have_text(first)
        page.locator(".card button").nth(0).click()
        greets(second, third)
        expect(page.locator("#whom-one")).to_have_text(third)


def test_a_server_that_begins_again_turns_no_button_to_another_vehicle(browser: Browser, three: FakeServer) -> None:
    """It finds one vehicle after the other: until it has found the chosen one, a Land must reach no other."""
    hello = {"type": "hello", "can_command": True, "password": False, "version": "0.1.0", "time_s": 0.0}
    first, second, third = three.names
    with opened(browser, three.url, "tablet") as page:
        page.locator(".card button").nth(1).click()
        expect(page.locator("#whom-one")).to_have_text(second)
        three.publishing = False
        for found in ([], [first], [first, third]):
            three.send({**hello, "vehicles": found})
            expect(page.locator(".card")).to_have_count(len({*found, second}))
            expect(page.locator("#kill-text")).to_contain_text("Kill")
            press(page, "land")
            expect(page.locator("output[data-answer=land]")).not_to_be_empty()
        assert {command["vehicle"] for command in three.commands} == {second}
        three.send({**hello, "vehicles": list(three.names)})
        expect(page.locator("#whom-one")).to_have_text(second)
