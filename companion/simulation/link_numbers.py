"""Numbers of the link to a law on the ground in virtual flights: messages, bytes, losses, ages. Pure."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.analysis.summary import Spread, spread_ms
from companion.core.types import Array, Mask
from companion.simulation.simulation import Trace
from companion.simulation.virtual_link_ends import BYTES, Kind, Messages


@dataclass(frozen=True, kw_only=True)
class LinkNumbers:
    """Key numbers of a link while the trajectory was flown, as in the summary of a flight (`LinkSummary`)."""

    uplink_bytes_per_s: float
    """Payload with tags, lost messages included."""
    messages_per_s: float
    events: float
    """Number in a flight, on average."""
    beats: float
    again: float
    """Commands that were sent again because they were not acknowledged."""
    lost: float
    age_ms: Spread
    """Age of a message at its arrival."""
    longest_silence_ms: float
    """Longest time for which the ground had not confirmed the command in use."""
    landed_by_px4: int
    """Flights that PX4 has ended, as nothing came from the ground for too long."""
    landed_s: tuple[float, ...]
    """Times of that, from the start of the trajectory."""

    def __str__(self) -> str:
        """Return the numbers as a line."""
        return (
            f"link {self.messages_per_s:.0f} messages/s, {self.uplink_bytes_per_s:.0f} bytes/s up; in a flight "
            f"{self.events:.0f} events, {self.beats:.0f} beats, {self.again:.0f} again, {self.lost:.0f} lost; age "
            f"{self.age_ms.median:.1f} ms (p99 {self.age_ms.p99:.1f}), longest silence {self.longest_silence_ms:.0f} ms"
        )

    def plain(self) -> dict[str, Any]:
        """Return the numbers for JSON, null for those that are not finite."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def link_numbers(traces: Sequence[Trace], period_s: float) -> LinkNumbers | None:
    """Return the numbers of flights, of one vehicle or a batch each, taken together; None for a law on board."""
    flights = [(trace, trace.messages) for trace in traces if trace.messages is not None]
    if not flights:
        return None
    kinds, ages_s, silences_s, clock = (
        np.concatenate(parts) for parts in zip(*(_counted(*one) for one in flights), strict=True)
    )
    landed_s = [float(one) for trace, messages in flights for one in _landed_s(trace, messages)]
    many = sum(messages.kind[0].size for _, messages in flights)
    time_s = max(len(kinds) * period_s, 1e-9)
    arrived_s, clocks = ages_s[np.isfinite(ages_s)], clock.sum()
    sent = (kinds > Kind.NOTHING).sum() + clocks
    events, again = (kinds == Kind.EVENT).sum(), (kinds == Kind.AGAIN).sum()
    return LinkNumbers(
        uplink_bytes_per_s=float(BYTES[kinds].sum() + clocks * BYTES[Kind.CLOCK]) / time_s,
        messages_per_s=float(sent) / time_s,
        events=float(events) / many,
        beats=float(sent - events - again) / many,
        again=float(again) / many,
        lost=float(np.isinf(ages_s).sum()) / many,
        age_ms=spread_ms(arrived_s),
        longest_silence_ms=1e3 * float(silences_s.max(initial=0.0)),
        landed_by_px4=len(landed_s),
        landed_s=tuple(landed_s),
    )


def _counted(trace: Trace, messages: Messages) -> tuple[NDArray[np.int8], Array, Array, Mask]:
    """Return kinds, ages and silences of the cycles that count, each (m,), and where a clock went with an event."""
    counted = ~messages.landed
    counted[trace.time_s < -1e-9] = False
    return messages.kind[counted], messages.age_s[counted], messages.silence_s[counted], messages.clock[counted]


def _landed_s(trace: Trace, messages: Messages) -> Array:
    landed = messages.landed.reshape(len(trace.time_s), -1)
    return np.asarray(trace.time_s[landed.argmax(axis=0)[landed[-1]]])


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, tuple):
        return list(value)
    return None if isinstance(value, float) and not np.isfinite(value) else value
