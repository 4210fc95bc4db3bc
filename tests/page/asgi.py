"""The page's application without a socket: requests, WebSockets, and vehicles that count what they are commanded."""

import asyncio
import json
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from starlette.types import ASGIApp, Message

from companion.client.command_draft import CommandDraft
from companion.page.access import OneTimeToken
from companion.page.app import page_app
from companion.page.hub import Hub
from companion.page.login import COOKIE, Login
from companion.page.passwords import PasswordHash
from companion.protocol.telemetry import Answer, Reply

HOST = "127.0.0.1:8080"
ORIGIN = f"http://{HOST}"
PASSWORD = "correct horse"
TOKEN = "one-time"
VEHICLES = ("dauam-1", "dauam-2")


def quick_hash(password: str) -> PasswordHash:
    """Return a hash that takes a millisecond, for tests that log in often."""
    quick = PasswordHash(2**4, 8, 1, b"sixteen bytes ok", b"")
    return replace(quick, digest=quick.digest_of(password))


@dataclass
class CountingCommands:
    """Vehicles that do at once what they are commanded, and keep it."""

    taken: list[tuple[str, str]] = field(default_factory=list)
    hang: bool = False

    async def execute(self, vehicle: str, draft: CommandDraft) -> AsyncIterator[Reply]:
        self.taken.append((vehicle, draft.verb))
        if self.hang:
            await asyncio.Event().wait()
        for answer in (Answer.ACCEPTED, Answer.DONE):
            yield Reply(id=draft.id, answer=answer, time_s=time.time())


@dataclass(frozen=True)
class Answered:
    """Answer to a request."""

    status: int
    headers: dict[str, str]
    body: bytes
    cookies: tuple[str, ...] = ()
    """Cookies that were set, as a request gives them back."""

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def cookie(self) -> str:
        """Cookie of the session that was begun."""
        return next(one for one in self.cookies if one.startswith(f"{COOKIE}="))


class Site:
    """One server of a page, in this process."""

    def __init__(self, password: str = PASSWORD, token: str = "") -> None:
        self.commands = CountingCommands()
        self.hub = Hub(bool(password))
        for name in VEHICLES:
            self.hub.note_vehicle(name)
        known = quick_hash(password) if password else None
        self.login = Login(password=known, token=OneTimeToken(token), tls=False)
        self.app: ASGIApp = page_app(self.hub, self.commands, self.login, frozenset({"localhost", "room-pc"}))

    def cookie(self) -> str:
        """Begin a session, and return its cookie as a request gives it back."""
        return f"{COOKIE}={self.login.sessions.begin(time.monotonic())}"

    async def ask(
        self, method: str, path: str, body: bytes = b"", peer: str = "192.168.0.7", **headers: str | None
    ) -> Answered:
        """Return the answer to a request; header names with _ for -, and None for one that is left out."""
        messages: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]
        sent: list[Message] = []

        async def receive() -> Message:
            return messages.pop(0) if messages else {"type": "http.disconnect"}

        async def send(message: Message) -> None:
            sent.append(message)

        scope = _scope("http", path, {"host": HOST, **headers}, peer) | {"method": method, "scheme": "http"}
        await self.app(scope, receive, send)
        start = next(one for one in sent if one["type"] == "http.response.start")
        text = b"".join(one.get("body", b"") for one in sent if one["type"] == "http.response.body")
        pairs = [(name.decode(), value.decode()) for name, value in start["headers"]]
        cookies = tuple(value.partition(";")[0] for name, value in pairs if name == "set-cookie")
        return Answered(start["status"], dict(reversed(pairs)), text, cookies)  # of two alike, the first

    async def log_in(self, peer: str = "192.168.0.7", **fields: object) -> Answered:
        """Return the answer to a login from the page itself."""
        return await self.log_in_again(None, peer, fields or {"password": PASSWORD})

    async def log_in_again(self, cookies: str | None, peer: str, fields: dict[str, object]) -> Answered:
        """Return the answer to a login from a browser that has cookies."""
        body, kind = json.dumps(fields).encode(), "application/json"
        return await self.ask("POST", "/login", body, peer, origin=ORIGIN, content_type=kind, cookie=cookies)

    @asynccontextmanager
    async def page(self, cookie: str = "", **headers: str | None) -> AsyncIterator["OpenPage"]:
        """Open a page's WebSocket."""
        given: dict[str, str | None] = {"host": HOST, "origin": ORIGIN, "cookie": cookie or None, **headers}
        page = OpenPage()
        running = asyncio.create_task(
            _run(self.app, _scope("websocket", "/ws", given, "192.168.0.7"), page), name="page"
        )
        page.inbox.put_nowait({"type": "websocket.connect"})
        await page.answered.wait()
        try:
            yield page
        finally:
            page.inbox.put_nowait({"type": "websocket.disconnect", "code": 1001})
            await running


