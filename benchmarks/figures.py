"""The bench's arithmetic: which setpoint answers which frame, and what a pile of measurements comes to. Pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter_ns, sleep

import numpy as np


@dataclass(frozen=True)
class Spread:
    """Statistics of repeated measurements, in their unit."""

    count: int
    median: float
    p90: float
    p99: float
    least: float
    most: float


def spread(values: Sequence[float]) -> Spread:
    """Median and percentiles; ValueError when there is nothing to look at."""
    if not len(values):
        raise ValueError("nothing was measured")
    least, median, p90, p99, most = (float(np.percentile(values, share)) for share in (0, 50, 90, 99, 100))
    return Spread(len(values), median, p90, p99, least, most)


@dataclass(frozen=True)
class Answers:
    """Time (s) from each question to its answer, and how many questions had none."""

    delays_s: tuple[float, ...]
    unanswered: int


def match(asked_s: Sequence[float], answered_s: Sequence[float]) -> Answers:
    """Pair each question with the first answer after it and before the next question; both in order of time.

    The last question counts only when it was answered: the measurement may have ended before.
    """
    ends_s = [*asked_s, float("inf")][1:]
    places = np.searchsorted(answered_s, asked_s, side="right")
    delays_s = tuple(
        answered_s[place] - start_s
        for place, start_s, end_s in zip(places, asked_s, ends_s, strict=True)
        if place < len(answered_s) and answered_s[place] < end_s
    )
    open_end = bool(len(asked_s)) and (not len(answered_s) or answered_s[-1] <= asked_s[-1])
    return Answers(delays_s, len(asked_s) - len(delays_s) - open_end)


def within(times_s: Sequence[float], start_s: float, end_s: float) -> list[float]:
    """The times in [start_s, end_s)."""
    return [time_s for time_s in times_s if start_s <= time_s < end_s]


def calmest_median_us(call: Callable[[int], object], calls: int, rounds: int, pause_s: float = 0.0) -> float:
    """Median of `calls` timed calls (us), of the round in which it was smallest; `call` gets its number in the round.

    Other programs can only make a round slower, so the calmest one is nearest to what the code costs. With `pause_s`
    the process sleeps before every call, as a control loop does.
    """
    return min(float(np.median([_timed_us(call, number, pause_s) for number in range(calls)])) for _ in range(rounds))


def _timed_us(call: Callable[[int], object], number: int, pause_s: float) -> float:
    if pause_s > 0.0:
        sleep(pause_s)
    begun_ns = perf_counter_ns()
    call(number)
    return (perf_counter_ns() - begun_ns) * 1e-3
