"""All tests, several processes side by side: `python -m tests [OPTIONS] [ARGUMENTS OF PYTEST]`.

One runs what is bound to the wall clock: flights, one after the other, and then links to devices that mostly wait, two
at a time. The others run the rest at the lowest priority, in the time that those leave: on two cores no vehicle falls
because another one is being simulated. One of them runs the tests of what keeps the vehicle safe, and says which of its
lines and branches no test has reached.
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
from tests.conftest import ALONE, runs_alone

_NO_TESTS = 5
"""pytest's exit code where nothing was selected."""
_LAST = 19
"""Nice value of what has no clock, and runs beside what has one."""
_TWO = ("-n", "2", "--dist", "loadfile")
"""Two processes, which mostly wait."""
_EVERY_CORE = ("-n", str(os.cpu_count() or 1), "--dist", "loadfile", "--no-loadscope-reorder")
"""A process for each core; a file of tests in one of them: it shares its flights."""
_COLLECT = (sys.executable, "-m", "pytest", "-qq", "--collect-only", "-p", "no:cacheprovider")
"""Makes pytest rewrite and keep every module of tests once, before several processes would do it at the same time."""
_COVERAGE = ("-m", "coverage")
_FLIGHTS, _LINKS, _SIMULATED = "realtime and flight", "realtime and not flight", "not realtime"
_COVERED = ("tests/supervisor", "tests/guard")
"""Run by themselves when all tests are run: they must reach all that pyproject.toml names under coverage."""


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
    began_s, before = time.monotonic(), _cpu_ticks()
    covered = () if rest or only else _COVERED
    # pytest keeps the modules that it has rewritten, where it may: the processes that follow find them ready.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    flights = subprocess.Popen(_pytest(_FLIGHTS, only, folder, [*rest, *_under(rest, list(ALONE))]))
    beside: list[_Beside] = []
    try:
        collecting = _begin([*_COLLECT, *rest], subprocess.DEVNULL)
        if covered:  # by itself while it runs, so that the first flights have one of two cores to themselves
            beside.append(_Beside(_under_coverage(folder)))
            beside[0].wait()
        collecting.wait()
        others = [f"--ignore={path}" for path in covered]
        beside.append(_Beside(_pytest(_SIMULATED, only, folder, [*_EVERY_CORE, *rest, *others])))
        codes = {flights.wait()}
        links = _pytest(_LINKS, only, folder, [*_TWO, *rest, *_under(rest, _with_links())])
        codes.add(subprocess.run(links, check=False).returncode)
        print("waiting for the tests in simulated time ...", flush=True)
        codes |= {process.wait() for process in beside}
    finally:
        flights.terminate()
        flights.wait()
        for process in beside:
            process.end()
    if covered:
        codes.add(_report_coverage(folder))
    _print_load(before, _cpu_ticks())
    _summarise(list(folder.glob("*.xml")), time.monotonic() - began_s)
    codes = {code for code in codes if code != _NO_TESTS} or {_NO_TESTS}
    return next((code for code in codes if code), 0)


def _with_links() -> list[str]:
    """Return the files with tests of links, in real time and no flights, so that no other is imported to look."""
    files = (path for path in sorted(Path("tests").rglob("test_*.py")) if not runs_alone(path.as_posix()))
    return [str(path) for path in files if "realtime" in path.read_text(encoding="utf-8")]


def _under(rest: list[str], paths: list[str]) -> list[str]:
    """Return these paths, or none where the arguments of pytest name their own."""
    return [] if any(Path(word.split("::")[0]).exists() for word in rest) else paths


class _Beside:
    """A run of pytest whose output is shown when it has ended."""

    def __init__(self, command: list[str]) -> None:
        self._output = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - closed by end()
        self._process = _begin(command, self._output)

    def wait(self) -> int:
        """Return its exit code."""
        return self._process.wait()

    def end(self) -> None:
        """End it where it still runs, and print all that it said."""
        self._process.terminate()
        self._process.wait()
        with self._output:
            self._output.seek(0)
            sys.stdout.write(self._output.read())
            sys.stdout.flush()


def _begin(command: list[str], output: IO[str] | int) -> "subprocess.Popen[bytes]":
    """Begin a command as a session of the lowest priority.

    Where Linux groups processes by session, nice counts within one. Mocks and services of the flights are
    sessions of their own, and would wait for the others' turn like any.
    """
    whole = ["nice", "-n", str(_LAST), *command]
    process = subprocess.Popen(whole, stdout=output, stderr=output, start_new_session=True)
    group = Path(f"/proc/{process.pid}/autogroup")
    if group.exists():
        group.write_text(str(_LAST), encoding="ascii")
    return process


def _under_coverage(folder: Path) -> list[str]:
    interpreter, *run = _pytest(_SIMULATED, "", folder, list(_COVERED), "covered")
    return [interpreter, *_COVERAGE, "run", f"--data-file={folder / 'coverage'}", *run]


def _report_coverage(folder: Path) -> int:
    """Print which lines were not reached; return 0 when there are none."""
    report = [sys.executable, *_COVERAGE, "report", f"--data-file={folder / 'coverage'}"]
    return subprocess.run(report, check=False).returncode


def _pytest(which: str, only: str, folder: Path, rest: list[str], name: str = "") -> list[str]:
    name = name or which.replace(" ", "-")
    results = ["-o", f"cache_dir=.pytest_cache/{name}", f"--junitxml={folder / name}.xml", "--durations=10"]
    return [sys.executable, "-m", "pytest", "-q", "-m", which + only, *results, *rest]


def _summarise(results: list[Path], took_s: float) -> None:
    """Print how many tests were skipped for want of which packages, and one closing line for all."""
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
    print(f"all tests together took {took_s / 60.0:.1f} minutes")
    print(f"{count['passed']} passed, {count['failed']} failed, {count['skipped']} skipped", flush=True)


def _cpu_ticks() -> list[int]:
    """Return the computer's CPU times since it started, in the order of proc(5); nothing where it has none."""
    stat = Path("/proc/stat")
    return [int(word) for word in stat.read_text(encoding="ascii").split("\n")[0].split()[1:9]] if stat.exists() else []


def _print_load(before: list[int], after: list[int]) -> None:
    """Print how busy the computer was, as a flight in real time fails where its host takes the processor away."""
    spent = [late - early for early, late in zip(before, after, strict=True)]
    if sum(spent):
        idle, stolen = (sum(part) / sum(spent) for part in (spent[3:5], spent[7:8]))
        print(f"{os.cpu_count()} processors were busy for {1.0 - idle:.0%}, and {stolen:.1%} was taken by their host")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
