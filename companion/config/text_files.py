"""Text files that a person wrote, with whatever editor: UTF-8, with a byte order mark or without."""

import codecs
from pathlib import Path

from companion.core.errors import ConfigError

MAX_BYTES = 1_000_000
"""Nobody writes so much by hand; what is larger is another kind of file."""
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_SAVE = "save it as UTF-8"


def read_text(path: Path) -> str:
    """Return the file's text without a byte order mark, line ends as they are; ConfigError, one sentence."""
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: there is no such file") from error
    except IsADirectoryError as error:
        raise ConfigError(f"{path}: is a folder: give the name of a file") from error
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        why = getattr(error, "strerror", None) or error
        raise ConfigError(f"{path}: cannot be read: {why}") from error
    if len(raw) > MAX_BYTES:
        raise ConfigError(f"{path}: is larger than {MAX_BYTES / 1e6:g} MB, which is too much for such a file")
    try:
        return decode(raw)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from error


def decode(raw: bytes) -> str:
    """Return the text of UTF-8 with or without a byte order mark; ValueError says what it is instead."""
    if raw.startswith(_UTF_16) or b"\0" in raw[:200]:
        raise ValueError(f"is UTF-16 or no text at all: {_SAVE}")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ValueError(f"line {line}: the byte 0x{raw[error.start]:02x} is no UTF-8: {_SAVE}") from error
