"""Rights on the page: who is logged in, and how often logging in may be tried. Time is an argument."""

import hashlib
import hmac
import ipaddress
import secrets
from collections import deque
from dataclasses import dataclass, field

WINDOW_S = 60.0
MOST_TRIES = 5
"""Tries of one address within WINDOW_S."""
MOST_TRIES_IN_ALL = 30
SESSION_S = 12 * 3600.0
"""Time after which one has to log in again."""
_MOST_SESSIONS = 100


@dataclass
class Tries:
    """Limit on the rate at which logging in is tried. Times are monotonic, s."""

    _of: dict[str, deque[float]] = field(default_factory=dict)
    _all: deque[float] = field(default_factory=deque)

    def wait_s(self, address: str, now_s: float) -> float:
        """Return how long this address has to wait; 0 when it may try now, which counts as a try."""
        own = self._of.get(address) or deque()
        for tries in (own, self._all):
            while tries and now_s - tries[0] >= WINDOW_S:
                tries.popleft()
        for tries, most in ((own, MOST_TRIES), (self._all, MOST_TRIES_IN_ALL)):
            if len(tries) >= most:
                return WINDOW_S - (now_s - tries[0])
        own.append(now_s)
        self._all.append(now_s)
        self._of = {one: tries for one, tries in self._of.items() if now_s - tries[-1] < WINDOW_S} | {address: own}
        return 0.0


class Sessions:
    """Logins that are valid, by the hash of their cookie."""

    def __init__(self) -> None:
        self._until_s: dict[bytes, float] = {}

    def begin(self, now_s: float) -> str:
        """Return the cookie of a new session; of very many the oldest ends."""
        cookie = secrets.token_urlsafe(32)
        self._until_s[_hash(cookie)] = now_s + SESSION_S
        while len(self._until_s) > _MOST_SESSIONS:
            del self._until_s[next(iter(self._until_s))]
        return cookie

    def end(self, cookie: str) -> None:
        """End a session."""
        self._until_s.pop(_hash(cookie), None)

    def lasts(self, cookie: str, now_s: float) -> bool:
        """Return whether a cookie is that of a session."""
        return self._until_s.get(_hash(cookie), -1.0) > now_s


class OneTimeToken:
    """Login that works once, from this computer: for the browser that the demo opens."""

    def __init__(self, token: str) -> None:
        self._token = token.encode()

    def take(self, token: str, address: str) -> bool:
        """Return whether this is the token, which is then used up."""
        good = bool(self._token) and is_loopback(address) and hmac.compare_digest(self._token, token.encode())
        if good:
            self._token = b""
        return good


def is_loopback(address: str) -> bool:
    """Return whether a peer's address is on this computer."""
    try:
        return ipaddress.ip_address(address.partition("%")[0]).is_loopback
    except ValueError:
        return False


def _hash(cookie: str) -> bytes:
    return hashlib.sha256(cookie.encode()).digest()
