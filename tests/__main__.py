"""All tests: `python -m tests [ARGUMENTS OF PYTEST]`, in two processes side by side.

One has what runs against the wall clock, one test after the other; the other has all else and only gets the time that
the first leaves, so that on two cores no vehicle falls because another one is being simulated.
"""

import subprocess
import sys
import tempfile
from typing import IO

_NO_TESTS = 5
"""pytest's exit code where nothing was selected."""
_LEAST = ("nice", "-n", "19")


def _pytest(which: str, arguments: list[str]) -> list[str]:
    return [
        sys.executable,
        "-m",
        "pytest",
        "-m",
        which,
        "-o",
        f"cache_dir=.pytest_cache/{which.split(maxsplit=1)[0]}",
        *arguments,
    ]


def main(arguments: list[str]) -> int:
    """Exit code 0 when all passed, otherwise pytest's."""
    with tempfile.TemporaryFile("w+", encoding="utf-8") as said:
        simulated = subprocess.Popen([*_LEAST, *_pytest("not realtime", arguments)], stdout=said, stderr=said)
        real = subprocess.run(_pytest("realtime", arguments), check=False).returncode
        print("waiting for the tests in simulated time ...", flush=True)
        codes = {real, simulated.wait()}
        _show(said)
    codes = {code for code in codes if code != _NO_TESTS} or {_NO_TESTS}
    return max(codes)


def _show(said: IO[str]) -> None:
    said.seek(0)
    sys.stdout.write(said.read())
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
