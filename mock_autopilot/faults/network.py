"""Faults of a network, as impairments of its two directions; pure, for relays and for flights in simulated time."""

from collections.abc import Sequence
from typing import Generic, TypeVar

from mock_autopilot.faults.catalogue import DOWN, UP, Kind, Part
from mock_autopilot.faults.fault import Fault
from mock_autopilot.faults.schedule import ActiveFault, FaultSchedule
from mock_autopilot.impairment.direction import ImpairedDirection
from mock_autopilot.impairment.model import CLEAN, CUT, Impairment

Item = TypeVar("Item")
_BURSTS_S = {"bursts of 0.1 s": 0.1, "bursts of 0.3 s": 0.3}


def impairment_of(held: Sequence[ActiveFault], direction: str, base: Impairment = CLEAN) -> Impairment:
    """Return the impairment of one direction (catalogue.UP or DOWN): its own and those of the active faults."""
    other = DOWN if direction == UP else UP
    for one in held:
        if one.fault.how != other:
            base = base.and_also(_impairment(one.fault))
    return base


def _impairment(fault: Fault) -> Impairment:
    amount = fault.magnitude
    if fault.kind is Kind.OFF:
        return CUT
    if fault.kind is Kind.SLOW:
        return Impairment(rate_bytes_per_s=1e3 * amount)
    if fault.kind is Kind.WRONG:
        twice = fault.how == "duplicated"
        return Impairment(duplicate_share=amount) if twice else Impairment(reorder_share=amount)
    if fault.kind is Kind.DELAYED:
        return Impairment(jitter_s=amount) if fault.how == "jitter" else Impairment(delay_s=amount)
    if fault.how in _BURSTS_S:
        return Impairment(burst_share=amount, burst_s=_BURSTS_S[fault.how])
    return Impairment(loss_share=amount)


class NetworkFaults(Generic[Item]):
    """One direction of a network with its faults, in simulated time; takes what is sent, returns what arrives."""

    def __init__(self, schedule: FaultSchedule, direction: str, base: Impairment = CLEAN, seed: int = 1) -> None:
        """Take the faults of one `direction`, catalogue.UP or DOWN; two with the same seed share their bursts."""
        self._schedule, self._way, self._base = schedule, direction, base
        self._held: tuple[ActiveFault, ...] = ()
        self._direction: ImpairedDirection[Item] = ImpairedDirection(base, 2 * seed + (direction == DOWN), seed)

    def pass_on(self, sent: Sequence[Item], now_s: float, size_bytes: int | None = None) -> list[Item]:
        """Return what arrives at `now_s` (s, simulated) when `sent` is sent now, each of `size_bytes`.

        Bytes know their size. Call it often, also without datagrams: delayed ones arrive later.
        """
        held = self._schedule.active(Part.NETWORK)
        if held is not self._held:
            self._held = held
            self._direction.set(impairment_of(held, self._way, self._base))
        for item in sent:
            self._direction.put(now_s, item, size_bytes)
        return self._direction.due(now_s)
