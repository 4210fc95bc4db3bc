"""Schedule of the faults: times and phases turned into begin and end, in simulated time. Pure."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from mock_autopilot.faults.catalogue import Part, Phase
from mock_autopilot.faults.fault import Fault


@dataclass(frozen=True)
class FaultTransition:
    """A fault that begins or ends."""

    fault: Fault
    begins: bool
    time_s: float
    """Simulated time."""


@dataclass(frozen=True)
class ActiveFault:
    """A fault that is active, and the time since which it is."""

    fault: Fault
    since_s: float

    @property
    def until_s(self) -> float:
        """Return the first time at which the fault is no longer active, s simulated."""
        return self.since_s + self.fault.lasts_s


@dataclass(frozen=True)
class _Waiting:
    fault: Fault
    not_before_s: float


class FaultSchedule:
    """The active and the pending faults; `step` it with simulated time, `observers` get each begin and end."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._waiting = [_Waiting(fault, 0.0) for fault in faults]
        self._reached_s: dict[Phase, float] = {Phase.ON_THE_GROUND: 0.0}
        self._held: dict[Part, tuple[ActiveFault, ...]] = dict.fromkeys(Part, ())
        self._next_s = -math.inf
        self.observers: list[Callable[[FaultTransition], None]] = []
        """Callbacks for every fault that begins or ends."""

    def inject(self, fault: Fault, now_s: float) -> None:
        """Add a fault: it begins now, or at its own time; if that time is past, it begins now."""
        self._waiting.append(_Waiting(fault, now_s))
        self._turn(now_s)

    def active(self, part: Part) -> tuple[ActiveFault, ...]:
        """Return the active faults of this part in the order in which they began."""
        return self._held[part]

    def begin_s(self, fault: Fault) -> float:
        """Return the begin by the phases reached so far, s of simulated time; infinite while it is open."""
        if fault.at_s is not None:
            return self._reached_s.get(Phase.IN_THE_AIR, math.inf) + fault.at_s
        if fault.phase is not None:
            return self._reached_s.get(fault.phase, math.inf) + fault.after_s
        return 0.0

    def step(self, now_s: float, armed: bool, airborne: bool, landing: bool) -> None:
        """Note the phases reached, then begin and end the faults that are due."""
        if len(self._reached_s) < len(Phase):
            self._note(Phase.ARMED, armed, now_s)
            self._note(Phase.IN_THE_AIR, airborne, now_s)
            self._note(Phase.LANDING, landing, now_s)
        if now_s >= self._next_s:
            self._turn(now_s)

    def _note(self, phase: Phase, reached: bool, now_s: float) -> None:
        if reached and phase not in self._reached_s:
            self._reached_s[phase] = now_s
            self._next_s = now_s

    def _turn(self, now_s: float) -> None:
        ended = [held for every in self._held.values() for held in every if held.until_s <= now_s + 1e-9]
        begun = [one for one in self._waiting if max(self.begin_s(one.fault), one.not_before_s) <= now_s + 1e-9]
        self._waiting = [one for one in self._waiting if one not in begun]
        for held in ended:
            part = held.fault.part
            self._held[part] = tuple(other for other in self._held[part] if other is not held)
        for one in begun:
            if one.fault.lasts_s > 0.0:
                self._held[one.fault.part] += (ActiveFault(one.fault, now_s),)
        self._next_s = self._next_edge_s()
        for fault, begins in (*((h.fault, False) for h in ended), *((one.fault, True) for one in begun)):
            for observer in self.observers:
                observer(FaultTransition(fault, begins, now_s))

    def _next_edge_s(self) -> float:
        ends = [held.until_s for every in self._held.values() for held in every]
        begins = [max(self.begin_s(one.fault), one.not_before_s) for one in self._waiting]
        return min((*ends, *begins), default=math.inf)
