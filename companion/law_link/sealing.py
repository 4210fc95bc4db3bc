"""Authentication of the law's link: a truncated keyed BLAKE2 tag behind each message (RFC 7693). Pure.

Nothing is encrypted: what a vehicle is told to do may be seen, but not forged, changed or played again.
"""

import hmac
from dataclasses import dataclass
from hashlib import blake2s

TAG_BYTES = 8
"""Length of a message's tag: a forger has to send 2^63 messages on average, one at a time."""
LEAST_KEY_BYTES = 16
MOST_KEY_BYTES = 1024


@dataclass(frozen=True)
class Seal:
    """Key of one direction of one session, or of the hellos before it."""

    key: bytes

    def sealed(self, data: bytes) -> bytes:
        """Return a message with its tag."""
        return data + self._tag(data)

    def opened(self, datagram: bytes) -> bytes | None:
        """Return the message without its tag; None if the tag is not that of this key."""
        data, tag = datagram[:-TAG_BYTES], datagram[-TAG_BYTES:]
        return data if data and hmac.compare_digest(tag, self._tag(data)) else None

    def _tag(self, data: bytes) -> bytes:
        return blake2s(data, key=self.key, digest_size=TAG_BYTES).digest()


@dataclass(frozen=True)
class SessionKeys:
    """Seals of the two directions: a message up never passes for one down."""

    up: Seal
    down: Seal


def hello_seal(secret: bytes) -> Seal:
    """Return the seal of hellos and their replies."""
    return Seal(blake2s(secret, person=b"law.hi").digest())


def session_keys(secret: bytes, ground_nonce: bytes, vehicle_nonce: bytes) -> SessionKeys:
    """Return a session's seals: other nonces, other keys, so that no earlier session's messages pass."""

    def of(direction: bytes) -> Seal:
        return Seal(blake2s(secret + ground_nonce + vehicle_nonce, person=direction).digest())

    return SessionKeys(of(b"law.up"), of(b"law.down"))
