"""All tests in two processes side by side: `python -m tests [OPTIONS] [ARGUMENTS OF PYTEST]`.

One process runs what is bound to the wall clock, one test after the other. The other runs the rest at the lowest
priority, in the time that the first leaves: on two cores no vehicle falls because another one is being simulated.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import IO
from xml.etree import ElementTree

from tests import packages

_NO_TESTS = 5
"""pytest's exit code where nothing was selected."""
_LOWEST_PRIORITY = ("nice", "-n", "19")
_HALVES = ("realtime", "not realtime")


def main(arguments: list[str]) -> int:
    """Return 0 when all tests passed, otherwise pytest's exit code; 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m tests", description=__doc__, allow_abbrev=False)
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument("--without-packages", action="store_true", help="run as if no Debian package were installed")
    choice.add_argument("--only-packages", action="store_true", help="run only the tests that need Debian packages")
    options, rest = parser.parse_known_args(arguments)
    if options.without_packages:
        os.environ[packages.HIDE] = "1"
    else:
        packages.install_missing()
    only = " and needs" if options.only_packages else ""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return _run(Path(folder), only, rest)
        except KeyboardInterrupt:
            print("interrupted: the tests were ended", flush=True)
            return 130


def _run(folder: Path, only: str, rest: list[str]) -> int:
    began_s = time.monotonic()
    clock, simulated = (_pytest(half + only, folder, rest) for half in _HALVES)
    with tempfile.TemporaryFile("w+", encoding="utf-8") as output:
        other = subprocess.Popen([*_LOWEST_PRIORITY, *simulated], stdout=output, stderr=output)
        try:
            first = subprocess.run(clock, check=False).returncode
            print("waiting for the tests in simulated time ...", flush=True)
            codes = {first, other.wait()}
        finally:
            other.terminate()
            other.wait()
            _show(output)
    _summarise(list(folder.glob("*.xml")), time.monotonic() - began_s)
    codes = {code for code in codes if code != _NO_TESTS} or {_NO_TESTS}
    return next((code for code in codes if code), 0)


def _pytest(which: str, folder: Path, rest: list[str]) -> list[str]:
    name = which.replace(" ", "-")
    results = ["-o", f"cache_dir=.pytest_cache/{name}", f"--junitxml={folder / name}.xml"]
    return [sys.executable, "-m", "pytest", "-q", "-m", which, *results, *rest]


def _show(output: IO[str]) -> None:
    output.seek(0)
    sys.stdout.write(output.read())
    sys.stdout.flush()


def _summarise(results: list[Path], took_s: float) -> None:
    """Print how many tests were skipped for want of which packages, and one closing line for both halves."""
    count: Counter[str] = Counter()
    wanting: Counter[str] = Counter()
    for case in (case for path in results for case in ElementTree.parse(path).iter("testcase")):
        outcome = next((child for child in case if child.tag in {"failure", "error", "skipped"}), None)
        count["passed" if outcome is None else "skipped" if outcome.tag == "skipped" else "failed"] += 1
        reason = "" if outcome is None else outcome.get("message", "")
        if reason.startswith(packages.SKIPPED):
            wanting.update(reason.removeprefix(packages.SKIPPED).split())
    if wanting:
        each = ", ".join(f"{tests} for want of {package}" for package, tests in sorted(wanting.items()))
        print(f"skipped: {each}")
        print(f"to run them, too: sudo apt-get install {' '.join(sorted(wanting))}   (Debian, Ubuntu)")
    print(f"both halves together took {took_s / 60.0:.1f} minutes")
    print(f"{count['passed']} passed, {count['failed']} failed, {count['skipped']} skipped", flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
