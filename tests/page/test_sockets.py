"""The page's server on real sockets of this machine: what it does with what browsers never send."""

import asyncio
import contextlib
import json
import socket
import ssl
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from companion.config.operator_config import PageConfig
from companion.page import page_socket, wire
from companion.page.server import certificate_of, server_of
from tests.mosquitto import make_certificates
from tests.packages import needs
from tests.page.asgi import VEHICLES, Site

pytestmark = pytest.mark.realtime
PATIENCE_S = 10.0


@dataclass(frozen=True)
class Served:
    """A site on a port of this machine."""

    site: Site
    port: int
    tls: ssl.SSLContext | None = None

    def open(self, cookie: str = "", origin: str = "") -> connect:
        """Connect to the WebSocket as a browser does."""
        scheme = "" if self.tls is None else "s"
        host, headers = f"127.0.0.1:{self.port}", {"cookie": cookie} if cookie else {}
        return connect(
            f"ws{scheme}://{host}/ws",
            origin=origin or f"http{scheme}://{host}",  # type: ignore[arg-type]
            additional_headers=headers,
            ssl=self.tls,
            max_queue=None,
        )

    async def raw(self, text: str = "") -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Connect without any protocol, and say something."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        writer.write(text.encode())
        return reader, writer


@asynccontextmanager
async def served(certificate: ssl.SSLContext | None = None, tls: ssl.SSLContext | None = None) -> AsyncIterator[Served]:
    """Serve a site, without vehicles, in this process."""
    site = Site()
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        server = server_of(site.app, certificate)
        serving = asyncio.create_task(server.serve([listener]), name="page")
        while not server.started:  # noqa: ASYNC110 - it has no event
            await asyncio.sleep(0.005)
        try:
            yield Served(site, listener.getsockname()[1], tls)
        finally:
            server.should_exit = True
            await serving


def handshake(host: str, origin: str) -> str:
    """Return the request that opens a WebSocket."""
    lines = (
        "GET /ws HTTP/1.1",
        f"Host: {host}",
        f"Origin: {origin}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
    )
    return "\r\n".join((*lines, "", ""))


async def first(page: ClientConnection, kind: str) -> dict[str, object]:
    """Return the first message of this type."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            message: dict[str, object] = json.loads(await page.recv())
            if message["type"] == kind:
                return message


async def until_closed(page: ClientConnection) -> int | None:
    """Return the code with which the server closes a page."""
    async with asyncio.timeout(PATIENCE_S):
        with contextlib.suppress(ConnectionClosed):
            while True:
                await page.recv()
    return page.close_code


async def ended(reader: asyncio.StreamReader) -> bytes:
    """Return all that comes until the server ends a connection."""
    async with asyncio.timeout(PATIENCE_S):
        with contextlib.suppress(ConnectionResetError):
            return await reader.read()
    return b""


async def test_a_command_and_its_replies_over_a_websocket() -> None:
    async with served() as page, page.open(page.site.cookie()) as socket_:
        await socket_.send(json.dumps({"type": "command", "ref": 1, "vehicle": VEHICLES[0], "verb": "hold"}))
        assert (await first(socket_, "reply"))["answer"] == "accepted"
        assert (await first(socket_, "reply"))["answer"] == "done"
    assert page.site.commands.taken == [(VEHICLES[0], "hold")]


async def test_foreign_origins_and_names_are_refused_at_the_handshake() -> None:
    async with served() as page:
        cookie = page.site.cookie()
        for origin in ("http://evil.example", "null", f"https://127.0.0.1:{page.port}"):
            with pytest.raises(InvalidStatus, match="403"):
                async with page.open(cookie, origin):
                    pass
        reader, writer = await page.raw(handshake("evil.example", "http://evil.example"))
        said = await ended(reader)
        assert said.startswith(b"HTTP/1.1 421")
        assert b"content-security-policy" in said
        writer.close()
    assert page.site.commands.taken == []


async def test_oversized_messages_close_the_connection() -> None:
    text = json.dumps({"type": "command", "ref": 1, "vehicle": VEHICLES[0], "verb": "hold", "x": "y" * 8192})
    async with served() as page:
        async with page.open(page.site.cookie()) as socket_:
            await socket_.send(text)
            assert await until_closed(socket_) == 1009
        async with page.open(page.site.cookie()) as socket_:
            await socket_.send([text[:4000], text[4000:8000], text[8000:]])  # in fragments
            assert await until_closed(socket_) == 1009
        reader, writer = await page.raw("GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + "y" * 200_000)
        assert (await ended(reader))[:12] in {b"", b"HTTP/1.1 400"}, "nothing, where the end overtakes the answer"
        writer.close()
    assert page.site.commands.taken == []


async def test_a_page_that_stops_reading_gets_the_newest_and_is_then_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_socket, "_UNREAD_S", 0.3)
    monkeypatch.setattr(wire, "_CLOSE_S", 0.1)
    async with served() as page:
        with socket.create_connection(("127.0.0.1", page.port)) as deaf:
            host = f"127.0.0.1:{page.port}"
            deaf.sendall(handshake(host, f"http://{host}").encode())
            begun_s, shown = time.monotonic(), 0
            while page.site.hub.pages or shown == 0:
                page.site.hub._show("x", json.dumps({"type": "state", "text": "y" * 50_000}))
                shown += bool(page.site.hub.pages)
                await asyncio.sleep(0.002)
                assert time.monotonic() - begun_s < PATIENCE_S
            assert all(len(outlet._newest) <= 2 for outlet in page.site.hub._outlets)
            await asyncio.sleep(0.2)
            deaf.settimeout(PATIENCE_S)
            with contextlib.suppress(ConnectionResetError):
                while deaf.recv(1_000_000):
                    pass


async def test_a_broken_frame_ends_its_page_alone(caplog: pytest.LogCaptureFixture) -> None:
    async with served() as page, page.open() as other:
        host = f"127.0.0.1:{page.port}"
        reader, writer = await page.raw(handshake(host, f"http://{host}"))
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"\xff\xff\xff\xff")
        for _ in range(20):
            page.site.hub.beat()
            await asyncio.sleep(0.001)
        await ended(reader)
        writer.close()
        assert (await first(other, "beat"))["time_s"]
    assert [record.message for record in caplog.records if record.levelname == "ERROR"] == []


async def test_who_connects_and_says_nothing_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "_REQUEST_S", 0.1)
    async with served() as page:
        for text in ("", "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: y"):
            reader, writer = await page.raw(text)
            assert await ended(reader) == b""
            writer.close()


async def test_more_connections_than_are_allowed_are_closed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "MOST_CONNECTIONS", 3)
    async with served() as page:
        kept = [await page.raw() for _ in range(3)]
        await asyncio.sleep(0.05)
        reader, writer = await page.raw("GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert await ended(reader) == b""
        for _, one in (*kept, (reader, writer)):
            one.close()


@needs("openssl")
async def test_with_a_certificate_all_of_it_is_encrypted(tmp_path: Path) -> None:
    make_certificates(tmp_path / "certs", "127.0.0.1")
    files = [str(tmp_path / "certs" / f"server.{ending}") for ending in ("crt", "key")]
    page_config = PageConfig(tls_cert=files[0], tls_key=files[1])
    trusted = ssl.create_default_context(cafile=str(tmp_path / "certs" / "ca.crt"))
    async with served(certificate_of(page_config), trusted) as page:
        async with page.open(page.site.cookie()) as socket_:
            assert (await first(socket_, "hello"))["can_command"]
        with pytest.raises(InvalidStatus, match="403"):
            async with page.open(origin=f"http://127.0.0.1:{page.port}"):
                pass
