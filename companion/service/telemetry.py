"""Conversion of ticks into telemetry: a state on request, an event at every change."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from companion.core.types import Array, AutopilotStatus, OtherVehicle
from companion.estimation.others import vehicles_of
from companion.flight.remote_step import LinkTick
from companion.flight.tick import Tick
from companion.geometry.frames import up_axis, yaw_of
from companion.law_link.link_status import NO_LINK
from companion.protocol.telemetry import WAITING, Doing, Happened, Kind, LawLink, Other, State, Vector
from companion.supervisor.faults import Event, Fault, reaction_to
from companion.supervisor.flight_state import IN_THE_AIR, FlightState

Tell = Callable[[Happened], None]
"""Receiver of events; must neither block nor raise."""
_SHARE_S = 1.0


class Telemetry:
    """TickSink that compares each tick with the last one (about 1 us); the state is built on request."""

    def __init__(self, session: str, tell: Tell) -> None:
        self._session, self._tell = session, tell
        self.waiting = "the service starts"
        """Reason why there is no vehicle, for the state."""
        self._tick: Tick | None = None
        self._events: tuple[Event, ...] = ()
        self._sent_s: list[float] = []
        self._text, self._text_s = "", math.nan
        self._warnings: tuple[str, ...] = ()
        self.record = ""
        """Name of the record's file, for the state; empty without one."""

    def __call__(self, tick: Tick) -> None:
        """Compare a tick with the one before and publish the changes."""
        before, self._tick = self._tick, tick
        if math.isfinite(tick.sent_s) and tick.flight.airborne:
            self._sent_s.append(tick.time_s)
        if before is None or tick.flight.phase is not before.flight.phase:
            self._new_phase(tick)
        if tick.events or self._events:
            self._new_events(tick)
        if tick.link is not None:
            self._new_link(None if before is None else before.link, tick.link)
        if tick.status.last_text != self._text:
            self._text, self._text_s = tick.status.last_text, tick.time_s

    def note_ended_loop(self, flight: FlightState, status: AutopilotStatus, time_s: float) -> None:
        """Report the flight and the autopilot's status after the loop has failed and ticks no more."""
        if self._tick is not None:
            self(replace(self._tick, flight=flight, status=status, time_s=time_s, sent_s=math.nan, events=()))

    def warn(self, warnings: tuple[str, ...]) -> None:
        """Set the warnings shown in every state; publish an event for each that appears or disappears."""
        for text in warnings:
            if text not in self._warnings:
                self._log(text)
        for text in self._warnings:
            if text not in warnings:
                self._log(f"over: {text}")
        self._warnings = warnings

    def _new_phase(self, tick: Tick) -> None:
        flight = tick.flight
        text = f"{flight.phase}: {flight.reason}" if flight.reason else str(flight.phase)
        self._tell(Happened(time_s=time.time(), kind=Kind.PHASE, text=text, name=str(flight.phase)))

    def _new_link(self, before: LinkTick | None, now: LinkTick) -> None:
        """Tell which ground law has the vehicle, and why one was refused, when that changes."""
        was, link = NO_LINK if before is None else before.status, now.status
        if link.connected and (not was.connected or link.session != was.session):
            self._log(f"the ground law {link.law} on {link.host} has this vehicle, session {link.session:04x}")
        if link.refused and link.refused != was.refused:
            self._log(f"a ground law was refused: {link.refused}")

    def _log(self, text: str) -> None:
        self._tell(Happened(time_s=time.time(), kind=Kind.LOG, text=text))

    def _new_events(self, tick: Tick) -> None:
        before, now = {e.fault: e for e in self._events}, {e.fault: e for e in tick.events}
        self._events = tick.events
        for fault, event in now.items():
            if fault not in before:
                reaction = reaction_to(fault, tick.stage)
                self._fault(Kind.FAULT, fault, event.text, reaction.words)
        for fault, event in before.items():
            if fault not in now:
                self._fault(Kind.FAULT_ENDS, fault, event.text, "")

    def _fault(self, kind: Kind, fault: Fault, text: str, reaction: str) -> None:
        self._tell(Happened(time_s=time.time(), kind=kind, text=text, name=str(fault), reaction=reaction))

    @property
    def tick(self) -> Tick | None:
        """Newest tick; None without a vehicle."""
        return self._tick

    def forget(self, waiting: str) -> None:
        """Forget the vehicle, with the reason why it is gone."""
        self._tick, self._events, self.waiting = None, (), waiting

    def state(self, doing: Doing | None, rate_hz: float) -> State:
        """Return the state of the newest tick; `rate_hz` is the rate of the control loop."""
        tick = self._tick
        if tick is None:
            return State(
                time_s=time.time(),
                session=self._session,
                phase=WAITING,
                reason=self.waiting,
                warnings=self._warnings,
                record=self.record,
            )
        vehicle, status, flight = tick.vehicle, tick.status, tick.flight
        reference = tick.reference
        error_m = None
        if vehicle is not None and reference is not None:
            error_m = math.dist(vehicle.position_w_m.tolist(), reference.position_w_m.tolist())
        return State(
            time_s=time.time(),
            session=self._session,
            phase=str(flight.phase),
            reason=flight.reason,
            armed=status.armed,
            in_air=status.in_air,
            mode=str(status.mode),
            battery=_number(status.battery_fraction),
            battery_v=_number(status.battery_v),
            position_w_m=_vector(vehicle.position_w_m) if vehicle else None,
            velocity_w_mps=_vector(vehicle.velocity_w_mps) if vehicle else None,
            yaw_rad=float(yaw_of(vehicle.q_w_flu_wxyz)) if vehicle else None,
            tilt_rad=_tilt_rad(vehicle.q_w_flu_wxyz) if vehicle else None,
            q_w_flu_wxyz=_quaternion(vehicle.q_w_flu_wxyz) if vehicle else None,
            age_s=_number(tick.pose_age_s),
            reference_w_m=_vector(reference.position_w_m) if reference else None,
            error_m=error_m,
            thrust=float(tick.limited.setpoint.thrust) if tick.limited else None,
            controller=tick.law,
            sent_share=self._sent_share(tick, rate_hz),
            law_link=_law_link(tick.link) if tick.link else None,
            faults=tuple(str(event.fault) for event in tick.events),
            others=_others_of(tick),
            arms=str(tick.arms.phase) if tick.arms else None,
            joints_rad=tuple(map(_number, tick.arms.status.position_rad.tolist())) if tick.arms else None,
            doing=doing,
            remaining_s=_remaining_s(flight, tick.time_s),
            late_s=tick.late_s,
            px4_age_s=_number(max(0.0, tick.time_s - status.heard_s)),
            record=self.record,
            text=status.last_text,
            text_age_s=tick.time_s - self._text_s if status.last_text else None,
            warnings=self._warnings,
        )

    def _sent_share(self, tick: Tick, rate_hz: float) -> float | None:
        self._sent_s = [at_s for at_s in self._sent_s if tick.time_s - at_s < _SHARE_S]
        return min(1.0, len(self._sent_s) / (rate_hz * _SHARE_S)) if tick.flight.airborne else None