class OpenPage:
    """Browser's end of a WebSocket."""

    def __init__(self) -> None:
        self.inbox: asyncio.Queue[Message] = asyncio.Queue()
        self.heard: list[dict[str, Any]] = []
        self.answered = asyncio.Event()
        self.news = asyncio.Event()
        self.status = 0
        """101 when accepted, else that of the denial."""
        self.closed: int | None = None
        """Code with which the server closed it."""
        self.reads = True
        self.cut = False
        """The server has closed it by itself, as uvicorn does when no pong comes."""

    def say(self, **fields: object) -> None:
        """Send a message."""
        self.say_text(json.dumps(fields))

    def say_text(self, text: str) -> None:
        """Send a message as it is."""
        self.inbox.put_nowait({"type": "websocket.receive", "text": text})

    def command(self, ref: int, verb: str = "hold", vehicle: str = VEHICLES[0], **fields: object) -> None:
        """Send a command."""
        self.say(type="command", ref=ref, vehicle=vehicle, verb=verb, **fields)

    async def until(self, kind: str, **fields: object) -> dict[str, Any]:
        """Wait for a message of this type with these fields."""
        wanted = {"type": kind, **fields}
        async with asyncio.timeout(5.0):
            while not (found := [one for one in self.heard if one.items() >= wanted.items()]):
                self.news.clear()
                await self.news.wait()
        return found[-1]

    def count(self, kind: str) -> int:
        """Return the number of messages of a type."""
        return sum(one["type"] == kind for one in self.heard)

    async def settled(self) -> None:
        """Wait until the server has taken all that was said."""
        async with asyncio.timeout(5.0):
            while self.status == 101 and self.closed is None and not self.inbox.empty():  # noqa: ASYNC110 - a queue has no event
                await asyncio.sleep(0)
        for _ in range(5):
            await asyncio.sleep(0)


async def _run(app: ASGIApp, scope: dict[str, Any], page: OpenPage) -> None:
    async def send(message: Message) -> None:
        if not page.reads:
            await asyncio.Event().wait()
        if page.cut:
            raise RuntimeError("Unexpected ASGI message 'websocket.send', after sending 'websocket.close'.")
        if message["type"] == "websocket.send":
            page.heard.append(json.loads(message["text"]))
        elif message["type"] == "websocket.accept":
            page.status = 101
        elif message["type"] == "websocket.close":
            page.status, page.closed = page.status or 403, message["code"]
        elif message["type"] == "websocket.http.response.start":
            page.status = message["status"]
        page.answered.set()
        page.news.set()

    await app(scope, page.inbox.get, send)
    page.answered.set()


def _scope(kind: str, path: str, headers: dict[str, str | None], peer: str) -> dict[str, Any]:
    path, _, query = path.partition("?")
    return {
        "type": kind,
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "scheme": "ws" if kind == "websocket" else "http",
        "path": path,
        "raw_path": path.encode(),
        "query_string": query.encode(),
        "root_path": "",
        "headers": [
            (name.replace("_", "-").encode(), value.encode("latin-1"))
            for name, value in headers.items()
            if value is not None
        ],
        "client": (peer, 50000),
        "server": ("127.0.0.1", 8080),
        "subprotocols": [],
        "extensions": {"websocket.http.response": {}},
    }
