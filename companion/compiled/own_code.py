"""C code that is written on this computer: compiled once, and kept in the user's cache."""

import ctypes
import hashlib
import os
from pathlib import Path

from companion.compiled.library import FLAGS, compiled

_QUICKLY = ("-O1", *FLAGS[1:])
"""Compiles in half the time, and is as fast."""
_KEPT = 32
"""Libraries that stay in the cache, the youngest."""


def own_code(source: str) -> ctypes.CDLL | str:
    """Return the library of this source; a sentence where it cannot be compiled here."""
    digest = hashlib.sha256("".join((source, *_QUICKLY)).encode()).hexdigest()[:24]
    try:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dauam-companion"
        library = folder / f"{digest}.so"
        if not library.is_file():
            folder.mkdir(parents=True, exist_ok=True)
            if trouble := _compile(source, library):
                return f"it cannot be compiled here ({trouble})"
            for old in sorted(folder.glob("*.so"), key=lambda path: path.stat().st_mtime)[:-_KEPT]:
                old.unlink(missing_ok=True)
        return ctypes.CDLL(str(library))
    except (OSError, RuntimeError) as error:  # RuntimeError: a user without a home
        return f"it cannot be compiled here ({error})"


def _compile(source: str, library: Path) -> str:
    """Compile to a name that nobody reads, then give it its own: other processes may do the same."""
    unfinished = library.with_suffix(f".{os.getpid()}.c")
    unfinished.write_text(source, encoding="utf-8")
    made = unfinished.with_suffix(".made")
    try:
        trouble = compiled(unfinished, made, _QUICKLY)
        if not trouble:
            made.replace(library)
        return trouble
    finally:
        unfinished.unlink()
        made.unlink(missing_ok=True)
