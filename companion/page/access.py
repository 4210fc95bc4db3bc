"""Rights on the page: who is logged in, and how often logging in may be tried. Time is an argument."""

import hashlib
import hmac
import ipaddress
import secrets
from collections import deque
from dataclasses import dataclass, field

WINDOW_S = 60.0
MOST_TRIES = 5
"""Tries of one address, or of one known browser, within WINDOW_S."""
MOST_TRIES_IN_ALL = 30
"""Tries of all addresses together; known browsers do not count."""
_FOR_FIRST_TRIES = 10
"""The last ones of these, for addresses that have not tried within WINDOW_S: who guesses does not use them up."""
SESSION_S = 12 * 3600.0
"""Time after which one has to log in again."""
_MOST_SESSIONS = 100


@dataclass
class Tries:
    """Limit on the rate at which logging in is tried. Times are monotonic, s."""

    _of: dict[str, deque[float]] = field(default_factory=dict)
    _all: deque[float] = field(default_factory=deque)

    def wait_s(self, who: str, now_s: float, known: bool = False) -> float:
        """Return how long an address, or a known browser, has to wait; 0 when it may try now, which counts as a try."""
        own, every = self._of.get(who) or deque(), self._all
        for tries in (own, every):
            while tries and now_s - tries[0] >= WINDOW_S:
                tries.popleft()
        limits = [(own, MOST_TRIES)]
        if not known:
            limits.append((every, MOST_TRIES_IN_ALL - (_FOR_FIRST_TRIES if own else 0)))
        waits_s = [WINDOW_S - (now_s - tries[-most]) for tries, most in limits if len(tries) >= most]
        if waits_s:
            return max(waits_s)
        own.append(now_s)
        if not known:
            every.append(now_s)
        self._of = {one: tries for one, tries in self._of.items() if now_s - tries[-1] < WINDOW_S} | {who: own}
        return 0.0


def network_of(address: str) -> str:
    """Return what counts as one address: an IPv6 computer has a whole /64 to choose from (RFC 4291, 2.5.1)."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if found.version == 4:
        return address
    return str(found.ipv4_mapped or ipaddress.ip_network((found, 64), strict=False))


class KnownBrowsers:
    """Mark of the browsers that have logged in once: those who guess cannot keep them out.

    OWASP's device cookies (Slow Down Online Guessing Attacks with Device Cookies): a signed number, that gives no right
    but to be counted by itself.
    """

    def __init__(self, key: bytes) -> None:
        """`key`: what the marks are signed with; another one makes them void."""
        self._key = key

    def mark(self) -> str:
        """Return a new browser's mark."""
        nonce = secrets.token_urlsafe(16)
        return f"{nonce}.{self._signature(nonce)}"

    def knows(self, mark: str) -> bool:
        """Return whether this is a mark of ours."""
        nonce, _, signature = mark.partition(".")
        return hmac.compare_digest(self._signature(nonce).encode(), signature.encode())

    def _signature(self, nonce: str) -> str:
        return hmac.new(self._key, b"page: known browser " + nonce.encode(), hashlib.sha256).hexdigest()


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
