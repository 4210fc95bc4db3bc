"""The hand test: the vehicle is carried move by move while both estimates are compared."""

import asyncio
import math
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.text import Text

from companion.cli.terminal import show_cursor
from companion.core.types import Array
from companion.preflight.checks.check import Check
from companion.preflight.checks.hand_test import (
    Displacement,
    Move,
    Track,
    at_rest,
    is_over,
    judge,
    judge_together,
    moved,
    settled,
)
from companion.preflight.service_facts import Running

_SAMPLE_S = 0.02
_PATIENCE_S = 60.0
"""Time limit of each move."""
_FOLLOWS_S = 5.0
"""Time for the autopilot's estimate to come to rest."""
_TELL_S = 0.5
_BACK_M = 0.15
_BEFORE = 60
"""Samples kept before a move: the track begins at rest."""


async def carry(running: Running, console: Console) -> tuple[Check, ...]:
    """Ask for each move and print its result; return one check for each move and one for all together."""
    seen: dict[Move, Displacement] = {}
    checks: list[Check] = []
    for move in Move:
        track = await _one_move(running, move, console)
        if isinstance(track, str):
            todo = "begin again: its body must be seen, at rest at both ends, and moved as far as requested"
            says = f"no such move within {_PATIENCE_S:g} s: {track}"
            return (*checks, Check(f"by hand: {move}", False, says, todo))
        seen[move] = moved(track)
        checks.append(judge(move, seen[move]))
        _print(console, checks[-1])
        if move is Move.LIFT:
            console.print("now put it down where it stood", highlight=False)
            await _put_down(running, track.mocap_w_m[0], console)
    checks.append(judge_together(seen))
    _print(console, checks[-1])
    return tuple(checks)


def _print(console: Console, check: Check) -> None:
    word, style = ("ok", "green") if check.passed else ("wrong", "red")
    text = f": {check.says}" if check.passed else f": {check.says}; {check.todo}"
    console.print(Text.assemble("  ", (word, style), text), soft_wrap=True)


async def _one_move(running: Running, move: Move, console: Console) -> Track | str:
    """Return the track of a move from rest to rest, or what was seen when it was not done in time."""
    samples = _Samples(running)
    with _Prompt(console, "hold it still", samples) as prompt:
        if not await _until(samples, lambda: at_rest(samples.track(_BEFORE)), prompt):
            return f"it was not at rest before; {samples.seen()}"
    console.print(f"[bold]{move.asks}[/]", highlight=False, soft_wrap=True)
    samples.keep_last(_BEFORE)
    with _Prompt(console, move.asks, samples) as prompt:
        done = await _until(samples, lambda: is_over(samples.track(), move), prompt)
    with _Prompt(console, "hold it still: the autopilot follows", samples, _FOLLOWS_S) as prompt:
        await _until(samples, lambda: settled(samples.track()), prompt)  # or judge one that never rests
    return samples.track() if done else samples.seen()


async def _put_down(running: Running, where_w_m: Array, console: Console) -> None:
    samples = _Samples(running)

    def down() -> bool:
        track = samples.track(_BEFORE)
        return at_rest(track) and float(np.linalg.norm(track.mocap_w_m[-1] - where_w_m)) < _BACK_M

    with _Prompt(console, "put it down where it stood", samples) as prompt:
        await _until(samples, down, prompt)


class _Samples:
    """Samples of both estimates at 50 Hz while motion capture tracks the body."""

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

    def seen(self) -> str:
        """Return in words how far the body is from its first sample."""
        if not self._rows:
            return "its body was not seen by motion capture"
        moved_m = self._rows[-1][1:4] - self._rows[0][1:4]
        return f"motion capture saw it move {' '.join(f'{value:+.2f}' for value in moved_m.tolist())} m"

    def track(self, last: int = 0) -> Track:
        """Return the samples as a track; only the `last` ones if given."""
        rows = np.array(self._rows[-last:]).reshape(-1, 15)
        return Track(rows[:, 0], rows[:, 1:4], rows[:, 4:8], rows[:, 8:11], rows[:, 11:15])


class _Prompt:
    """Live line with the requested move, the time left and the motion seen so far."""

    def __init__(self, console: Console, asks: str, samples: _Samples, patience_s: float | None = None) -> None:
        self._console, self._asks, self._samples = console, asks, samples
        self._status = console.status(Text(asks))
        self._next_s = -math.inf
        self.patience_s = _PATIENCE_S if patience_s is None else patience_s

    def __enter__(self) -> "_Prompt":
        self._status.start()
        show_cursor(self._console)
        return self

    def __exit__(self, *_: object) -> None:
        self._status.stop()

    def update(self, left_s: float) -> None:
        """Update the line at most every half second."""
        if self.patience_s - left_s >= self._next_s:
            self._next_s = self.patience_s - left_s + _TELL_S
            self._status.update(Text(f"{self._asks}: {left_s:.0f} s left; {self._samples.seen()}"))


async def _until(samples: _Samples, reached: Callable[[], bool], prompt: _Prompt) -> bool:
    clock = asyncio.get_running_loop()
    end_s = clock.time() + prompt.patience_s
    while not reached():
        if clock.time() > end_s:
            return False
        prompt.update(end_s - clock.time())
        await asyncio.sleep(_SAMPLE_S)
        samples.take()
    return True
