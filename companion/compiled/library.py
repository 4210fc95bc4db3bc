"""The compiled code: where it is, and whether it fits the Python that it was traced from."""

import ctypes
import hashlib
import logging
import subprocess
import sys
import sysconfig
from functools import cache
from pathlib import Path

_FOLDER = Path(__file__).parent
SOURCE = _FOLDER / "flight.c"
_SUFFIX = sysconfig.get_config_var("EXT_SUFFIX") or ".so"
LIBRARY = _FOLDER / f"_flight{_SUFFIX}"
FLAGS = ("-O2", "-ffp-contract=off", "-fno-builtin-pow", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
"""Nothing that changes a number: no contraction, no fast maths; and pow(x, 2) stays the call that Python makes."""

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
    code.sources.restype = ctypes.c_char_p
    if code.sources() != _digest().encode():
        log.warning("the compiled law is older than its source: Python flies; run python -m companion.compiled.library")
        return None
    return code


def _digest() -> str:
    """Return what tells one version of the source from another."""
    return hashlib.sha256(b"".join((_FOLDER / name).read_bytes() for name in ("flight.c", "traced.c"))).hexdigest()


def build() -> str:
    """Compile the source with the system's C compiler; return a sentence that says what became of it."""
    command = ["cc", *FLAGS, f'-DSOURCES="{_digest()}"', "-o", str(LIBRARY), str(SOURCE), "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"no compiled law, as there is no C compiler ({error}): Python flies, with the same numbers, slower"
    if done.returncode:
        why = next(iter(done.stderr.strip().splitlines()), f"exit code {done.returncode}")
        return f"no compiled law, as cc failed ({why}): Python flies, with the same numbers, slower"
    return f"the law is compiled: {LIBRARY.name}"


if __name__ == "__main__":
    sys.stdout.write(build() + "\n")
