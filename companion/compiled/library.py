"""The compiled code: where it is, and whether it fits the Python that it was traced from."""

import ctypes
import hashlib
import logging
import platform
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from companion.core.types import Array

_FOLDER = Path(__file__).parent
SOURCE, BATCH = _FOLDER / "flight.c", _FOLDER / "batch.c"
_SUFFIX = sysconfig.get_config_var("EXT_SUFFIX") or ".so"
LIBRARY = _FOLDER / f"_flight{_SUFFIX}"
FLAGS = ("-O2", "-ffp-contract=off", "-fno-builtin-pow", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
"""Nothing that changes a number: no contraction, no fast maths; and pow(x, 2) stays the call that Python makes."""

WIDTHS = {8: ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mfma", "-Wno-psabi"), 4: ("-mavx2", "-mfma", "-Wno-psabi")}
"""Vehicles side by side, and the instructions that it takes; `lanes` of flight.c says which this computer has."""

log = logging.getLogger(__name__)


@cache
def library() -> ctypes.CDLL | None:
    """Return the compiled code; None where it was not built, and everything flies in Python."""
    if not LIBRARY.is_file():
        log.info("no compiled law (%s): Python flies, with the same numbers, slower", LIBRARY.name)
        return None
    try:
        code = ctypes.CDLL(str(LIBRARY))
    except OSError as error:
        log.warning("the compiled law cannot be loaded (%s): Python flies, with the same numbers, slower", error)
        return None
    if _is_old(code):
        log.warning("the compiled law is older than its source: Python flies; run python -m companion.compiled.library")
        return None
    return code


@cache
def side_by_side() -> ctypes.CDLL | None:
    """Return the code for several vehicles at once; None where one after another has to do, with the same numbers."""
    code = library()
    if code is None:
        return None
    for width in (width for width in WIDTHS if width <= code.lanes()):
        try:
            batch = ctypes.CDLL(str(batch_path(width)))
        except OSError:
            continue
        if not _is_old(batch):
            return batch
    return None


def batch_path(width: int) -> Path:
    """Return where the code for so many vehicles side by side is."""
    return _FOLDER / f"_flight{width}{_SUFFIX}"


def _is_old(code: ctypes.CDLL) -> bool:
    code.sources.restype = ctypes.c_char_p
    return bool(code.sources() != _digest().encode())


@cache
def quick_library() -> ctypes.PyDLL | None:
    """Return the compiled code for calls of a microsecond, which do not give the interpreter to another thread."""
    return None if library() is None else ctypes.PyDLL(str(LIBRARY))


def pointers(vectors: Sequence[Array]) -> "ctypes.Array[ctypes.c_void_p]":
    """Return the addresses of vectors as one argument; the vectors must be kept, and stay where they are."""
    return (ctypes.c_void_p * len(vectors))(*(vector.ctypes.data for vector in vectors))


def _digest() -> str:
    """Return what tells one version of the source from another."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(_FOLDER.glob("*.[ch]")))).hexdigest()


def build() -> str:
    """Compile the source with the system's C compiler; return a sentence that says what became of it."""
    flags = (*FLAGS, f'-DSOURCES="{_digest()}"')
    trouble = compiled(SOURCE, LIBRARY, flags)
    if trouble:
        return f"no compiled law, as {trouble}: Python flies, with the same numbers, slower"
    widths = WIDTHS if platform.machine() == "x86_64" else {}
    failed = {
        width: compiled(BATCH, batch_path(width), (*flags, f"-DWIDTH={width}", *widths[width])) for width in widths
    }
    built = [str(width) for width, why in failed.items() if not why]
    wide = f", and for {' or '.join(built)} vehicles side by side" if built else ""
    return f"the law is compiled{wide}: {LIBRARY.name}"


def compiled(source: Path, to: Path, flags: Sequence[str]) -> str:
    """Compile one file with the system's C compiler; return what went wrong, or nothing."""
    command = ["cc", *flags, "-o", str(to), str(source), "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"there is no C compiler ({error})"
    if done.returncode:
        return f"cc failed ({next(iter(done.stderr.strip().splitlines()), f'exit code {done.returncode}')})"
    return ""


if __name__ == "__main__":
    sys.stdout.write(build() + "\n")
