"""Logging in and out: `POST /login` and `POST /logout`, from a page of this server alone."""

import asyncio
import logging
import math
import secrets
import time
from dataclasses import dataclass, field
from typing import Any

from pydantic_core import from_json
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response

from companion.adapters.system.log_lines import LineLimit
from companion.page.access import SESSION_S, KnownBrowsers, OneTimeToken, Sessions, Tries, network_of
from companion.page.origins import is_same_origin
from companion.page.passwords import MOST_BYTES, PasswordHash

LOG = logging.getLogger(__name__)

_MOST_BODY_BYTES = 2048
_BODY_S = 5.0
"""Time for a request's body to arrive."""
COOKIE = "dauam_page"
KNOWN = "dauam_page_known"
"""Cookie of a browser that has logged in."""
_KNOWN_S = 90 * 24 * 3600.0
NO_PASSWORD = "this page only looks: its server was started without --page-password FILE"  # noqa: S105 - a sentence


class RefusedError(Exception):
    """Answer to a request that is refused: status and sentence."""

    def __init__(self, status: int, text: str, retry_s: float = 0.0) -> None:
        super().__init__(text)
        self.status, self.retry_s = status, retry_s


@dataclass(kw_only=True)
class Login:
    """Logins of one server."""

    password: PasswordHash | None
    token: OneTimeToken
    tls: bool
    sessions: Sessions = field(default_factory=Sessions)
    _tries: Tries = field(default_factory=Tries)
    _log: LineLimit = field(default_factory=LineLimit)
    _one: asyncio.Lock = field(default_factory=asyncio.Lock)
    """One hash at a time: each takes 16 MB and a fifth of a second."""
    _browsers: KnownBrowsers = field(init=False)

    def __post_init__(self) -> None:
        """Sign with the password's hash: browsers stay known when the server begins again, until it is changed."""
        self._browsers = KnownBrowsers(self.password.digest if self.password is not None else secrets.token_bytes(32))

    def can_command(self, connection: HTTPConnection) -> bool:
        """Return whether a request, or a WebSocket's, has the cookie of a session."""
        return self.sessions.lasts(connection.cookies.get(COOKIE, ""), time.monotonic())

    async def log_in(self, request: Request) -> Response:
        """Answer `POST /login`: a cookie for the right password or token."""
        try:
            fields = await _fields_of(request)
            await self._check(fields, request)
        except RefusedError as refused:
            said = f"a login from {peer_of(request)} is refused: {refused}"
            self._log.log(lambda more: LOG.warning("%s%s", said, more))
            return _refusal(refused)
        LOG.info("%s has logged in", peer_of(request))
        answer = JSONResponse({"ok": True})
        cookie = self.sessions.begin(time.monotonic())
        for name, value, age_s in ((COOKIE, cookie, SESSION_S), (KNOWN, self._browsers.mark(), _KNOWN_S)):
            answer.set_cookie(
                name, value, max_age=int(age_s), path="/", secure=self.tls, httponly=True, samesite="strict"
            )
        return answer

    async def log_out(self, request: Request) -> Response:
        """Answer `POST /logout`: the session ends."""
        try:
            await _fields_of(request)
        except RefusedError as refused:
            return _refusal(refused)
        self.sessions.end(request.cookies.get(COOKIE, ""))
        answer = JSONResponse({"ok": True})
        answer.delete_cookie(COOKIE, path="/", secure=self.tls, httponly=True, samesite="strict")
        return answer

    async def _check(self, fields: dict[str, Any], request: Request) -> None:
        """Return when the password or the token is right; raise RefusedError otherwise."""
        peer, mark = peer_of(request), request.cookies.get(KNOWN, "")
        known = self._browsers.knows(mark)
        wait_s = self._tries.wait_s(mark if known else network_of(peer), time.monotonic(), known)
        if wait_s > 0.0:
            text = f"too many tries: the next one counts in {math.ceil(wait_s)} s"
            raise RefusedError(429, text, wait_s)
        token, password = fields.get("token"), fields.get("password")
        if isinstance(token, str):
            if not self.token.take(token, peer):
                raise RefusedError(401, "this address has been used already: open the one that is printed now")
            return
        if self.password is None:
            raise RefusedError(403, NO_PASSWORD)
        if not isinstance(password, str) or len(password.encode()) > MOST_BYTES:
            raise RefusedError(401, "wrong password")
        async with self._one:
            if not await asyncio.to_thread(self.password.matches, password):
                raise RefusedError(401, "wrong password")


def peer_of(connection: HTTPConnection) -> str:
    """Return the address of a request's sender."""
    return connection.client.host if connection.client is not None else ""


def from_this_page(connection: HTTPConnection) -> bool:
    """Return whether a request comes from a page of this server."""
    origins, host = connection.headers.getlist("origin"), connection.headers.get("host", "")
    scheme = "https" if connection.scope["scheme"] in {"https", "wss"} else "http"
    return len(origins) == 1 and is_same_origin(origins[0], scheme, host)


async def _fields_of(request: Request) -> dict[str, Any]:
    """Return the fields of a JSON body; raise RefusedError for a foreign or malformed request."""
    if not from_this_page(request):
        raise RefusedError(403, "the request does not come from this page")
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
        raise RefusedError(415, "the request must be application/json")
    body = b""
    try:
        async with asyncio.timeout(_BODY_S):
            async for part in request.stream():
                body += part
                if len(body) > _MOST_BODY_BYTES:
                    raise RefusedError(413, f"a request has at most {_MOST_BODY_BYTES} bytes")
        fields = from_json(body)
    except TimeoutError:
        raise RefusedError(408, "the request did not arrive") from None
    except ValueError:
        raise RefusedError(400, "the request is not JSON") from None
    if not isinstance(fields, dict):
        raise RefusedError(400, "the request is not a JSON object")
    return fields


def _refusal(refused: RefusedError) -> Response:
    headers = {"retry-after": str(math.ceil(refused.retry_s))} if refused.retry_s else None
    return JSONResponse({"error": str(refused)}, refused.status, headers)
