"""Both ends of the link to a law on the ground, for a batch in virtual time: who sends when, who knows what. Pure.

The rules are those of `companion.law_link` and `companion.flight.remote_step`, without sessions, keys and clocks; a
test holds both against each other. A command's number is the control cycle in which it was computed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache
from statistics import median

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array, Mask
from companion.flight.remote_step import REPORT_S
from companion.law_link import messages as wire
from companion.law_link.codec import packed
from companion.law_link.ground_end import AGAIN_EVERY_S, AGAIN_S, CLOCK_S, HURRY_S
from companion.law_link.sealing import TAG_BYTES
from companion.simulation.virtual_link import NONE, Direction, newest
from mock_autopilot.impairment.sentences import Directions

_TINY_S = 1e-6


class Kind(IntEnum):
    """Kind of a message up."""

    NOTHING = 0
    BEAT = 1
    CLOCK = 2
    EVENT = 3
    AGAIN = 4


_BEAT = wire.UpMessage(kind=wire.Kind.BEAT, session=0, sequence=0, stamp=0, number=0, epoch=0)
_EVENT = replace(_BEAT, command=wire.Command(accel_w_mps2=(0.0, 0.0, 0.0), yaw_rad=0.0, capture_ago=0))
_CLOCK = replace(_BEAT, clock=wire.Clock(offset=0, round_trip=0, sent_bytes=0, again=0))
BYTES = np.array([0, *(len(packed(one)) + TAG_BYTES for one in (_BEAT, _CLOCK, _EVENT, _EVENT))])
"""Payload of each kind, with its tag."""
_REPORT = wire.Report(
    session=0,
    sequence=0,
    stamp=0,
    echo=0,
    held=0,
    received=0,
    number=0,
    epoch=0,
    law=0,
    flags=wire.DownFlags(0),
    up_age=0,
    q_w_flu_wxyz=(1.0, 0.0, 0.0, 0.0),
    thrust=0.0,
)
_REPORT_BYTES = len(packed(_REPORT)) + TAG_BYTES


@dataclass(frozen=True, kw_only=True)
class LinkTiming:
    """Times of a link, as measured before the flight."""

    beat_s: float = 0.03
    up_age_s: float = 0.0
    """Usual age of a message when the vehicle's cycle uses it."""
    silent_s: float = 0.25
    """Silence of the ground at which PX4 lands the vehicle."""


@dataclass(frozen=True, kw_only=True)
class Messages:
    """Messages up of a flight: n cycles, then the batch's leading axes."""

    kind: NDArray[np.int8]
    """Kind, 0 in cycles without a message."""
    age_s: Array
    """Age at its arrival; infinite if it was lost, NaN without a message."""
    clock: Mask
    """Cycles whose event carried the clock as well, as a second message."""
    silence_s: Array
    """Time since the ground has confirmed the command in use."""
    landed: Mask
    """Cycles after PX4 has taken over to land, as the ground was silent for too long; what follows is no flight."""


