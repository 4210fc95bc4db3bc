"""Figures of one run from what was sent and what arrived; pure, standard library alone."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

Arrival = tuple[int, float, float]
"""Number, time sent, time arrived."""
_LOOK_S = 0.001


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Figures of one transport over one link."""

    link: str
    transport: str
    sent: int
    lost: int
    """Messages that never arrived."""
    age_median_ms: float
    """Age of a message on its arrival."""
    age_p99_ms: float
    age_longest_ms: float
    held_median_ms: float
    """Age of the newest message that the vehicle has, at any moment: what a held command suffers from."""
    held_p99_ms: float
    held_longest_ms: float
    payload_bytes_per_s: float
    wire_up_bytes_per_s: float
    """IP packets to the vehicle, their headers included, lost ones too."""
    wire_down_bytes_per_s: float
    """IP packets back: acknowledgements and the transport's own."""

    def as_dict(self) -> dict[str, object]:
        """Return it for JSON."""
        return asdict(self)


def percentile(values: Sequence[float], share: float) -> float:
    """Return the value that `share` of the sorted values do not exceed; NaN of none."""
    return values[min(int(share * len(values)), len(values) - 1)] if values else float("nan")


def ages_ms(arrivals: Sequence[Arrival]) -> list[float]:
    """Return the age of each message at its first arrival, sorted."""
    first: dict[int, float] = {}
    for number, sent_s, arrived_s in arrivals:
        first[number] = min(first.get(number, float("inf")), arrived_s - sent_s)
    return sorted(1e3 * age_s for age_s in first.values())


def held_ages_ms(arrivals: Sequence[Arrival], begin_s: float, end_s: float) -> list[float]:
    """Return the age of the newest message that has arrived, each millisecond from `begin_s` to `end_s`, sorted."""
    order = sorted(arrivals, key=lambda arrival: arrival[2])
    newest_s = max((sent_s for _, sent_s, arrived_s in order if arrived_s <= begin_s), default=begin_s)
    ages, at, now_s = [], 0, begin_s
    while now_s < end_s:
        while at < len(order) and order[at][2] <= now_s:
            newest_s = max(newest_s, order[at][1])
            at += 1
        ages.append(1e3 * (now_s - newest_s))
        now_s += _LOOK_S
    return sorted(ages)
