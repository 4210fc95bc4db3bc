"""`python -m benchmarks.link`: ages and bytes of the law's messages by transport and link, over Linux' own network.

Each end is a process in a network namespace of its own (root, or user namespaces); the packets between them pass the
impairment of `mock_autopilot.impairment`. TCP is the kernel's own, with its own retransmissions. --results collects
runs in a file, so that they can be made in pieces; without --link it prints the table of that file.
"""

import argparse
import asyncio
import json
import platform
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.link.namespace import CONGESTION_CONTROL, NamespaceError
from benchmarks.link.run import measure
from benchmarks.link.summary import Figures
from benchmarks.link.transports import TRANSPORTS, missing

LINKS = (
    "delay 2 ms",
    "loss 10% delay 2 ms",
    "loss 30% delay 2 ms",
    "delay 2 ms jitter 5 ms",
    "delay 2 ms jitter 20 ms",
    "delay 2 ms jitter 50 ms",
    "loss 10% delay 2 ms jitter 20 ms",
    "loss 10% burst 100 ms delay 2 ms",
    "loss 30% burst 100 ms delay 2 ms",
    "loss 10% burst 300 ms delay 2 ms",
    "reorder 10% delay 2 ms",
)
"""Links that are compared."""
_HEAD = (
    "| link | transport | age median, ms | p99 | longest | newest held median, ms | p99 | longest | lost | up, B/s | "
    "down, B/s |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
)


def main() -> int:
    """Measure, or print the table; 2 with one sentence when nothing can be measured."""
    options = _parser().parse_args()
    results = _read(options.results)
    if options.link:
        able = [name for name in TRANSPORTS if not missing(name)]
        for name in TRANSPORTS:
            if missing(name):
                print(f"{name}: left out, {missing(name)}", file=sys.stderr)
        try:
            for link in LINKS if options.link == ["all"] else options.link:
                results += asyncio.run(measure(link, able, options.for_s, options.seed))
                if options.results is not None:
                    told = json.dumps([one.as_dict() for one in results], indent=1)
                    options.results.write_text(told, encoding="utf-8")
                print(f"{link}: done", file=sys.stderr)
        except (NamespaceError, ValueError) as error:
            print(f"benchmarks.link: {error}", file=sys.stderr)
            return 2
    print(table(results))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.link", description=__doc__)
    parser.add_argument(
        "--link", action="append", default=[], help='such as "loss 10%% delay 2 ms"; "all": the table\'s'
    )
    parser.add_argument("--for", dest="for_s", type=float, default=60.0, help="s of messages for each link")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--results", type=Path, help="JSON file that the figures are added to")
    return parser


def _read(path: Path | None) -> list[Figures]:
    if path is None or not path.exists():
        return []
    return [Figures(**one) for one in json.loads(path.read_text(encoding="utf-8"))]


def table(results: Sequence[Figures]) -> str:
    """Return the figures as a table in Markdown."""
    rows = [
        f"| {one.link} | {one.transport} | {one.age_median_ms:.1f} | {one.age_p99_ms:.0f} | {one.age_longest_ms:.0f} | "
        f"{one.held_median_ms:.0f} | {one.held_p99_ms:.0f} | {one.held_longest_ms:.0f} | {one.lost / one.sent:.1%} | "
        f"{one.wire_up_bytes_per_s:.0f} | {one.wire_down_bytes_per_s:.0f} |"
        for one in results
    ]
    return "\n".join([f"Linux {platform.release()}, {CONGESTION_CONTROL}", "", _HEAD, *rows])


if __name__ == "__main__":
    sys.exit(main())
