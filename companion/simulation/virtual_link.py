"""One direction of a radio link in virtual time: which messages arrive, and when. Pure; each vehicle has its own seed.

The impairments are those of the mock's relay (`mock_autopilot.impairment`), for at most one message a control cycle.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from companion.core.interfaces import ConfigError
from companion.core.types import Array, Mask
from mock_autopilot.impairment.bursts import Bursts
from mock_autopilot.impairment.direction import OVERTAKEN_WITHIN_S, QUEUE_S, SLACK_S
from mock_autopilot.impairment.model import Impairment
from mock_autopilot.impairment.sentences import Directions, ImpairmentError, parse_directions

Numbers = NDArray[np.int64]

NONE = -1
"""Number of a message that does not exist."""


class Direction:
    """Messages to or from B vehicles, each with its own impairment; at most one a control cycle."""

    def __init__(
        self,
        impairments: Sequence[Impairment],
        seeds: Sequence[np.random.SeedSequence],
        burst_seeds: Sequence[int],
        cycles: int,
        period_s: float,
    ) -> None:
        """Draw the fate of every message; directions with the same burst seed are cut at the same times."""
        drawn = np.stack([np.random.default_rng(seed).random((cycles, 3)) for seed in seeds], axis=1)
        loss, delay_s, jitter_s, reorder, self._rate_bytes_per_s = (
            np.array([getattr(one, name) for one in impairments])
            for name in ("loss_share", "delay_s", "jitter_s", "reorder_share", "rate_bytes_per_s")
        )
        bursts = [_in_burst(*one, cycles, period_s) for one in zip(impairments, burst_seeds, strict=True)]
        self._lost = (drawn[..., 0] < loss) | np.stack(bursts, axis=1)
        self._late_s = delay_s + jitter_s * drawn[..., 1]
        self._waits = drawn[..., 2] < reorder / (1.0 - reorder)
        self._period_s, self._each = period_s, np.arange(len(seeds))
        self.arrival_s = np.full((cycles, len(seeds)), np.inf)
        """Time of arrival of each cycle's message, (cycles, B); infinite where it was lost or not sent."""
        self._free_s = np.zeros(len(seeds))
        """Time from which on the limited rate lets the next message pass."""
        self._overtaken, self._overtaken_s = np.full(len(seeds), NONE), np.zeros(len(seeds))
        longest_s = float(self._late_s.max(initial=0.0)) + reorder.any() * OVERTAKEN_WITHIN_S
        longest_s += np.isfinite(self._rate_bytes_per_s).any() * 2.0 * QUEUE_S
        self._window = int(np.ceil(longest_s / period_s)) + 2

    def send(self, cycle: int, where: Mask, size_bytes: Array | float) -> None:
        """Send a message in this cycle to or from the vehicles of the mask (B,)."""
        now_s = cycle * self._period_s
        begins_s = np.maximum(self._free_s, now_s)
        passes = where & (begins_s - now_s <= QUEUE_S)
        leaves_s = begins_s + size_bytes / self._rate_bytes_per_s
        self._free_s = np.where(passes, leaves_s, self._free_s)
        passes = passes & ~self._lost[cycle]
        self.arrival_s[cycle] = np.where(passes, leaves_s + self._late_s[cycle], np.inf)
        if self._waits.any():
            self._reorder(cycle, passes)

    def _reorder(self, cycle: int, passes: Mask) -> None:
        """Let a message that waits arrive behind this one, or let this one wait."""
        arrives_s = self.arrival_s[cycle].copy()
        behind = passes & (self._overtaken != NONE)
        row = np.where(behind, self._overtaken, cycle)
        late_s = np.maximum(self._overtaken_s, arrives_s) + 0.1 * SLACK_S
        self.arrival_s[row, self._each] = np.where(behind, late_s, self.arrival_s[row, self._each])
        waits = passes & ~behind & self._waits[cycle]
        self.arrival_s[cycle] = np.where(waits, arrives_s + OVERTAKEN_WITHIN_S, arrives_s)
        self._overtaken = np.where(waits, cycle, np.where(behind, NONE, self._overtaken))
        self._overtaken_s = np.where(waits, arrives_s, self._overtaken_s)

    def arrived(self, cycle: int) -> tuple[int, Mask, Mask]:
        """Return the messages that have arrived by now, (w, B), of the last w cycles of sending, and the first of them.

        The second mask tells which of them have arrived since the last cycle.
        """
        first, now_s = max(0, cycle + 1 - self._window), cycle * self._period_s + SLACK_S
        arrival_s = self.arrival_s[first : cycle + 1]
        here = arrival_s <= now_s
        return first, here, here & (arrival_s > now_s - self._period_s)


def newest(first: int, here: Mask) -> Numbers:
    """Return the cycle (B,) of the last message of a mask (w, B) that begins with cycle `first`; NONE without one."""
    last = here.shape[0] - 1 - np.argmax(here[::-1], axis=0)
    return np.where(here.any(axis=0), first + last, NONE)


def _in_burst(one: Impairment, seed: int, cycles: int, period_s: float) -> Mask:
    """Return the cycles (cycles,) in which everything is lost."""
    if not one.burst_share:
        return np.zeros(cycles, dtype=bool)
    bursts = Bursts(one.burst_share, one.burst_s, seed)
    return np.array([bursts.covers(cycle * period_s) for cycle in range(cycles)])


def radio_named(sentence: str | None) -> Directions:
    """Return the impairments of both directions, none without a sentence; ConfigError for one that is none."""
    if sentence is None:
        return Directions()
    try:
        return parse_directions(sentence)
    except ImpairmentError as error:
        raise ConfigError(f"--link {sentence!r}: {error}") from None


def words_of(radio: Directions) -> str:
    """Return the sentence of a radio."""
    return str(radio.up) if radio.up == radio.down else f"up {radio.up}; down {radio.down}"
