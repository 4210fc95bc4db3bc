"""The page's application: its files, logging in and out, and what an open page is sent."""

import asyncio
import json
import time
from typing import Any

import pytest

from companion.page import app as page_app_module
from companion.page.access import MOST_TRIES, MOST_TRIES_IN_ALL
from companion.page.guarded import CSP
from companion.page.login import KNOWN
from companion.protocol.telemetry import Happened, Kind, Presence, State
from tests.page.asgi import HOST, ORIGIN, PASSWORD, TOKEN, VEHICLES, Site

ONE = VEHICLES[0]
JSON = "application/json"


async def test_every_answer_confines_the_page() -> None:
    site = Site()
    for method, path in (
        ("GET", "/"),
        ("HEAD", "/"),
        ("GET", "/static/none.js"),
        ("POST", "/login"),
        ("GET", "/nothing"),
    ):
        headers = (await site.ask(method, path)).headers
        assert headers["content-security-policy"] == CSP
        assert (headers["x-content-type-options"], headers["x-frame-options"]) == ("nosniff", "DENY")
        assert (headers["referrer-policy"], headers["cache-control"]) == ("no-referrer", "no-cache")
    assert "unsafe" not in CSP
    async with site.page(origin="http://evil.example") as page:
        assert page.status == 403


async def test_the_page_is_asked_for_again_after_an_update() -> None:
    site = Site()
    first = await site.ask("GET", "/")
    assert (first.status, first.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert (await site.ask("GET", "/static/index.html", if_none_match=first.headers["etag"])).status == 304
    assert (await site.ask("GET", "/static/../app.py")).status == 404
    assert (await site.ask("GET", "/static/%2e%2e/app.py")).status == 404


@pytest.mark.parametrize("host", [None, "evil.example", "127.0.0.1.evil.example:8080"])
async def test_a_foreign_name_is_answered_with_a_sentence(host: str | None) -> None:
    site = Site()
    answer = await site.ask("GET", "/", host=host)
    assert (answer.status, answer.body[:4]) == (421, b"421:")
    async with site.page(site.cookie(), host=host, origin=f"http://{host}") as page:
        assert page.status == 421


async def test_methods_that_are_not_offered() -> None:
    site = Site()
    for method, path in (("GET", "/login"), ("PUT", "/login"), ("DELETE", "/"), ("POST", "/static/index.html")):
        assert (await site.ask(method, path, origin=ORIGIN, content_type=JSON)).status == 405
    assert (await site.ask("GET", "/ws")).status == 404


async def test_the_password_gives_a_cookie_that_commands() -> None:
    site = Site()
    answer = await site.log_in()
    assert (answer.status, answer.json) == (200, {"ok": True})
    said = answer.headers["set-cookie"]
    assert all(word in said for word in ("HttpOnly", "SameSite=strict", "Path=/", "Max-Age=43200"))
    async with site.page(answer.cookie) as page:
        assert (await page.until("hello"))["can_command"]
        page.command(1)
        assert (await page.until("reply", answer="done"))["ref"] == 1
    assert site.commands.taken == [(ONE, "hold")]


async def test_after_logging_out_an_open_page_commands_no_more() -> None:
    site = Site()
    cookie = site.cookie()
    async with site.page(cookie) as page:
        answer = await site.ask("POST", "/logout", b"{}", origin=ORIGIN, content_type=JSON, cookie=cookie)
        assert answer.status == 200
        page.command(1)
        assert "log in" in (await page.until("error", ref=1))["text"]
    assert site.commands.taken == []


async def test_wrong_passwords_are_counted() -> None:
    site = Site()
    for _ in range(MOST_TRIES):
        answer = await site.log_in(password="guess")
        assert (answer.status, answer.json) == (401, {"error": "wrong password"})
    answer = await site.log_in()
    assert (answer.status, answer.json["error"]) == (429, "too many tries: the next one counts in 60 s")
    assert int(answer.headers["retry-after"]) in {59, 60}
    assert (await site.log_in(peer="192.168.0.8")).status == 200, "another address"


async def test_those_who_guess_keep_no_operator_out() -> None:
    site = Site()
    known = (await site.log_in(peer="192.168.0.9")).cookies
    for number in range(6 * MOST_TRIES):
        await site.log_in(peer=f"10.0.0.{number % 6}", password="guess")
    assert (await site.log_in(peer="192.168.0.7")).status == 200, "a new one, from an address that has not guessed"
    for number in range(MOST_TRIES_IN_ALL):
        await site.log_in(peer=f"10.0.1.{number}", password="guess")
    assert (await site.log_in(peer="192.168.0.8")).status == 429, "all tries of this minute are used up"
    again = await site.log_in_again("; ".join(known), "10.0.0.1", {"password": PASSWORD})
    assert again.status == 200, "not those of a browser that has logged in before, wherever it is now"
    async with site.page(again.cookie) as page:
        for ref, verb in enumerate(("abort", "land"), 1):
            page.command(ref, verb)
            await page.until("reply", ref=ref, answer="done")


async def test_a_known_browser_is_counted_by_itself_and_has_no_rights_by_that() -> None:
    site = Site()
    (known,) = [one for one in (await site.log_in()).cookies if one.startswith(f"{KNOWN}=")]
    async with site.page(known) as page:
        assert not (await page.until("hello"))["can_command"]
    right: dict[str, object] = {"password": PASSWORD}
    for number in range(MOST_TRIES):
        assert (await site.log_in_again(known, f"10.0.0.{number}", {"password": "guess"})).status == 401
    assert (await site.log_in_again(known, "10.0.0.9", right)).status == 429, "wherever it is"
    assert (await site.log_in_again(f"{known[:-1]}?", "10.0.0.9", right)).status == 200, "by its address without it"


@pytest.mark.parametrize("fields", [{"password": None}, {"password": 7}, {"password": "x" * 300}, {"passwort": "x"}])
async def test_what_is_no_password_is_a_wrong_one(fields: dict[str, Any]) -> None:
    assert (await Site().log_in(**fields)).status == 401


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"origin": None}, 403),
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": f"https://{HOST}"}, 403),
        ({"content_type": None}, 415),
        ({"content_type": "text/plain"}, 415),
        ({"content_type": "application/x-www-form-urlencoded"}, 415),
    ],
)
async def test_a_login_from_elsewhere_is_refused(headers: dict[str, Any], status: int) -> None:
    site = Site()
    body = json.dumps({"password": PASSWORD}).encode()
    for path in ("/login", "/logout"):
        answer = await site.ask("POST", path, body, **{"origin": ORIGIN, "content_type": JSON} | headers)
        assert (answer.status, "set-cookie" in answer.headers) == (status, False)


