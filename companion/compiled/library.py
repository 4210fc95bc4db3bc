"""The compiled code: where it is, and whether it fits the Python that it was traced from."""

import ctypes
import hashlib
import logging
import platform
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from companion.core.types import Array

_FOLDER = Path(__file__).parent
SOURCE, BATCH = _FOLDER / "flight.c", _FOLDER / "batch.c"
MACHINE = platform.machine()
FLAGS = ("-O2", "-ffp-contract=off", "-fno-builtin-pow", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
"""Nothing that changes a number: no contraction, no fast maths; and pow(x, 2) stays the call that Python makes."""

WIDTHS = {8: ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mfma", "-Wno-psabi"), 4: ("-mavx2", "-mfma", "-Wno-psabi")}
"""Vehicles side by side, and the instructions that it takes; `lanes` of flight.c says which this computer has."""

log = logging.getLogger(__name__)


def library_path(folder: Path = _FOLDER, machine: str = MACHINE, width: int | None = None) -> Path:
    """Return where a machine's code is, of one vehicle or of so many side by side."""
    return folder / f"_flight{width or ''}-{machine}.so"


LIBRARY = library_path()


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
            batch = ctypes.CDLL(str(library_path(width=width)))
        except OSError:
            continue
        if not _is_old(batch):
            return batch
    return None


def _is_old(code: ctypes.CDLL) -> bool:
    code.sources.restype = ctypes.c_char_p
    return bool(code.sources() != _digest(_FOLDER).encode())


@cache
def quick_library() -> ctypes.PyDLL | None:
    """Return the compiled code for calls of a microsecond, which do not give the interpreter to another thread."""
    return None if library() is None else ctypes.PyDLL(str(LIBRARY))


def pointers(vectors: Sequence[Array]) -> "ctypes.Array[ctypes.c_void_p]":
    """Return the addresses of vectors as one argument; the vectors must be kept, and stay where they are."""
    return (ctypes.c_void_p * len(vectors))(*(vector.ctypes.data for vector in vectors))


def _digest(folder: Path) -> str:
    """Return what tells one version of the source from another."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(folder.glob("*.[ch]")))).hexdigest()


def build(folder: Path = _FOLDER, machine: str = MACHINE, compiler: str = "cc") -> str:
    """Compile the source in a folder for a machine; return a sentence that says what became of it."""
    flags = (*FLAGS, f'-DSOURCES="{_digest(folder)}"')
    made = library_path(folder, machine)
    trouble = compiled(folder / SOURCE.name, made, flags, compiler)
    if trouble:
        return f"no compiled law, as {trouble}: Python flies, with the same numbers, slower"
    widths = WIDTHS if machine == "x86_64" else {}
    failed = {
        width: compiled(
            folder / BATCH.name,
            library_path(folder, machine, width),
            (*flags, f"-DWIDTH={width}", *widths[width]),
            compiler,
        )
        for width in widths
    }
    built = [str(width) for width, why in failed.items() if not why]
    wide = f", and for {' or '.join(built)} vehicles side by side" if built else ""
    return f"the law is compiled{wide}: {made.name}"


def compiled(source: Path, to: Path, flags: Sequence[str], compiler: str = "cc") -> str:
    """Compile one file with a C compiler, the system's by default; return what went wrong, or nothing."""
    command = [compiler, *flags, "-o", str(to), str(source), "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"there is no C compiler ({error})"
    if done.returncode:
        return f"{compiler} failed ({next(iter(done.stderr.strip().splitlines()), f'exit code {done.returncode}')})"
    return ""


if __name__ == "__main__":
    sys.stdout.write(build() + "\n")
