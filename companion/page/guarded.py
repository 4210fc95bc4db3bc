"""Outermost layer of the application: refuses foreign names, and adds the headers that confine a page."""

from collections.abc import MutableMapping
from typing import Any

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from companion.page.origins import is_own_host

CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
HEADERS: tuple[tuple[bytes, bytes], ...] = (
    (b"content-security-policy", CSP.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-cache"),  # a browser asks each time whether its copy is still the server's
)
_FOREIGN = (
    "421: this page is asked for under a name that is not this computer's: open it by its address, as in "
    "http://192.168.0.10:8080/, or by the computer's own name\n"
)


class Guarded:
    """ASGI application around another one."""

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app, self._names = app, names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer 421."""
        if scope["type"] not in {"http", "websocket"}:
            return
        hosts = Headers(scope=scope).getlist("host")

        async def send_with_headers(message: Message) -> None:
            if message["type"] in {"http.response.start", "websocket.http.response.start"}:
                _add(message)
            await send(message)

        if len(hosts) != 1 or not is_own_host(hosts[0], self._names):
            await PlainTextResponse(_FOREIGN, 421)(scope, receive, send_with_headers)
            return
        await self._app(scope, receive, send_with_headers)


def _add(message: MutableMapping[str, Any]) -> None:
    names = {name for name, _ in HEADERS}
    kept = [(name, value) for name, value in message.get("headers", []) if name.lower() not in names]
    message["headers"] = [*kept, *HEADERS]
