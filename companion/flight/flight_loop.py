"""One tick: read, estimate, supervise, control, limit, send, record. Short enough to read aloud."""

import asyncio
import logging
import math
from dataclasses import replace

from companion.control.controller import Controller
from companion.control.pipeline import idle_setpoint
from companion.control.wire_setpoint import Wire
from companion.core.interfaces import CompanionError
from companion.core.types import AttitudeThrust, AutopilotStatus, FlightMode
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorState, Verdict
from companion.flight.arming import Arming, refused_for
from companion.flight.assembly import Devices, Stages
from companion.flight.autopilot_calls import AutopilotCalls
from companion.flight.cycle_start import frame_or_deadline
from companion.flight.estimate_step import Arrival
from companion.flight.health_step import Cycle, facts_of
from companion.flight.shutdown import Shutdown, ShutdownTimes
from companion.flight.tick import Tick, TickSink
from companion.flight.tick_timer import TickTimer
from companion.geometry.frames import yaw_of
from companion.guard.guard import SINKING
from companion.guard.limits import LimitedSetpoint
from companion.supervisor import state_machine
from companion.supervisor.faults import Event, FailsafeAction, Fault
from companion.supervisor.flight_state import (
    COMMANDED,
    STREAMING,
    FlightInputs,
    FlightState,
    HandOverRequest,
    KillRequest,
    LandRequest,
    Phase,
    Request,
    TrackRequest,
)
from companion.supervisor.transitions import approach

__all__ = ["Devices", "FlightLoop"]

LOG = logging.getLogger(__name__)

_Held = tuple[bool, AttitudeThrust | None, bool, str, str]
"""Stream on, setpoint sent last, its thrust at the limit, faults of law and horizon."""
_ALONG_THE_LEGS = frozenset({Phase.TAKEOFF, Phase.HOLD, Phase.TRACK})
"""Phases in which the state machine, without a fault, only goes on from leg to leg once the vehicle is in the air."""
_TURNS = 3
"""Turns of the event loop after which every socket has been read."""
_FAILED = "the flight loop has failed and the autopilot was told to land: only kill is still taken"


