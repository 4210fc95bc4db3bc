"""Effect of moving arms and of feed-forward on a flight: demo flights in real time, over the real protocols.

python -m benchmarks.arms_cost              # writes benchmarks/ARMS.md; about a quarter of an hour
python -m benchmarks.arms_cost --seeds 1    # one seed only
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from benchmarks.machine import this_machine
from companion.config.locations import project_root

OUT = Path(__file__).parent / "ARMS.md"


@dataclass(frozen=True)
class Case:
    """One row of the table."""

    name: str
    arguments: tuple[str, ...]


CASES = tuple(
    Case(f"{controller}, {name}", ("--controller", controller, *arguments))
    for controller in ("etnn", "pid")
    for name, arguments in (
        ("arms stowed", ("--arms", "off")),
        ("arms swinging, feed-forward off", ("--feedforward", "off")),
        ("arms swinging, reaction force told", ("--feedforward", "force")),
        ("arms swinging, force and tilt told", ("--feedforward", "full")),
    )
)


def main() -> int:
    """Fly every case with every seed; 0 when all flights landed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--laps", type=int, default=2)
    options = parser.parse_args()
    rows, number = [], 0
    for case in CASES:
        flown = []
        for seed in options.seeds:
            number += 1
            print(f"flight {number} of {len(CASES) * len(options.seeds)}: {case.name}, seed {seed}", flush=True)
            flown.append(_fly(case, seed, options.laps))
        rows.append(_row(case, flown))
        print(rows[-1], flush=True)
    OUT.write_text(_page(rows, options.seeds, options.laps), encoding="utf-8")
    print(f"written to {OUT}")
    return 0


def _fly(case: Case, seed: int, laps: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / "summary.json"
        companion = [sys.executable, "-m", "companion.cli.main", "demo", "--free-ports", "--out", folder]
        flight = ["--seed", str(seed), "--laps", str(laps), "--summary", str(summary), *case.arguments]
        ended = subprocess.run([*companion, *flight], cwd=project_root(), capture_output=True, text=True, check=False)
        data: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8")) if summary.exists() else {}
        if not data.get("landed"):
            raise SystemExit(f"{case.name}, seed {seed} did not land:\n{ended.stdout}{ended.stderr}")
        return data


def _row(case: Case, flown: list[dict[str, Any]]) -> str:
    mean = [fmean(flight["mean_error_m"][axis] for flight in flown) for axis in range(3)]
    most = [max(flight["max_error_m"][axis] for flight in flown) for axis in range(3)]
    errors = " | ".join(f"{a:.3f} ({b:.3f})" for a, b in zip(mean, most, strict=True))
    updates = fmean(flight["update_share"] for flight in flown)
    late = max(flight["tick_late_ms"]["p99"] for flight in flown)
    return f"| {case.name} | {errors} | {updates:.1%} | {late:.2f} |"


def _page(rows: list[str], seeds: list[int], laps: int) -> str:
    machine = this_machine()
    return "\n".join(
        [
            "# What moving arms cost, and what feed-forward saves",
            "",
            f"`python -m benchmarks.arms_cost`, {machine.date}, {machine.cpu}, {machine.cores} cores.",
            "Demo flights in real time over MAVSDK, qtm-rt and dynamixel-sdk:",
            f"{laps} laps of the ellipse, seeds {', '.join(map(str, seeds))}, arms as in `config/arms/swing.toml`.",
            "Mean over the seeds, and in brackets the largest, of the absolute error per axis in metres, as motion",
            "capture sees it; the 99th percentile of how late a tick began, in ms.",
            "",
            "| flight | x | y | z | updates | tick late |",
            "| --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
            "The companion knows the vehicle's inertia, the arms' masses and the autopilot's integrator exactly as the",
            "mock has them; what is left with an inertia that is 30 % wrong: docs/arms.md.",
            "",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