class LinkEnds:
    """Link of B vehicles to their laws; call `hear_reports`, `send`, `hear_commands`, `report` in each cycle."""

    def __init__(
        self, links: Sequence[Directions], timing: LinkTiming, seeds: Sequence[int], cycles: int, period_s: float
    ) -> None:
        ups, downs = zip(*(np.random.SeedSequence(seed, spawn_key=(3,)).spawn(2) for seed in seeds), strict=True)
        self._up = Direction([link.up for link in links], ups, seeds, cycles, period_s)
        self._down = Direction([link.down for link in links], downs, seeds, cycles, period_s)
        self._period_s, self._timing, many = period_s, timing, len(seeds)
        delay_s = np.array([link.up.delay_s + link.down.delay_s for link in links])
        self._round_trip_s = np.maximum(delay_s, 2.0 * timing.up_age_s)
        self._each = np.arange(many)
        self._kind = np.zeros((cycles, many), dtype=np.int8)
        self._cut, self._and_clock = np.zeros((cycles, many), dtype=bool), np.zeros((cycles, many), dtype=bool)
        self._silence_s = np.zeros((cycles, many))
        self._number_sent, self._number_reported, self._echo = (np.full((cycles, many), NONE) for _ in range(3))
        """Number of the command that a message up, and a report, speaks of; newest message that a report has seen."""
        self.number, self.in_use = np.full(many, NONE), np.full(many, NONE)
        """Number of the newest command, and of the one that the vehicle uses."""
        self.reported = np.full(many, NONE)
        """Cycle in which the newest report that the ground has was sent."""
        self.is_cut = self._lost = self._hurries = np.zeros(many, dtype=bool)
        """Vehicles whose last report is of a setpoint other than that of its command; that should have acknowledged the
        newest command, or anything at all, by now and have not."""
        self._sent, self._again, self._clock = np.full(many, NONE), np.full(many, NONE), np.zeros(many, dtype=np.int64)
        self._heard = self._confirmed = np.zeros(many, dtype=np.int64)
        self._unreported, self._shown = np.zeros(many, dtype=bool), np.full(many, -cycles)

    def hear_reports(self, cycle: int) -> None:
        """Take the newest report that has reached the ground."""
        first, here, _ = self._down.arrived(cycle)
        self.reported = np.maximum(self.reported, newest(first, here))
        known, row = self.reported != NONE, np.maximum(self.reported, 0)
        number = self._number_reported[row, self._each]
        since_s = (cycle - self.number) * self._period_s
        self._lost = known & (number != self.number) & (since_s > self._round_trip_s + AGAIN_S + _TINY_S)
        self.is_cut = known & self._cut[row, self._each]
        unheard_s = (cycle - self._echo[row, self._each]) * self._period_s
        self._hurries = known & (unheard_s > self._round_trip_s + HURRY_S + _TINY_S)

    def send(self, cycle: int, event: Mask) -> None:
        """Send what is due after the law's cycle, which has computed a new command where `event` (B,) says so."""
        self.number = np.where(event, cycle, self.number)
        in_time = (cycle - self._again) * self._period_s > AGAIN_EVERY_S - _TINY_S
        again = ~event & self._lost & (in_time | self._hurries)
        silent_s = (cycle - self._sent) * self._period_s
        due = (self._sent == NONE) | self._hurries | (silent_s > self._timing.beat_s - _TINY_S)
        carries = event | again
        told = (cycle - self._clock) * self._period_s > CLOCK_S - _TINY_S
        clock, beat = told & ~carries, due & ~carries
        kind = np.select([event, again, clock, beat], [Kind.EVENT, Kind.AGAIN, Kind.CLOCK, Kind.BEAT], Kind.NOTHING)
        self._kind[cycle], self._number_sent[cycle] = kind, self.number
        self._and_clock[cycle] = told & carries
        self._again, self._clock = np.where(carries, cycle, self._again), np.where(told, cycle, self._clock)
        self._sent = np.where(kind > 0, cycle, self._sent)
        self._up.send(cycle, kind > 0, BYTES[kind])

    def hear_commands(self, cycle: int) -> Array:
        """Take the newest command that has reached the vehicle; return for how long none was confirmed (s), (B,)."""
        first, here, now = self._up.arrived(cycle)
        self._heard = np.maximum(self._heard, newest(first, here))
        carries = self._kind[first : cycle + 1] >= Kind.EVENT
        row = newest(first, here & carries)
        self.in_use = np.maximum(self.in_use, np.where(row == NONE, NONE, self._number_sent[row, self._each]))
        self._unreported |= (now & carries).any(axis=0)
        confirmed = self._number_sent[self._heard, self._each] == self.in_use
        self._confirmed = np.where(confirmed, np.maximum(self._heard, self._confirmed), self._confirmed)
        self._silence_s[cycle] = (cycle - self._confirmed) * self._period_s
        return np.asarray(self._silence_s[cycle])

    def report(self, cycle: int, changed: Mask, cut: Mask) -> None:
        """Report where the setpoint has changed (B,), where a command has arrived, and where it is time to.

        `cut` says where the setpoint is another than that of the command in use.
        """
        self._cut[cycle] = cut
        due = changed | self._unreported | ((cycle - self._shown) * self._period_s > REPORT_S - _TINY_S)
        self._shown, self._unreported = np.where(due, cycle, self._shown), self._unreported & ~due
        self._number_reported[cycle], self._echo[cycle] = self.in_use, self._heard
        self._down.send(cycle, due, _REPORT_BYTES)

    def messages(self, lead: tuple[int, ...]) -> Messages:
        """Return the messages up of the whole flight, for a batch of shape `lead`."""
        shape = (len(self._kind), *lead)
        age_s = self._up.arrival_s - np.arange(len(self._kind))[:, None] * self._period_s
        landed = np.logical_or.accumulate(self._silence_s > self._timing.silent_s + _TINY_S, axis=0)
        return Messages(
            kind=self._kind.reshape(shape),
            age_s=np.where(self._kind > 0, age_s, np.nan).reshape(shape),
            clock=self._and_clock.reshape(shape),
            silence_s=self._silence_s.reshape(shape),
            landed=landed.reshape(shape),
        )


@lru_cache(maxsize=64)
def measured_up_age_s(link: Directions, timing: LinkTiming, period_s: float) -> float:
    """Return the median age (s) of a message when a cycle uses it, measured before a flight; NaN if none arrives."""
    ends = LinkEnds([link], timing, [_SEED], _MEASURED, period_s)
    ages_s, before_s = list[float](), 0.0
    for cycle in range(_MEASURED):
        ends.send(cycle, _NO)
        silence_s = float(ends.hear_commands(cycle)[0])
        if silence_s < before_s + 0.5 * period_s:
            ages_s.append(silence_s)
        before_s = silence_s
    return median(ages_s[1:]) if len(ages_s) > 1 else math.nan


_MEASURED, _SEED = 600, 1
_NO = np.zeros(1, dtype=bool)