@pytest.mark.parametrize(("body", "status"), [(b"", 400), (b"[]", 400), (b"[" * 2000, 400), (b"{" + b" " * 3000, 413)])
async def test_a_body_that_is_no_small_object_is_refused(body: bytes, status: int) -> None:
    assert (await Site().ask("POST", "/login", body, origin=ORIGIN, content_type=JSON)).status == status


async def test_without_a_password_nobody_logs_in() -> None:
    site = Site(password="")
    answer = await site.log_in()
    assert answer.status == 403
    assert "--page-password" in answer.json["error"]
    async with site.page() as page:
        hello = await page.until("hello")
        assert (hello["can_command"], hello["password"]) == (False, False)
        page.command(1)
        assert "only looks" in (await page.until("error", ref=1))["text"]
    assert site.commands.taken == []


async def test_the_demos_token_lets_one_browser_of_this_computer_in() -> None:
    site = Site(password="", token=TOKEN)
    assert (await site.log_in(token=TOKEN)).status == 401, "another computer"
    cookie = (await site.log_in(peer="127.0.0.1", token=TOKEN)).cookie
    assert (await site.log_in(peer="127.0.0.1", token=TOKEN)).status == 401, "a second time"
    async with site.page(cookie) as page:
        assert (await page.until("hello"))["can_command"]


async def test_a_new_page_hears_all_that_is_known_and_then_the_news() -> None:
    site = Site()
    happened = Happened(time_s=1.0, kind=Kind.LOG, text="before")
    site.hub.note_broker(True)
    site.hub.note_presence(ONE, Presence(online=True, session="0" * 16))
    site.hub.note_state(ONE, State(time_s=1.0, session="0" * 16, phase="hold"), 0.25)
    site.hub.note_event(ONE, happened)
    async with site.page() as page:
        state = await page.until("state", vehicle=ONE)
        assert (state["state"]["phase"], state["arms_b_m"]) == ("hold", None)
        assert 0.25 <= state["age_s"] < 1.0
        hello, broker = page.heard[:2]
        assert (hello["vehicles"], hello["password"], hello["can_command"]) == (list(VEHICLES), True, False)
        assert (broker["type"], broker["linked"]) == ("broker", True)
        assert page.count("about") == 2
        assert (await page.until("event"))["old"]
        site.hub.note_event(ONE, happened.model_copy(update={"text": "after"}))
        assert (await page.until("event", vehicle=ONE, event=(await page.until("event"))["event"]))["event"]["text"]
        site.hub.note_vehicle("dauam-3")
        assert (await page.until("hello", vehicles=[*VEHICLES, "dauam-3"]))["can_command"] is False
        site.hub.beat()
        assert abs((await page.until("beat"))["time_s"] - time.time()) < 1.0


async def test_a_page_that_does_not_read_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.page.page_socket._UNREAD_S", 0.01)
    site = Site()
    async with site.page() as page:
        page.reads = False
        site.hub.beat()
        async with asyncio.timeout(5.0):
            while site.hub.pages:  # noqa: ASYNC110 - a count has no event
                await asyncio.sleep(0.001)


async def test_a_page_that_the_server_has_cut_ends_quietly() -> None:
    site = Site()
    async with site.page() as page:
        page.cut = True
        site.hub.beat()
    assert site.hub.pages == 0, "and no error was raised"


async def test_one_page_too_many_is_refused_and_an_operators_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_app_module, "MOST_PAGES", 2)
    site = Site()
    async with site.page(), site.page(), site.page() as third, site.page(site.cookie()) as operator:
        assert (third.status, operator.status) == (503, 101)
    assert site.hub.pages == 0


async def test_a_page_may_hold_although_other_commands_of_its_wait() -> None:
    site = Site()
    site.commands.hang = True
    async with site.page(site.cookie()) as page:
        for ref in range(1, 10):
            page.command(ref, "preflight")
        assert "8 commands of this page are under way" in (await page.until("error", ref=9))["text"]
        page.command(10, "hold")
        await page.settled()
    assert [verb for _, verb in site.commands.taken] == ["preflight"] * 8 + ["hold"]


async def test_a_page_that_talks_nonsense_is_closed() -> None:
    site = Site()
    async with site.page(site.cookie()) as page:
        for _ in range(200):
            page.say_text("nonsense")
        await page.settled()
        assert page.closed == 1008
    async with site.page(site.cookie()) as page:
        page.say_text("x" * 8193)
        await page.settled()
        assert page.closed == 1009
    async with site.page(site.cookie()) as page:
        page.inbox.put_nowait({"type": "websocket.receive", "bytes": b"{}"})
        await page.settled()
        assert page.closed == 1008
