"""The ground law's part of a tick: its newest command in, and what the vehicle does out."""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from companion.control.remote_law import NO_COMMAND, RemoteCommand, RemoteLaw
from companion.core.types import AttitudeThrust, JointMotion
from companion.core.values import value
from companion.guard.limits import LimitedSetpoint
from companion.law_link.link_status import LinkStatus, UpCounts
from companion.law_link.link_times import LinkTimes
from companion.law_link.plan import SPACING_S, plan_of
from companion.law_link.vehicle_end import Shown, VehicleEnd
from companion.supervisor.flight_state import PHASES, STREAMING, FlightState, Leg, Phase
from companion.supervisor.state_machine import reference_at

REPORT_S = 0.03
"""Longest time between two reports; the ground takes silence of 0.1 s for a loss."""
_PLAN_AGAIN_S = 0.05
"""Time between two plans over a link that loses messages: without a plan the ground law is blind."""
_ARMING = frozenset({Phase.PREFLIGHT, Phase.ARMED})


class LawLink(Protocol):
    """Link to a law on the ground, which feeds `end` with what arrives."""

    @property
    def end(self) -> VehicleEnd:
        """Vehicle's end: sessions, newest command."""

    def send(self, datagram: bytes) -> None:
        """Send one datagram to the ground law; never waits, never raises because of the network."""


@value(kw_only=True)
class LinkTick:
    """Link to a law on the ground in one cycle, for the record."""

    command: RemoteCommand
    """Command in use."""
    epoch: int
    """Number of the flight."""
    status: LinkStatus
    counts: UpCounts
    times: LinkTimes
    messages_down: int
    """Messages to the ground law in this session."""
    bytes_down: int
    """Their payload with tags, of all sessions."""


class RemoteStep:
    """Call `read` at the begin of a cycle and `show` after its setpoint was sent."""

    def __init__(self, link: LawLink, law: RemoteLaw) -> None:
        self._link, self._law = link, law
        self._epoch, self._airborne, self._begun_s = 0, False, -math.inf
        self._number = 0
        """Number of the command in use; 0 while this flight has none."""
        self.status: LinkStatus = link.end.status(0.0)
        self.command_age_s = math.inf
        """Time since the ground law confirmed its command for this flight."""
        self.tick = self._tick()
        """Link in this cycle, for the record."""
        self._shown: Shown | None = None
        self._shown_s = self._planned_s = -math.inf
        self._legs: tuple[Leg, ...] = ()
        """Legs of the newest plan; compared by identity, as trajectories hold arrays."""
        self._leg_start_s = math.nan

    @property
    def law_name(self) -> str:
        """Name of the law on the ground, for the record and the operator."""
        return f"{self.status.law or 'no law'} on the ground"

    @property
    def end(self) -> VehicleEnd:
        """Vehicle's end of the link."""
        return self._link.end

    def read(self, now_s: float, flight: FlightState) -> None:
        """Take the newest command; a lift-off begins a new epoch, in which older commands are not used."""
        if flight.airborne and not self._airborne:
            self._epoch, self._begun_s = self._epoch % 15 + 1, now_s
        self._airborne = flight.airborne
        end = self._link.end
        end.locked = flight.phase in STREAMING
        self.status = end.status(now_s)
        held = end.use(now_s)
        current = held is not None and held.epoch == self._epoch and flight.airborne
        self._number = held.number if current and held is not None else 0
        self.command_age_s = self.status.silence_s
        if flight.airborne and not current:
            self.command_age_s = max(self.status.silence_s, now_s - self._begun_s)
        command = held.command if current and held is not None else None
        self._law.command = RemoteCommand(
            number=self._number,
            accel_w_mps2=NO_COMMAND if command is None else np.array(command.accel_w_mps2),
            yaw_rad=None if command is None else command.yaw_rad,
            age_s=self.command_age_s,
        )
        self.tick = self._tick()

    def _tick(self) -> LinkTick:
        end, counts = self._link.end, self._link.end.counts
        return LinkTick(
            command=self._law.command,
            epoch=self._epoch,
            status=self.status,
            counts=counts,
            times=end.times,
            messages_down=end.sent,
            bytes_down=end.bytes_down,
        )

    def show(
        self,
        now_s: float,
        flight: FlightState,
        sent: AttitudeThrust,
        limited: LimitedSetpoint | None,
        joints_at: Callable[[float], JointMotion] | None,
    ) -> None:
        """Report to the ground what was sent, at once when it has changed, and the plan when that is due."""
        shown = self._state(flight, sent, limited)
        if shown != self._shown or self._link.end.unreported or now_s - self._shown_s >= REPORT_S:
            self._shown, self._shown_s = shown, now_s
            self._send(self._link.end.report(shown, now_s))
        self._send(self._link.end.poll(now_s))
        changed = flight.legs is not self._legs or flight.leg_start_s != self._leg_start_s
        every_s = SPACING_S if self._loses_little else _PLAN_AGAIN_S
        if flight.legs and (changed or now_s - self._planned_s >= every_s):
            self._legs, self._leg_start_s, self._planned_s = flight.legs, flight.leg_start_s, now_s
            self._send(self._link.end.plan(plan_of(now_s, lambda time_s: reference_at(flight, time_s), joints_at)))

    @property
    def _loses_little(self) -> bool:
        """True if so few messages up are lost that of three plans down one arrives."""
        return self.status.missing <= 0.1 * (self.status.received + self.status.missing)

    def _state(self, flight: FlightState, sent: AttitudeThrust, limited: LimitedSetpoint | None) -> Shown:
        w, x, y, z = sent.q_w_flu_wxyz.tolist()
        cut = limited is not None and bool(limited.not_finite or limited.age_cut or limited.fence_cut)
        return Shown(
            airborne=flight.airborne,
            cut=cut,
            arming=flight.phase in _ARMING,
            phase=PHASES.index(flight.phase),
            epoch=self._epoch,
            number=self._number,
            q_w_flu_wxyz=(w, x, y, z),
            thrust=float(sent.thrust),
        )

    def _send(self, datagram: bytes | None) -> None:
        if datagram is not None:
            self._link.send(datagram)
