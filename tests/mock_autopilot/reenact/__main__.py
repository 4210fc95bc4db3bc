"""Re-enact recorded sessions on the mock: `python -m tests.mock_autopilot.reenact FILE.tlog[.gz]...`.

A .gcs. log beside an .onboard. one is read with it. Exit code 1 when an event differs.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.mock_autopilot.reenact.capture import capture, session_name
from tests.mock_autopilot.reenact.compare import compare, table
from tests.mock_autopilot.reenact.known import SAVED
from tests.mock_autopilot.reenact.player import play
from tests.mock_autopilot.reenact.session import Session, load, save
from tests.mock_autopilot.reenact.shorten import FOR_A_FILE, shortened
from tests.mock_autopilot.reenact.tlog import TlogError


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a table for each session."""
    parser = argparse.ArgumentParser(prog="python -m tests.mock_autopilot.reenact", description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="telemetry logs, or captures of them")
    parser.add_argument("--differences", action="store_true", help="print only what differs")
    parser.add_argument("--save", type=Path, metavar="FOLDER", help="write a small capture of each, too")
    chosen = parser.parse_args(arguments)
    try:
        sessions = [read_session(paths) for paths in grouped(chosen.files)]
    except TlogError as error:
        print(error, file=sys.stderr)
        return 2
    differing = 0
    for session in sessions:
        if chosen.save is not None:
            save(shortened(session, FOR_A_FILE), chosen.save / f"{session.name}{SAVED}")
        differing += report(session, chosen.differences)
    return 1 if differing else 0


def grouped(files: Sequence[Path]) -> list[list[Path]]:
    """Put the logs of one session together; a ground station's log is found beside the other one."""
    groups: dict[str, list[Path]] = {}
    for path in files:
        beside = path.with_name(path.name.replace(".onboard.", ".gcs."))
        found = [path, *([beside] if beside != path and beside.exists() else [])]
        group = groups.setdefault(session_name(path), [])
        group += [one for one in found if one not in group]
    return list(groups.values())


def read_session(paths: Sequence[Path]) -> Session:
    """Read a capture, or make one of the logs."""
    return load(paths[0]) if paths[0].name.endswith(SAVED) else capture(paths)


def report(session: Session, only_differences: bool) -> int:
    """Re-enact one session and print it; return how many events differ."""
    rows = compare(session.events, play(session))
    different = [row for row in rows if row.differs]
    print(f"\n{session.name}: {len(rows)} events, {len(different)} differ")
    for words in session.inferred:
        print(f"not in any log, concluded: {words}")
    print(table(different if only_differences else rows))
    return len(different)


if __name__ == "__main__":
    sys.exit(main())
