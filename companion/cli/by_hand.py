"""Carrying the vehicle by hand, move by move, while both estimates are watched."""

import asyncio
from collections.abc import Callable

import numpy as np
from rich.console import Console

from companion.preflight.by_hand import Move, Moved, Track, at_rest, is_over, judge, judge_together, moved, settled
from companion.preflight.check import Check
from companion.service_preflight import Running
from companion.types import Array

_SAMPLE_S = 0.02
_PATIENCE_S = 60.0
"""For each thing that the hand is asked to do."""
_FOLLOWS_S = 5.0
"""For the autopilot's estimate to come to rest, too."""
_BACK_M = 0.15
_BEFORE = 60
"""Samples that are kept while it still stands: the track begins at rest."""


async def carry(running: Running, console: Console) -> tuple[Check, ...]:
    """Ask for the moves, tell at once what is wrong with each; the checks, one a move and one of all together."""
    seen: dict[Move, Moved] = {}
    checks: list[Check] = []
    for move in Move:
        track = await _one_move(running, move, console)
        if track is None:
            todo = "begin again: its body must be seen, at rest at both ends, and moved as far as was asked for"
            return (*checks, Check(f"by hand: {move}", False, f"no such move within {_PATIENCE_S:g} s", todo))
        seen[move] = moved(track)
        checks.append(judge(move, seen[move]))
        _tell(console, checks[-1])
        if move is Move.LIFT:
            console.print("now put it down where it stood", highlight=False)
            await _put_down(running, track.mocap_w_m[0])
    checks.append(judge_together(seen))
    _tell(console, checks[-1])
    return tuple(checks)


def _tell(console: Console, check: Check) -> None:
    word = "[green]right[/]" if check.passed else "[red]wrong[/]"
    console.print(f"  {word}: {check.says}{f'; {check.todo}' if check.todo else ''}", highlight=False, soft_wrap=True)


async def _one_move(running: Running, move: Move, console: Console) -> Track | None:
    """From rest to rest; None when it was not done in time."""
    samples = _Samples(running)
    if not await _until(samples, lambda: at_rest(samples.track(_BEFORE))):
        return None
    console.print(f"[bold]{move.asks}[/]", highlight=False, soft_wrap=True)
    samples.keep_last(_BEFORE)
    done = await _until(samples, lambda: is_over(samples.track(), move))
    await _until(samples, lambda: settled(samples.track()), _FOLLOWS_S)  # or judge one that never rests
    return samples.track() if done else None


async def _put_down(running: Running, where_w_m: Array) -> None:
    samples = _Samples(running)

    def down() -> bool:
        track = samples.track(_BEFORE)
        return at_rest(track) and float(np.linalg.norm(track.mocap_w_m[-1] - where_w_m)) < _BACK_M

    await _until(samples, down)


class _Samples:
    """What both say, 50 times a second while motion capture sees the body."""

    def __init__(self, running: Running) -> None:
        self._running = running
        self._rows: list[Array] = []

    def take(self) -> None:
        vehicle, local = self._running.estimate().vehicle, self._running.autopilot.local()
        now_s = self._running.clock.now_s()
        if vehicle is None or now_s - vehicle.time_s > 0.2:
            return
        theirs = self._running.autopilot.status().q_w_flu_wxyz
        row = ([now_s], vehicle.position_w_m, vehicle.q_w_flu_wxyz, local.position_w_m, theirs)
        self._rows.append(np.concatenate(row))

    def keep_last(self, count: int) -> None:
        self._rows = self._rows[-count:]

    def track(self, last: int = 0) -> Track:
        """All of it, or its end."""
        rows = np.array(self._rows[-last:]).reshape(-1, 15)
        return Track(rows[:, 0], rows[:, 1:4], rows[:, 4:8], rows[:, 8:11], rows[:, 11:15])


async def _until(samples: _Samples, true: Callable[[], bool], patience_s: float = _PATIENCE_S) -> bool:
    end_s = asyncio.get_running_loop().time() + patience_s
    while not true():
        if asyncio.get_running_loop().time() > end_s:
            return False
        await asyncio.sleep(_SAMPLE_S)
        samples.take()
    return True
