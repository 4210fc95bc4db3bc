"""Log of a flight: each event once as a line, and a sentence at the end. Pure: ticks in, lines out."""

import math
from dataclasses import dataclass

from rich.text import Text

from companion.arms.state_machine import ArmPhase
from companion.cli.demo.fault_messages import begun, done, shorter
from companion.core.types import FlightMode
from companion.flight.tick import Tick
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import IN_THE_AIR, STREAMING, FlightState, Phase

NEXT = "Next: docs/safety.md, then companion preflight"
_OPERATOR_HOLD = "the operator ordered it; abort or land brings it down"
_OVER = frozenset({Phase.DISARMED, Phase.TERMINATED})
_OPERATOR = "the operator "


@dataclass(frozen=True)
class Reacted:
    """One failsafe action of the flight, with its cause."""

    name: str
    """Name of the fault, or the reason in words."""
    cause: Fault | None
    level: FailsafeAction
    mode: FlightMode
    at_s: float


class FlightStory:
    """Log that takes every tick and returns new events as lines for a terminal."""

    def __init__(self) -> None:
        self.reactions: list[Reacted] = []
        self.held = False
        """The operator ordered a hold."""
        self.ours = False
        """The next landing is the planned one; set by the caller of `land`."""
        self.last: Tick | None = None
        self._before = FlightState()
        self._started_s = math.nan
        self._ended_s = math.nan
        self._told: set[Fault] = set()
        self._arms: ArmPhase | None = None
        self._flew = False
        self._ordered = False
        self._tracked_s, self._to_track_s = 0.0, math.nan

    @property
    def phase(self) -> Phase:
        """The phase of the last tick."""
        return self._before.phase

    @property
    def completed(self) -> bool:
        """The trajectory was flown to its end."""
        return self._tracked_s >= self._to_track_s

    def clock(self, time_s: float) -> str:
        """Return a monotonic time as seconds since the motors' start; empty before."""
        return "" if math.isnan(self._started_s) else f"{time_s - self._started_s:.1f} s"

    def take(self, tick: Tick) -> list[Text]:
        """Take a tick; return its new events as lines."""
        before, flight = self._before, tick.flight
        if flight.phase is Phase.TAKEOFF and math.isnan(self._started_s):
            self._started_s = tick.time_s
        self._flew = self._flew or flight.airborne
        self._note_progress(tick, before)
        reacted = flight.level > max(before.level, FailsafeAction.WARN)
        lines = [self._reaction(tick, before)] if reacted else []
        lines += self._faults(tick, flight.cause if reacted else None)
        lines += self._phase(tick, before, reacted)
        lines += self._of_arms(tick)
        self._before, self.last = flight, tick
        return lines

    def line(self, time_s: float, head: str, style: str, rest: str) -> Text:
        """Return a line: the time, a styled head, the rest."""
        return Text.assemble(f"{self.clock(time_s):>8}  ", (head, style), rest)

    def _reaction(self, tick: Tick, before: FlightState) -> Text:
        flight = tick.flight
        texts = [event.text for event in tick.events if event.fault is flight.cause]
        text = shorter(texts[0]) if texts else flight.reason.removeprefix(before.reason).removeprefix("; then ")
        name = str(flight.cause) if flight.cause else text
        self.reactions.append(Reacted(name, flight.cause, flight.level, tick.status.mode, tick.time_s))
        what = f": {text}" if flight.cause else ""
        return self.line(tick.time_s, name, "bold red", f"{what} -> {begun(flight, tick.status.mode)}")

    def _faults(self, tick: Tick, told: Fault | None) -> list[Text]:
        """Return lines for new faults, in phases that stream setpoints or watch a vehicle."""
        known, self._told = self._told, {event.fault for event in tick.events}
        if tick.flight.phase not in STREAMING and tick.flight.phase is not Phase.HANDED_OVER:
            return []
        return [
            self.line(tick.time_s, str(event.fault), "yellow", f": {shorter(event.text)}")
            for event in tick.events
            if event.fault not in known and event.fault is not told
        ]

    def _phase(self, tick: Tick, before: FlightState, reacted: bool) -> list[Text]:
        flight = tick.flight
        if _is_operators_hold(before, flight):
            self.held = True
            return [self.line(tick.time_s, str(flight.phase), "bold", f": {_OPERATOR_HOLD}")]
        if flight.phase is before.phase or flight.phase is Phase.STANDBY:
            return []
        if flight.phase in _OVER:
            self._ended_s = tick.time_s
        if reacted and flight.phase in {Phase.HANDED_OVER, Phase.TERMINATED}:
            return []
        why = "" if reacted or flight.reason == before.reason else f": {shorter(flight.reason)}"
        if self._is_ordered_down(before, flight):
            self._ordered = True
            why = ": the operator ordered it"
        return [self.line(tick.time_s, str(flight.phase), "bold", why)]

    def _is_ordered_down(self, before: FlightState, flight: FlightState) -> bool:
        down = flight.phase in {Phase.STOW, Phase.LAND} and before.phase not in {Phase.STOW, Phase.LAND}
        asked = not flight.reason or flight.reason.startswith(_OPERATOR)
        return down and asked and flight.level is FailsafeAction.WARN and not self.ours

    def _note_progress(self, tick: Tick, before: FlightState) -> None:
        flight = tick.flight
        if flight.phase is Phase.TRACK:
            self._to_track_s = flight.legs[0].trajectory.duration_s
            self._tracked_s = min(tick.time_s - flight.leg_start_s, math.nextafter(self._to_track_s, 0.0))
        elif before.phase is Phase.TRACK and flight.phase is Phase.HOLD and flight.legs[-1] is before.legs[-1]:
            self._tracked_s = self._to_track_s

    def _of_arms(self, tick: Tick) -> list[Text]:
        if tick.arms is None or tick.arms.phase is self._arms:
            return []
        self._arms = tick.arms.phase
        if self._arms is not ArmPhase.FAULT or (tick.events and tick.flight.phase in STREAMING):
            return []
        return [self.line(tick.time_s, "arms: fault", "red", f": {shorter(tick.arms.reason)}")]

    def ending(self, still: str = "") -> str:
        """Return why and how the flight left its plan, empty if it did not. `still`: what is not over yet."""
        if self.reactions:
            said = self._of_reactions(still)
        elif (self.held or self._ordered) and not self.completed:
            said = self._of_operator()
        else:
            return still
        return f"{said}; {still}" if still and NEXT not in said else said

    def _of_reactions(self, still: str) -> str:
        last = self.reactions[-1]
        causes = ", then ".join(f"{one.name}{self._at(one.at_s)}" for one in self.reactions)
        how = "ended by" if self._flew else "stopped before it flew, by"
        over = not math.isnan(self._ended_s)
        off = f", disarmed{self._at(self._ended_s)}" if over and self.phase is Phase.DISARMED else ""
        did = still or f"{done(last.level, last.cause, last.mode, over)}{off}"
        return f"{how} {causes}; {did}. {NEXT}"

    def _of_operator(self) -> str:
        tracked = f"after {self._tracked_s:.0f} of {self._to_track_s:.0f} s" if self._tracked_s else "before its task"
        over = f"; landed, disarmed{self._at(self._ended_s)}" if self.phase is Phase.DISARMED else ""
        return f"ended by the operator {tracked}{over}"

    def _at(self, time_s: float) -> str:
        return f" at {self.clock(time_s)}" if self.clock(time_s) else ""

    def over_at(self) -> str:
        """Return the time when the flight was over, or its last tick; empty when there was none."""
        last_s = self.last.time_s if self.last is not None else math.nan
        return self.clock(last_s if math.isnan(self._ended_s) else self._ended_s)


def _is_operators_hold(before: FlightState, flight: FlightState) -> bool:
    """Return whether a hold began that is not the planned one at a trajectory's end."""
    if before.phase is Phase.RESUME and flight.phase is Phase.HOLD:
        return True
    flying = before.airborne and before.phase in IN_THE_AIR and flight.phase is Phase.HOLD
    if not flying or flight.level > FailsafeAction.WARN or len(flight.legs) > 2:
        return False
    return flight.legs[-1] is not before.legs[-1]