class FlightLoop:
    """Owns the flight's phase and calls, in order, what is pure and what is a device."""

    def __init__(self, devices: Devices, stages: Stages, sink: TickSink, law_name: str = "") -> None:
        self._mocap, self._autopilot, self._clock = devices.mocap, devices.autopilot, devices.clock
        self._sink: TickSink | None = sink
        self._period_s, self._estimating = stages.period_s, stages.estimate
        self._rules, self._safety, self._pipeline = stages.rules, stages.safety, stages.control
        self._law, self._health, self._stream, self._vision = stages.law, stages.health, stages.stream, stages.vision
        self._horizon = stages.horizon
        self.remote = stages.remote
        """Part of a law on the ground; None for a law on board."""
        self.arms = stages.arms
        """The arms' part; None for a vehicle without."""
        self._events: tuple[Event, ...] = ()
        self._calls = AutopilotCalls(devices.autopilot)
        self.arming = Arming()
        """Arming, which comes before the phases of the flight."""
        self._flight = FlightState()
        self._failed = False
        self._law_name = law_name
        self.ticking = False
        """Cycles come by themselves."""
        parts = (self._see_without_checks, self._supervise_without_checks, self._keep_or_end_stream)
        times = ShutdownTimes(
            self._period_s, self._rules.stow_time_s, self._safety.land_refused_s, self._safety.silent_s
        )
        self._giving_up = Shutdown(self, self._calls, devices, times, parts)

    @property
    def flight(self) -> FlightState:
        """The present phase and all that goes with it."""
        return self._flight

    @property
    def estimate(self) -> EstimatorState:
        """Return the latest estimate of the vehicle's motion."""
        return self._estimating.state

    @property
    def events(self) -> tuple[Event, ...]:
        """Return the faults that are present now."""
        return self._events

    @property
    def law_name(self) -> str:
        """Name of the law that flies, for the record and the operator."""
        return self._law_name if self.remote is None else self.remote.law_name

    @property
    def failed(self) -> bool:
        """Return True if it ticks no more, because a device or the law has raised; the autopilot was told to land."""
        return self._failed

    @property
    def action_failure(self) -> str:
        """Return why the autopilot did not do what the loop asked of it on its own; empty if it did."""
        return self._calls.failure

    def refusal(self, request: Request) -> str:
        """Return why an operator's request would be rejected now; empty when it would be accepted."""
        inputs = self._facts_now()
        return self._rejection(request) or state_machine.refusal(self._flight, request, inputs, self._rules)

    def preview(self, request: TrackRequest) -> FlightState:
        """Return the flight as it would be if this trajectory were requested now."""
        return approach(self._flight, request, self._facts_now(), self._rules)

    def submit(self, request: Request) -> str:
        """Apply an operator's request; return why it is rejected, empty when it is accepted.

        A landing is also accepted on the ground while the checks before arming run, and ends them.
        """
        reason = self._rejection(request)
        if not reason:
            inputs = self._facts_now()
            flight, reason = state_machine.apply_request(self._flight, request, inputs, self._rules)
            self._enter(flight)
        if isinstance(request, LandRequest) and self.arming.call_off(request.reason or "a landing was ordered"):
            return ""
        return reason

    def _rejection(self, request: Request) -> str:
        """Return why a request is rejected whatever the state machine says; empty otherwise."""
        if self._failed and not isinstance(request, KillRequest):
            return _FAILED
        return refused_for(request, self._autopilot.status())

    def switch(self, controller: Controller, name: str) -> None:
        """Another control law from the next cycle on, in the air too, without a jump of the setpoint."""
        LOG.info("control law %s -> %s", self.law_name, name)
        self._pipeline.switch(controller)
        self._law_name = name

    async def run(self) -> None:
        """Tick until cancelled. What a device or the law raises is raised, after the autopilot was told to land."""
        timer = TickTimer(self._period_s, self._clock.now_s() + self._period_s)
        self.ticking = True
        try:
            while True:
                frame_arrived_s = await frame_or_deadline(self._mocap, self._clock, timer)
                if frame_arrived_s is None:
                    frame_arrived_s = await self._catch_up()
                now_s = self._clock.now_s()
                self.tick(now_s, timer.begin(now_s, frame_arrived_s))
        except asyncio.CancelledError:
            raise
        except BaseException as error:
            self.ticking, self._failed, self._events = False, True, ()
            words = str(error) if isinstance(error, CompanionError) else f"{type(error).__name__}: {error}"
            await self._giving_up.give_up(words)
            raise
        finally:
            self.ticking = False
            await self._calls.cancel()
            self._stream.stop()
            if self.arms is not None:
                await self.arms.close()

    async def close(self) -> None:
        """Leave no vehicle in the air to a stream that goes on by itself, and no arm in the middle of a motion."""
        if self.arms is not None:
            self.arms.stop("the service was closed")
        await self._giving_up.give_up("the service was closed")

    async def _catch_up(self) -> float | None:
        """The loop is behind: let in what has arrived meanwhile, before anything is concluded from its absence."""
        for _ in range(_TURNS):
            await asyncio.sleep(0)
        return self._estimating.waiting_s()

    def tick(self, now_s: float, late_s: float) -> None:
        """One control cycle at `now_s`, begun `late_s` late."""
        if self.remote is not None:
            self.remote.read(now_s, self._flight)
        status = self._autopilot.status()
        arrival = self._estimating.read(status)
        if self.arms is not None:
            self.arms.read(now_s, self._flight)
        before, behind = self._flight, self._may_supervise_behind(arrival, status, now_s)
        held = self._held()
        if not behind:
            self._supervise(self._cycle(now_s, late_s, status, held))
        flown = self._flight
        pipeline, limited = self._law.control(flown, self._estimating.latest, self._stream.law_sent, now_s)
        wire, sent_s = self._send(limited, now_s, status)
        self._horizon.judge(wire)
        if behind:
            self._supervise(self._cycle(now_s, late_s, status, held))
        self._keep_or_end_stream(now_s)
        if self.remote is not None:
            joints_at = None if self.arms is None else self.arms.motion_at
            self.remote.show(now_s, self._flight, self._stream.law_sent, limited, joints_at)
        late_signals = self._law.settle()
        self._vision.forward(now_s, arrival.is_new, self._estimating.for_vision(now_s))
        self._tell(
            Tick(
                time_s=now_s,
                late_s=late_s,
                frame_received_s=arrival.frame_received_s,
                sent_s=sent_s,
                vehicle=self.estimate.vehicle,
                age_s=estimator.age_s(self.estimate, now_s),
                status=arrival.status or self._autopilot.status(),
                flight=self._flight,
                reference=state_machine.reference_at(flown, now_s) if pipeline else None,
                pipeline=pipeline,
                limited=limited,
                late_signals=late_signals,
                arms=self.arms.tick(now_s, self._flight) if self.arms is not None else None,
                events=self._events,
                frame=arrival.frame,
                ground_pose=arrival.pose,
                estimate=self.estimate,
                law=self.law_name,
                wire=wire,
                link=None if self.remote is None else self.remote.tick,
                stage=before.stage,
            )
        )

    def _send(
        self, limited: LimitedSetpoint | None, now_s: float, status: AutopilotStatus
    ) -> tuple[Wire | None, float]:
        """Send this cycle's setpoint with the autopilot's horizon corrected; when it had left (s), or NaN."""
        if limited is None:
            return None, math.nan
        setpoint = limited.setpoint
        wire = self._horizon.correct(setpoint, self._estimating.latest, status, self._events, self._flight, now_s)
        return wire, self._stream.send(setpoint, None if wire is None else wire.setpoint)

    def _held(self) -> _Held:
        """Return what this cycle's setpoint will change."""
        return self._stream.on, self._stream.sent, self._law.at_max_thrust, self._law.fault, self._horizon.fault

    def _cycle(self, now_s: float, late_s: float, status: AutopilotStatus, held: _Held) -> Cycle:
        """Return what the checks look at: everything as it is before this cycle's setpoint."""
        streaming, sent, at_max_thrust, law_fault, horizon_fault = held
        return Cycle(
            time_s=now_s,
            late_s=late_s,
            frame=self._mocap.latest(),
            estimate=self._estimating.latest,
            status=status,
            streaming=streaming,
            sent=sent,
            at_max_thrust=at_max_thrust,
            law_fault=law_fault,
            arm_fault=self.arms.fault if self.arms is not None else "",
            horizon_fault=horizon_fault,
            link=None if self.remote is None else self.remote.status,
            command_age_s=0.0 if self.remote is None else self.remote.command_age_s,
        )

    def _may_supervise_behind(self, arrival: Arrival, status: AutopilotStatus, now_s: float) -> bool:
        """Return True where checks and state machine may run after the setpoint has left.

        Nothing is wrong and nothing has happened, and in these phases the setpoint does not depend on the state
        machine's next step: a reference continues over its legs. docs/safety.md says for each fault why it may.
        """
        latest, vehicle = self._estimating.latest, self._estimating.latest.vehicle
        return (
            self._flight.airborne
            and self._flight.phase in _ALONG_THE_LEGS
            and not self._events
            and arrival.frame is not None
            and latest.verdict is Verdict.ACCEPTED
            and vehicle is not None
            and not (vehicle.others or self._law.pushed)
            and now_s - vehicle.time_s <= self._safety.coast_s
            and status.armed
            and status.mode is FlightMode.OFFBOARD
            and self.remote is None
            and not (self._law.fault or self._horizon.fault or self._stream.failing)
            and (self.arms is None or not self.arms.fault)
        )

    def _supervise(self, cycle: Cycle) -> None:
        """Update the faults, judge whether the autopilot may see what we see, and let the state machine go on."""
        self._events, unsent = self._health.look(cycle, self._flight), self._stream.fault(cycle.time_s)
        if unsent is not None:
            self._events = (*(event for event in self._events if event.fault is not unsent.fault), unsent)
        self._vision.judge(self._events, cycle.status.armed, self._flight.cause)
        self._advance(cycle.time_s, cycle.status)

    def _advance(self, now_s: float, status: AutopilotStatus) -> None:
        self._enter(state_machine.advance(self._flight, self._facts(now_s, status), self._rules))

    def _facts(self, now_s: float, status: AutopilotStatus) -> FlightInputs:
        thrust = float(self._stream.law_sent.thrust) if self._stream.on else math.nan
        facts = facts_of(now_s, self._estimating.latest.vehicle, status, self.arms, self._events, thrust)
        return replace(facts, pushed=True, pushed_now=self._law.pushed_now) if self._law.pushed else facts

    def _facts_now(self) -> FlightInputs:
        return self._facts(self._clock.now_s(), self._autopilot.status())

    def _tell(self, tick: Tick) -> None:
        """Whoever looks on cannot stop a flight: one that raises is not told any more."""
        if self._sink is None:
            return
        try:
            self._sink(tick)
        except Exception:
            LOG.exception("the tick's listener failed and is dropped")
            self._sink = None

    def _keep_or_end_stream(self, now_s: float) -> None:
        """Keep the stream in flight and until PX4 has begun to land; then end it and release the watchdog timer."""
        flight, offboard = self._flight, self._autopilot.status().mode is FlightMode.OFFBOARD
        landing = 0.0 <= now_s - flight.landing_asked_s <= self._safety.land_refused_s and offboard
        if flight.phase in STREAMING or landing:
            self._stream.renew()
        else:
            self._stream.stop()

    def _enter(self, flight: FlightState) -> None:
        """Take over the flight's next state, and do what its changes ask of the loop."""
        before, self._flight = self._flight, flight
        if flight.action is not None and flight is not before:
            self._calls.begin(flight.action)
        if flight.airborne and not before.airborne:
            self._pipeline.forget()  # what was integrated on the ground would be of the ground
        if flight.phase is before.phase:
            return
        LOG.info("%s -> %s%s", before.phase, flight.phase, f": {flight.reason}" if flight.reason else "")
        if flight.phase is Phase.PREFLIGHT:
            self._calls.forget()
        if flight.phase in {Phase.PREFLIGHT, Phase.RESUME}:
            thrust = self._rules.hover_thrust if flight.phase is Phase.RESUME else 0.0
            self._stream.begin(idle_setpoint(flight.yaw_rad, thrust))
            if flight.phase is Phase.RESUME:  # MAVSDK asks for no OFFBOARD before it has a setpoint
                self._stream.send(idle_setpoint(flight.yaw_rad, thrust))
            self._law.trust()
            self._horizon.reset()
            self._vision.trusted = True
        elif flight.phase is Phase.HANDED_OVER and before.phase in COMMANDED:
            self._leave_level(before)

    def _leave_level(self, before: FlightState) -> None:
        """The last setpoint of ours, which PX4 holds until it lands: level and sinking gently, not the law's.

        A pilot who has the vehicle gets none.
        """
        silent = self._flight.cause is Fault.AUTOPILOT_SILENT and before.airborne
        if not self._stream.on or not (self._flight.level is FailsafeAction.AUTOPILOT_LAND or silent):
            return
        last = idle_setpoint(before.yaw_rad)
        if before.airborne:
            yaw_rad = float(yaw_of(self._stream.law_sent.q_w_flu_wxyz))
            last = self._pipeline.level(yaw_rad, SINKING * self._rules.hover_thrust)
        self._stream.send(last)

    def hand_over(self, reason: str) -> None:
        """The autopilot lands what we still fly; nothing where we do not."""
        if self._flight.phase in COMMANDED | {Phase.RESUME}:
            inputs = self._facts_now()
            flight, _ = state_machine.apply_request(self._flight, HandOverRequest(reason), inputs, self._rules)
            self._enter(flight)

    def _see_without_checks(self, now_s: float) -> None:
        new = self._estimating.read(self._autopilot.status()).is_new
        if self._estimating.latest.verdict is Verdict.STARTED:  # jumped, or lost for long
            self._vision.trusted = False
        self._vision.forward(now_s, new, self._estimating.for_vision(now_s))

    def _supervise_without_checks(self, now_s: float) -> None:
        if self._flight.phase in {Phase.HANDED_OVER, Phase.TERMINATED}:
            self._advance(now_s, self._autopilot.status())
