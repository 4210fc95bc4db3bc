"""Ten thousand attempts to command without a right to: forged, replayed, from foreign origins, oversized.

Each attempt runs against the application as it is served; the vehicles count what reaches them. Beside the attackers
one operator is logged in, whose commands must be all that is counted. With -rP the numbers of docs/page.md are printed.
"""

import json
import random
import secrets
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from companion.page.login import COOKIE
from companion.page.page_commands import AFTER_S, MOST_BYTES
from companion.protocol.commands import VERBS
from tests.page.asgi import HOST, ORIGIN, PASSWORD, TOKEN, VEHICLES, OpenPage, Site

AT_ONCE = 90
"""Messages of one connection: after 100 that are not accepted it is closed."""
FIELDS: dict[str, dict[str, Any]] = {
    "goto": {"x_m": 0.5, "y_m": -0.5, "z_m": 1.2},
    "track": {"curve": "ellipse"},
    "arms": {"do": "stow"},
    "controller": {"name": "pid"},
    "kill": {"confirm": "kill"},
}
FOREIGN = (
    "http://evil.example", "https://evil.example", "null", "", f"https://{HOST}", "http://127.0.0.1",
    "http://127.0.0.1:80", "http://localhost:8080", f"http://{HOST}.evil.example", f"http://evil.example/{HOST}",
    f"{ORIGIN}/", "file://", None,
)  # fmt: skip
TYPES = ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "text/json", "", None)


class Attack:
    """One site under attack, an operator who is logged in there, and the count of attempts by kind."""

    def __init__(self) -> None:
        self.site = Site(token=TOKEN)
        self.random = random.Random(1)
        self.made: Counter[str] = Counter()
        self.operators = 0
        """Commands of the operator, the only ones that may reach a vehicle."""
        self.cookie = self.site.cookie()

    def verbs(self, count: int) -> Iterator[str]:
        """Yield verbs, each of them again and again."""
        return (VERBS[number % len(VERBS)] for number in range(count))

    @asynccontextmanager
    async def page(self, kind: str, attempts: int, **headers: Any) -> AsyncIterator[OpenPage]:
        """Open a page for attempts of one kind; afterwards each must have been refused with a sentence."""
        self.made[kind] += attempts
        async with self.site.page(**headers) as page:
            before = page.count("error") + page.count("confirm")
            yield page
            await page.settled()
            refused = page.count("error") + page.count("confirm") - before
            assert page.closed is not None or page.status != 101 or refused >= attempts, (kind, refused, attempts)


def message(ref: int, verb: str, **fields: object) -> dict[str, Any]:
    return {"type": "command", "ref": ref, "vehicle": VEHICLES[0], "verb": verb, **FIELDS.get(verb, {}), **fields}


async def forge_cookies(attack: Attack) -> None:
    """Command without a login, with invented cookies, of another server, and after logging out."""
    ended = attack.site.cookie()
    attack.site.login.sessions.end(ended.partition("=")[2])
    others = Site().cookie()
    for number in range(25):
        cookies = ("", f"{COOKIE}=", f"{COOKIE}={secrets.token_urlsafe(32)}", ended, others, f"{COOKIE}=*", "session=1",
                   f"{attack.cookie}x")  # fmt: skip
        async with attack.page("without a login", AT_ONCE, cookie=cookies[number % len(cookies)]) as page:
            for ref, verb in enumerate(attack.verbs(AT_ONCE), 1):
                page.say(**message(ref, verb))


async def use_foreign_origins(attack: Attack) -> None:
    """Speak with the operator's cookie from other sites' pages, and under other names."""
    for number in range(2000):
        origin, verb = FOREIGN[number % len(FOREIGN)], VERBS[number % len(VERBS)]
        headers: dict[str, Any] = {"origin": origin}
        if number % 3 == 0:
            headers = {"origin": "http://evil.example", "host": "evil.example"}
        async with attack.page("foreign origin, WebSocket", 1, cookie=attack.cookie, **headers) as page:
            assert page.status in {403, 421}
            page.say(**message(1, verb))


async def log_in_from_elsewhere(attack: Attack) -> None:
    """Send the right password as another site's page can: a form, a simple request, without an origin."""
    body = json.dumps({"password": PASSWORD}).encode()
    for number in range(2000):
        origin, kind = FOREIGN[number % len(FOREIGN)], "application/json"
        if number % 2:
            origin, kind = ORIGIN, TYPES[number % len(TYPES)] or ""
        cookie = attack.cookie if number % 3 else None
        headers: dict[str, Any] = {"origin": origin, "content_type": kind or None, "cookie": cookie}
        answer = await attack.site.ask("POST", ("/login", "/logout")[number % 5 == 0], body, **headers)
        attack.made["foreign origin, login"] += 1
        assert answer.status in {403, 415, 421}
        assert "set-cookie" not in answer.headers


async def guess_passwords(attack: Attack) -> None:
    """Guess from many addresses; a token that was used, or from another computer."""
    answers: Counter[int] = Counter()
    for number in range(500):
        fields: dict[str, object] = {"password": f"guess {number}"} if number % 2 else {"token": TOKEN}
        answers[(await attack.site.log_in(peer=f"10.0.{number % 7}.1", **fields)).status] += 1
        attack.made["guessed passwords and tokens"] += 1
    assert set(answers) == {401, 429}
    assert answers[401] <= 30, "in a minute"


