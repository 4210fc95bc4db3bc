"""Opens and closes the PX4 adapter again and again, while the autopilot does its worst: nothing native may crash.

    python -m tests.adapters.px4.churn --cycles 500 [--seed 1] [--jobs 8]

Each cycle connects to a fake autopilot that is killed, silent, flooding or restarting at random instants, gives it
random commands, and leaves at another random instant, often just when MAVSDK would give an unanswered command up. The
cycles run in child processes whose freed memory is overwritten (MALLOC_PERTURB_), so that a use of it is a crash and
shows as their exit code. By hand, and a few cycles of it in the suite (test_px4_churn.py).
"""

import argparse
import asyncio
import collections
import contextlib
import faulthandler
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

from companion.adapters.px4.autopilot import Px4
from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.config.px4_config import Px4Config
from companion.control.pipeline import idle_setpoint
from companion.core.interfaces import AutopilotError
from tests.adapters.px4.fake_px4 import FakePx4

_ROOT = Path(__file__).resolve().parents[3]
_GIVEN_UP_S = 2.0
"""After so long MAVSDK gives an unanswered command of its own up."""
_AT_ONCE = 2
_MOST_S = 60.0
"""A cycle takes a few seconds."""


@dataclass(frozen=True)
class Churned:
    """Result of repeated connects and disconnects."""

    exit_codes: tuple[int, ...]
    """Exit codes of the children; negative: the signal that killed it."""
    outcomes: dict[str, int]
    """Number of times that each thing happened."""
    output: str
    """Standard error of the children that failed."""


def churn(cycles: int, seed: int, jobs: int) -> Churned:
    """Run the cycles, in `jobs` processes at a time."""
    shares = [cycles // jobs + (job < cycles % jobs) for job in range(jobs)]
    environment = {**os.environ, "MALLOC_PERTURB_": "165", "PYTHONPATH": str(_ROOT)}
    children = [
        subprocess.Popen(
            [sys.executable, "-m", "tests.adapters.px4.churn", "--child", "--cycles", str(share), "--seed", str(part)],
            cwd=_ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for part, share in enumerate(shares, jobs * seed)
        if share
    ]
    outcomes: collections.Counter[str] = collections.Counter()
    output = ""
    for child in children:
        said, errors = child.communicate()
        if child.returncode == 0:
            outcomes.update(json.loads(said.splitlines()[-1]))
        else:
            output += errors
    return Churned(tuple(child.returncode for child in children), dict(outcomes), output)


async def cycle(seed: int) -> str:
    """Open, misbehave, close; return what happened in a word."""
    chance = random.Random(seed)
    with FakePx4(answers=chance.choice([0.0, 0.5, 1.0]), seed=seed) as fake:
        patience_s = chance.uniform(0.5, 3.0)
        config = Px4Config(url=fake.url, answer_timeout_s=1.0, arm_timeout_s=1.0, connect_timeout_s=patience_s)
        trouble = asyncio.create_task(_trouble(fake, chance))
        try:
            async with asyncio.timeout(_MOST_S), open_px4(config, MonotonicClock()) as px4:
                await _use(px4, chance)
        except AutopilotError:
            return "no autopilot"
        finally:
            trouble.cancel()
            await asyncio.gather(trouble, return_exceptions=True)
    return "closed"


async def _trouble(fake: FakePx4, chance: random.Random) -> None:
    """Do something to the autopilot every now and then."""
    await asyncio.sleep(chance.uniform(0.0, 3.0))
    while True:
        await asyncio.sleep(chance.uniform(0.0, 1.0))
        what = chance.choice(["silent", "speak", "flood", "calm", "restart", "kill"])
        if what == "restart":
            await asyncio.to_thread(fake.kill)
            fake.start()
        elif what == "kill":
            await asyncio.to_thread(fake.kill)
            await asyncio.sleep(chance.uniform(0.0, 1.0))
            fake.start()
        fake.silent = {"silent": True, "speak": False}.get(what, fake.silent)
        fake.flooding = {"flood": True, "calm": False}.get(what, fake.flooding)


async def _use(px4: Px4, chance: random.Random) -> None:
    """Give commands that nobody may answer, and leave: at any time, or when MAVSDK would give one of its own up."""
    given_s = time.monotonic()
    px4.send_setpoint(idle_setpoint(0.0))
    calls: list[Callable[[], Awaitable[object]]] = [
        px4.arm,
        px4.disarm,
        px4.land,
        px4.start_offboard,
        px4.kill,
        lambda: px4.params(["MPC_THR_HOVER"]),
    ]
    pending = [asyncio.ensure_future(call()) for call in chance.sample(calls, chance.randrange(0, 4))]
    stay_s = chance.choice([chance.uniform(0.0, 2.5), chance.uniform(_GIVEN_UP_S - 0.02, _GIVEN_UP_S + 0.04)])
    if chance.random() < 0.5:
        await asyncio.sleep(chance.uniform(0.0, stay_s))
        for task in pending:
            task.cancel()
    if chance.random() < 0.3:
        px4.stop_stream()
    await asyncio.sleep(max(0.0, given_s + stay_s - time.monotonic()))
    for task in pending:
        task.cancel()
    await asyncio.gather(*pending, return_exceptions=True)


async def _some(seeds: list[int]) -> dict[str, int]:
    """Run a few cycles at a time, as they mostly wait."""
    outcomes: collections.Counter[str] = collections.Counter()

    async def work() -> None:
        while seeds:
            outcomes[await cycle(seeds.pop())] += 1

    await asyncio.gather(*(work() for _ in range(_AT_ONCE)))
    return dict(outcomes)


def _destroy_slowly(seconds: float) -> None:
    """Make the time between two plugins' destruction long: on a busy computer it is."""
    from mavsdk.plugins.mocap import Mocap

    destroy = Mocap.destroy

    def slowly(self: Mocap) -> None:
        if self._handle:
            time.sleep(seconds)
        destroy(self)

    Mocap.destroy = slowly


def main() -> None:
    """Run the cycles and say what became of them; exit code 1 when a process crashed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cycles", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=8)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        faulthandler.enable()
        _destroy_slowly(0.03)
        seeds = [1000 * given.seed + number for number in range(given.cycles)]
        print(json.dumps(asyncio.run(_some(seeds))))
        return
    begun_s = time.monotonic()
    done = churn(given.cycles, given.seed, given.jobs)
    with contextlib.suppress(BrokenPipeError):
        print(done.output, end="")
        print(f"{given.cycles} cycles in {time.monotonic() - begun_s:.0f} s: {done.outcomes}")
        print(f"exit codes of {len(done.exit_codes)} processes: {sorted(set(done.exit_codes))}")
    sys.exit(any(done.exit_codes))


if __name__ == "__main__":
    main()
