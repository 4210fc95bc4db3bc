"""Password of the page: its hash in a file, as `companion page-password` writes it."""

import base64
import hashlib
import hmac
import os
import re
import secrets
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from companion.config.operator_config import secret_in, usable_secret
from companion.core.errors import ConfigError

LEAST_CHARACTERS = 8
MOST_BYTES = 256
"""Longest password, UTF-8."""
_N, _R, _P = 2**14, 8, 5
"""Cost of scrypt: 16 MB and about 0.2 s, as strong as OWASP's smallest choice (Password Storage Cheat Sheet, 2024)."""
_FORM = re.compile(r"scrypt:(\d{1,7}):(\d{1,2}):(\d{1,2}):([A-Za-z0-9+/=]{16,64}):([A-Za-z0-9+/=]{40,100})")
_MOST_FILE_BYTES = 512
_MEMORY = 64 * 2**20


@dataclass(frozen=True)
class PasswordHash:
    """Salted scrypt hash (RFC 7914) of the password."""

    n: int
    r: int
    p: int
    salt: bytes
    digest: bytes

    @classmethod
    def of(cls, password: str) -> Self:
        """Return the hash of a password with a new salt; takes 0.2 s."""
        empty = cls(_N, _R, _P, secrets.token_bytes(16), b"")
        return replace(empty, digest=empty.digest_of(password))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the file; ConfigError when others may read it, or it holds no such hash."""
        where, remedy = f"the page's password {path}", f"write it with `companion page-password {path}`"
        try:
            usable_secret(str(path))
        except ValueError as error:
            raise ConfigError(f"{where}: {error}{'' if 'chmod' in str(error) else f': {remedy}'}") from error
        found = _FORM.fullmatch(secret_in(str(path), where, _MOST_FILE_BYTES, "the hash of a password"))
        if found is None:
            raise ConfigError(f"{where}: does not hold the hash of a password: {remedy}")
        n, r, p = (int(found[group]) for group in (1, 2, 3))
        try:
            one = cls(n, r, p, base64.b64decode(found[4], validate=True), base64.b64decode(found[5], validate=True))
            one.matches("")
        except ValueError as error:
            raise ConfigError(f"{where}: does not hold the hash of a password ({error}): {remedy}") from error
        return one

    def write(self, path: Path) -> None:
        """Write the file, for its owner alone, in place of one that is there; raises OSError."""
        salt, digest = (base64.b64encode(one).decode() for one in (self.salt, self.digest))
        new = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
            file.write(f"scrypt:{self.n}:{self.r}:{self.p}:{salt}:{digest}\n")
        new.replace(path)

    def matches(self, password: str) -> bool:
        """Return whether this is the password; takes 0.2 s."""
        return hmac.compare_digest(self.digest, self.digest_of(password))

    def digest_of(self, password: str) -> bytes:
        """Return the hash of a password with this salt and cost."""
        cost = {"n": self.n, "r": self.r, "p": self.p}
        return hashlib.scrypt(password.encode(), salt=self.salt, **cost, maxmem=_MEMORY, dklen=32)


def objection_to(password: str) -> str:
    """Return why a password is not taken; empty when it is."""
    if len(password) < LEAST_CHARACTERS:
        return f"a password has at least {LEAST_CHARACTERS} characters"
    if len(password.encode()) > MOST_BYTES:
        return f"a password has at most {MOST_BYTES} bytes"
    return ""