async def replay(attack: Attack) -> None:
    """Say again what the operator has said: on the same connection, and on another without a login."""
    async with attack.site.page(attack.cookie) as page:
        said = [message(ref, verb) for ref, verb in enumerate(attack.verbs(60), 1) if verb != "kill"]
        for one in said:
            page.say(**one)
            await page.until("reply", ref=one["ref"], answer="done")
        attack.operators += len(said)
        for one in said:
            page.say(**one)
        attack.made["replayed"] += len(said)
        await page.settled()
        assert page.count("error") == len(said)
    for _ in range(25):
        async with attack.page("replayed", AT_ONCE) as page:
            for number in range(AT_ONCE):
                page.say(**said[number % len(said)])
    for _ in range(5):
        async with attack.site.page(attack.cookie) as page:
            page.say(**said[-1])
            await page.until("reply", ref=said[-1]["ref"], answer="done")
            attack.operators += 1
            for number in range(AT_ONCE):
                page.say(**said[number % len(said)])
            attack.made["replayed"] += AT_ONCE
            await page.settled()
            assert page.count("error") == AT_ONCE


async def oversize(attack: Attack) -> None:
    """Send too much, too deep, too many fields, numbers that are none, with the operator's cookie."""
    for number in range(400):
        text = json.dumps(message(1, "goto", text="x" * attack.random.randint(MOST_BYTES, 4 * MOST_BYTES)))
        async with attack.page("oversized", 1, cookie=attack.cookie) as page:
            page.say_text(text if number % 2 else "[" * len(text))
    for _ in range(10):
        async with attack.page("oversized", AT_ONCE, cookie=attack.cookie) as page:
            for number in range(AT_ONCE):
                many = {f"f{field}": field for field in range(number + 1)}
                page.say_text(("[" * (100 + number), '{"a":' * 80, json.dumps(message(number + 1, "goto") | many),
                               json.dumps(message(10**300, "hold")), json.dumps(message(number + 1, "goto", x_m=1e400)),
                               )[number % 5])  # fmt: skip
    for number in range(200):
        body = json.dumps({"password": PASSWORD, "more": "x" * attack.random.randint(2048, 100_000)}).encode()
        answer = await attack.site.ask("POST", "/login", body, origin=ORIGIN, content_type="application/json")
        attack.made["oversized"] += 1
        assert answer.status == 413, number


async def give_the_servers_fields(attack: Attack) -> None:
    """Add what only the server may give, name vehicles and verbs that there are not, with the operator's cookie."""
    added: tuple[dict[str, Any], ...] = (
        {"session": "0" * 16}, {"id": "x"}, {"sent_s": 0.0}, {"reply_to": "x"}, {"waypoints": []}, {"vehicle": "+"},
        {"vehicle": "dauam-1/command"}, {"vehicle": None}, {"verb": "reboot"}, {"verb": None}, {"ref": "1"},
        {"ref": -1}, {"type": "reply"}, {"nonce": "x"}, {"confirm": "kill", "x": 1}, {"__proto__": {}},
    )  # fmt: skip
    for _ in range(20):
        async with attack.page("forged fields", AT_ONCE, cookie=attack.cookie) as page:
            for ref, verb in enumerate(attack.verbs(AT_ONCE), 1):
                page.say(**message(ref, "hold" if verb == "kill" else verb) | added[ref % len(added)])


async def kill_at_once(attack: Attack) -> None:
    """Kill in one message, with guessed, used, foreign or early nonces, with the operator's cookie."""
    async with attack.site.page(attack.cookie) as other:
        other.command(1, "kill")
        foreign = (await other.until("confirm"))["nonce"]
        for _ in range(10):
            async with attack.page("kill in one message", AT_ONCE, cookie=attack.cookie) as page:
                for ref in range(1, AT_ONCE + 1):
                    nonces = (None, secrets.token_urlsafe(16), foreign, "", 0)
                    extra = {"nonce": nonces[ref % 5]} if nonces[ref % 5] is not None else {}
                    page.say(**message(ref, "kill", **extra))
        async with attack.page("kill at once", 2 * 40, cookie=attack.cookie) as page:
            for ref in range(1, 80, 2):
                page.command(ref, "kill")
                nonce = (await page.until("confirm", ref=ref))["nonce"]
                page.command(ref + 1, "kill", confirm="kill", nonce=nonce)


async def test_ten_thousand_attempts_command_nothing() -> None:
    attack, begun_s = Attack(), time.process_time()
    await forge_cookies(attack)
    await use_foreign_origins(attack)
    await log_in_from_elsewhere(attack)
    await guess_passwords(attack)
    await replay(attack)
    await oversize(attack)
    await give_the_servers_fields(attack)
    await kill_at_once(attack)
    attempts = sum(attack.made.values())
    for kind, count in attack.made.items():
        print(f"| {kind} | {count} | 0 |")
    print(f"{attempts} attempts, {time.process_time() - begun_s:.1f} s of CPU")
    assert attempts >= 10_000
    assert len(attack.site.commands.taken) == attack.operators, "and nothing of an attacker"
    assert all(verb != "kill" for _, verb in attack.site.commands.taken)


async def test_a_kill_takes_two_messages_and_a_second_and_a_half(monkeypatch: pytest.MonkeyPatch) -> None:
    site, clock = Site(), [100.0]
    async with site.page(site.cookie()) as page:
        monkeypatch.setattr("companion.page.page_socket.time.monotonic", lambda: clock[0])
        page.command(1, "kill")
        question = await page.until("confirm", ref=1)
        assert (question["after_s"], question["until_s"]) == (1.5, 10.0)
        clock[0] += AFTER_S
        page.command(2, "kill", confirm="kill", nonce=question["nonce"])
        await page.until("reply", ref=2, answer="done")
    assert site.commands.taken == [(VEHICLES[0], "kill")]