def _remaining_s(flight: FlightState, time_s: float) -> float | None:
    """Return the time until the reference is at the end of its legs; None where it stands, or none is flown."""
    planned_s = sum(leg.trajectory.duration_s for leg in flight.legs)
    left_s = flight.leg_start_s + planned_s - time_s
    return left_s if flight.airborne and flight.phase in IN_THE_AIR and left_s > 0.0 else None


def _others_of(tick: Tick) -> tuple[Other, ...]:
    """Return the other vehicles as of the newest frame, wherever the vehicle itself was last seen."""
    estimate, vehicle = tick.estimate, tick.vehicle
    if estimate is None or not estimate.others:
        return ()
    place = None if vehicle is None else vehicle.position_w_m.tolist()
    return tuple(_other(one, place) for one in vehicles_of(estimate.others, estimate.others_s))


def _other(one: OtherVehicle, place: Sequence[float] | None) -> Other:
    if not one.known:
        return Other(body=one.body)
    distance_m = None if place is None else math.dist(place[:2], one.position_w_m[:2])
    return Other(body=one.body, position_w_m=one.position_w_m, age_s=one.unseen_s, distance_m=distance_m)


def _law_link(tick: LinkTick) -> LawLink:
    link = tick.status
    return LawLink(
        connected=link.connected,
        host=link.host,
        session=f"{link.session:04x}" if link.connected else "",
        command=tick.command.number,
        silence_s=_number(link.silence_s),
        age_s=_number(link.age_s),
        round_trip_s=_number(link.round_trip_s),
        received=link.received,
        missing=link.missing,
        late=link.late,
        foreign=link.foreign,
        blind=link.blind,
        failed=link.failed,
        rival=link.rival,
        refused=link.refused,
    )


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


def _quaternion(q_wxyz: Array) -> tuple[float, float, float, float]:
    w, x, y, z = q_wxyz.tolist()
    return w, x, y, z


def _tilt_rad(q_w_flu_wxyz: Array) -> float:
    return math.acos(min(1.0, max(-1.0, float(up_axis(q_w_flu_wxyz)[2]))))
