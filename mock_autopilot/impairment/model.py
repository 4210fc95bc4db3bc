"""Impairment of one direction of a link, as a value; pure."""

import math
from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True, kw_only=True)
class Impairment:
    """Impairment of one direction of a link; the defaults are a perfect one.

    Raises ValueError for shares outside 0 to 1, negative times and a rate of zero.
    """

    loss_share: float = 0.0
    """Share of the datagrams that is lost, each by itself."""
    burst_share: float = 0.0
    """Share of the time in which every datagram is lost."""
    burst_s: float = 0.0
    """Length of each such burst, s."""
    delay_s: float = 0.0
    """Delay of every datagram."""
    jitter_s: float = 0.0
    """Largest addition to the delay, drawn for each datagram, uniform from 0."""
    reorder_share: float = 0.0
    """Share of the datagrams that arrive behind their successor; at most a half can."""
    duplicate_share: float = 0.0
    """Share of the datagrams that arrives twice."""
    rate_bytes_per_s: float = math.inf
    """Bytes that pass in a second."""

    def __post_init__(self) -> None:
        for name in ("loss_share", "burst_share", "reorder_share", "duplicate_share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} = {getattr(self, name)}: a share is from 0 to 1")
        for name in ("burst_s", "delay_s", "jitter_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name)}: must be a finite number, not negative")
        if not self.rate_bytes_per_s > 0.0:
            raise ValueError(f"rate_bytes_per_s = {self.rate_bytes_per_s}: must be above 0")
        if 0.0 < self.burst_share < 1.0 and self.burst_s == 0.0:
            raise ValueError("burst_share needs burst_s, the length of a burst")
        if self.reorder_share > 0.5:
            raise ValueError("reorder_share: at most half of the datagrams can arrive behind their successor")

    def and_also(self, other: Self) -> "Impairment":
        """Return both impairments at once: one link behind the other, with the longer of their bursts."""
        longer = max(self, other, key=lambda one: one.burst_s)
        return Impairment(
            loss_share=_either(self.loss_share, other.loss_share),
            burst_share=_either(self.burst_share, other.burst_share),
            burst_s=longer.burst_s,
            delay_s=self.delay_s + other.delay_s,
            jitter_s=self.jitter_s + other.jitter_s,
            reorder_share=min(_either(self.reorder_share, other.reorder_share), 0.5),
            duplicate_share=_either(self.duplicate_share, other.duplicate_share),
            rate_bytes_per_s=min(self.rate_bytes_per_s, other.rate_bytes_per_s),
        )

    def __str__(self) -> str:
        """Return it as a sentence that `parse` accepts."""
        parts = [
            (self.loss_share, f"loss {_percent(self.loss_share)}"),
            (self.burst_share, f"loss {_percent(self.burst_share)} burst {_ms(self.burst_s)}"),
            (self.delay_s, f"delay {_ms(self.delay_s)}"),
            (self.jitter_s, f"jitter {_ms(self.jitter_s)}"),
            (self.reorder_share, f"reorder {_percent(self.reorder_share)}"),
            (self.duplicate_share, f"duplicate {_percent(self.duplicate_share)}"),
            (math.isfinite(self.rate_bytes_per_s), f"rate {self.rate_bytes_per_s:.12g} B/s"),
        ]
        return " ".join(text for there, text in parts if there) or "clean"


def _either(a: float, b: float) -> float:
    """Return the probability of one or the other of two independent events."""
    return a + b - a * b


def _percent(share: float) -> str:
    return f"{100.0 * share:.12g}%"


def _ms(time_s: float) -> str:
    return f"{1e3 * time_s:.12g} ms"


CLEAN = Impairment()
"""A link without any impairment."""
CUT = Impairment(loss_share=1.0)
"""A link on which nothing passes."""
