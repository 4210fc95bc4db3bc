"""One tick: read, estimate, supervise, control, limit, send, record. Short enough to read aloud."""

import asyncio
import logging
import math
from dataclasses import dataclass, field

import numpy as np

from companion.arm_stage import ArmStage
from companion.autopilot_calls import AutopilotCalls
from companion.config import CompanionConfig
from companion.control.controller import Controller
from companion.control.guard import SINKING, Guard
from companion.control.limits import Gated
from companion.control_stage import Asked, ControlStage, idle_setpoint, same_setpoint
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState
from companion.health_stage import UNTRUSTED, Cycle, HealthStage, Sides, facts_of
from companion.ports import ArmBus, Autopilot, Clock, CompanionError, DeadMan, MocapSource
from companion.supervisor import phases
from companion.supervisor.faults import Event, Reaction
from companion.supervisor.flight import (
    COMMANDED,
    STREAMING,
    Action,
    Facts,
    Flight,
    HandOver,
    Phase,
    Prepare,
    Request,
    Resume,
)
from companion.tick import Tick, TickSink
from companion.tick_timer import TickTimer
from companion.types import FlightMode
from companion.vision_stage import VisionStage

LOG = logging.getLogger(__name__)

_TURNS = 3
"""Turns of the event loop after which every socket has been read."""
_NOTHING = np.zeros(3)


@dataclass(frozen=True)
class Devices:
    """The real or simulated parts the loop speaks to."""

    mocap: MocapSource
    autopilot: Autopilot
    clock: Clock
    dead_man: DeadMan
    arms: ArmBus | None = None
    sides: Sides = field(default_factory=Sides)


class FlightLoop:
    """Owns the flight's phase and calls, in order, what is pure and what is a device."""

    def __init__(self, devices: Devices, controller: Controller, config: CompanionConfig, sink: TickSink) -> None:
        self._mocap, self._autopilot, self._clock = devices.mocap, devices.autopilot, devices.clock
        self._dead_man = devices.dead_man
        self._calls = AutopilotCalls(devices.autopilot)
        self._sink: TickSink | None = sink
        self._period_s = 1.0 / config.control.rate_hz
        self._rules, self._safety = config.flight_rules(), config.safety.rules()
        model, limits = config.vehicle.thrust_model(), config.limits.limits()
        guard = Guard(limits, model, config.fence.fence(), self._safety.coast_s, self._safety.degraded_s)
        self._stage = ControlStage(controller, model, limits, guard=guard)
        self._health = HealthStage(self._safety, config.fence.fence(), devices.sides)
        self.arms = self._arm_stage(devices.arms, config)
        """The arms' part; None for a vehicle without."""
        self._estimator_params = EstimatorParams(delay_s=config.mocap.delay_s)
        self._vision = VisionStage(devices.autopilot, config.px4.vision_rate_hz, self._period_s)
        self._estimate = EstimatorState()
        self._frame_number: int | None = None
        self._flight = Flight()
        self._streaming = False
        self._ticking = False
        self._last_tick_s = -math.inf
        self._law_fault = ""
        self._not_finite = 0
        self._max_thrust, self._at_max_thrust = limits.max_thrust, False
        self.missed_cycles = 0
        """Whole periods that passed without a cycle."""

    @staticmethod
    def _arm_stage(bus: ArmBus | None, config: CompanionConfig) -> ArmStage | None:
        if bus is None or config.arms is None:
            return None
        return ArmStage(bus, config.arms, config.vehicle_model(), config.airframe(), 1.0 / config.control.rate_hz)

    @property
    def flight(self) -> Flight:
        """The present phase and all that goes with it."""
        return self._flight

    @property
    def estimate(self) -> EstimatorState:
        """What is known of the vehicle's motion."""
        return self._estimate

    @property
    def events(self) -> tuple[Event, ...]:
        """What is wrong now."""
        return self._health.events

    @property
    def action_failure(self) -> str:
        """Why the autopilot did not do what the loop asked of it on its own; empty if it did."""
        return self._calls.failure

    def refusal(self, wanted: Request) -> str:
        """Why an operator's request cannot be met now; empty when it can."""
        status = self._autopilot.status()
        if isinstance(wanted, Prepare) and (status.armed or status.in_air):
            # it would stream zero thrust, and PX4 takes OFFBOARD up by itself when a stream begins
            return "the vehicle is already armed or in the air"
        if isinstance(wanted, Resume) and not status.in_air:
            return "the autopilot says that the vehicle is on the ground"
        return phases.refusal(self._flight, wanted, self._facts(self._clock.now_s()), self._rules)

    def ask(self, wanted: Request) -> bool:
        """Hand in an operator's request; False when it is refused."""
        if self.refusal(wanted):
            return False
        self._enter(phases.request(self._flight, wanted, self._facts(self._clock.now_s()), self._rules))
        return True

    async def run(self) -> None:
        """Tick until cancelled. What a device or the law raises is raised, after the autopilot was told to land."""
        timer = TickTimer(self._period_s, self._clock.now_s() + self._period_s)
        self._ticking = True
        try:
            while True:
                frame_arrived_s = await self._next_start(timer)
                now_s = self._clock.now_s()
                self.tick(now_s, timer.begin(now_s, frame_arrived_s))
                self.missed_cycles = timer.missed
        except asyncio.CancelledError:
            raise
        except BaseException as error:
            self._ticking = False
            await self._abandon(str(error) if isinstance(error, CompanionError) else f"{type(error).__name__}: {error}")
            raise
        finally:
            self._ticking = False
            await self._calls.cancel()
            self._end_stream()
            if self.arms is not None:
                await self.arms.close()

    async def close(self) -> None:
        """Leave no vehicle in the air to a stream that goes on by itself, and no arm in the middle of a motion."""
        if self.arms is not None:
            self.arms.stop("the service was closed")
        await self._abandon("the service was closed")

    async def _next_start(self, timer: TickTimer) -> float | None:
        """Wait for the frame that starts the next cycle or for the deadline; the frame's arrival (s), or None."""
        while True:
            left_s = timer.deadline_s - self._clock.now_s()
            if left_s <= 0.0:
                return await self._catch_up()
            if await self._mocap.wait_frame(left_s):
                frame = self._mocap.latest()
                if frame is not None and not timer.frame_is_early(frame.received_s):
                    return frame.received_s

    async def _catch_up(self) -> float | None:
        """The loop is behind: let in what has arrived meanwhile, before anything is concluded from its absence."""
        for _ in range(_TURNS):
            await asyncio.sleep(0)
        frame = self._mocap.latest()
        return frame.received_s if frame is not None and frame.frame != self._frame_number else None

    def tick(self, now_s: float, late_s: float) -> None:
        """One control cycle at `now_s`, begun `late_s` late."""
        frame_received_s = self._read()
        if self.arms is not None:
            self.arms.read(now_s, self._flight)
        events = self._look(now_s, late_s)
        facts = self._facts(now_s)
        self._enter(phases.advance(self._flight, facts, self._rules))
        asked, gated = self._control_or_fail(facts)
        sent_s = self._send(gated)
        self._keep_or_end_stream()
        late_signals = self._stage.settle()
        self._vision.forward(now_s, math.isfinite(frame_received_s), self._estimate)
        self._last_tick_s = now_s
        self._tell(
            Tick(
                now_s,
                late_s,
                frame_received_s,
                sent_s,
                self._estimate.vehicle,
                self._age_s(now_s),
                self._autopilot.status(),
                self._flight,
                phases.reference_at(self._flight, now_s) if asked else None,
                asked,
                gated,
                late_signals,
                self.arms.tick(now_s, self._flight) if self.arms is not None else None,
                events,
            )
        )

    def _read(self) -> float:
        """Feed the newest frame to the estimator; its arrival (s), or NaN when there is no new one."""
        frame = self._mocap.latest()
        if frame is None or frame.frame == self._frame_number:
            return math.nan
        self._frame_number = frame.frame
        self._estimate = estimator.step(self._estimate, frame, self._estimator_params)
        return frame.received_s

    def _look(self, now_s: float, late_s: float) -> tuple[Event, ...]:
        """What is wrong now; a pose that is not to be trusted is withheld from the autopilot from now on."""
        cycle = Cycle(
            now_s,
            late_s,
            self._mocap.latest(),
            self._estimate,
            self._autopilot.status(),
            self._streaming,
            self._stage.sent if self._streaming else None,
            self._at_max_thrust,
            self._law_fault,
            self.arms.fault if self.arms is not None else "",
        )
        events = self._health.look(cycle, self._flight)
        if events and self._flight.airborne and any(event.fault in UNTRUSTED for event in events):
            self._vision.trusted = False
        return events

    def _age_s(self, now_s: float) -> float:
        vehicle = self._estimate.vehicle
        return math.inf if vehicle is None else now_s - vehicle.time_s

    def _facts(self, now_s: float) -> Facts:
        return facts_of(now_s, self._estimate.vehicle, self._autopilot.status(), self.arms, self._health.events)

    def _control_or_fail(self, facts: Facts) -> tuple[Asked | None, Gated | None]:
        """A law that raises, or goes on giving what is no number, has lost the vehicle; the loop and vision go on."""
        try:
            asked, gated = self._control(facts)
        except Exception as error:
            LOG.exception("the control law failed")
            self._law_fault = f"the control law failed: {type(error).__name__}: {error}"
            return None, None
        if gated is not None and gated.failure:
            self._law_fault = f"the guard failed: {gated.failure}"
        bad = gated is not None and bool(gated.not_finite.any())
        self._not_finite = self._not_finite + 1 if bad else 0
        if self._not_finite > self._safety.not_finite_cycles:
            self._law_fault = f"the control law gave no finite command for {self._safety.not_finite_cycles} cycles"
        self._at_max_thrust = asked is not None and float(asked.gated.setpoint.thrust) >= self._max_thrust
        return asked, gated

    def _leave_level(self, flight: Flight) -> None:
        """The last setpoint of ours, which MAVSDK repeats until PX4 lands: level and sinking gently, not the law's."""
        last = idle_setpoint(flight.yaw_rad)
        if flight.airborne:
            yaw_rad = phases.reference_at(flight, self._clock.now_s()).yaw_rad
            last = self._stage.level(yaw_rad, SINKING * self._rules.hover_thrust)
        self._autopilot.send_setpoint(last)
        self._stage.sent = last

    def _tell(self, tick: Tick) -> None:
        """Whoever looks on cannot stop a flight: one that raises is not told any more."""
        if self._sink is None:
            return
        try:
            self._sink(tick)
        except Exception:
            LOG.exception("the tick's listener failed and is dropped")
            self._sink = None

    def _control(self, facts: Facts) -> tuple[Asked | None, Gated | None]:
        """This cycle's setpoint, through the gate; None in phases that send nothing."""
        flight, vehicle = self._flight, self._estimate.vehicle
        if vehicle is None or flight.phase not in STREAMING:
            return None, None
        dt_s = min(max(facts.time_s - self._last_tick_s, 0.2 * self._period_s), 5.0 * self._period_s)
        if not flight.airborne:
            thrust = phases.ground_thrust(flight, facts.time_s, self._rules)
            return None, self._stage.on_ground(flight.yaw_rad, thrust, dt_s)
        ahead = phases.reference_at(flight, facts.time_s + self._stage.preview_s)
        known = self.arms.known_accel_w_mps2(vehicle.q_w_flu_wxyz) if self.arms is not None else _NOTHING
        asked = self._stage.fly(vehicle, self._age_s(facts.time_s), ahead, dt_s, known)
        return asked, asked.gated

    def _send(self, gated: Gated | None) -> float:
        """Send what the gate let through if the autopilot does not have it yet; the time it had left (s), or NaN."""
        if gated is None or (self._streaming and same_setpoint(gated.setpoint, self._stage.sent)):
            return math.nan
        self._autopilot.send_setpoint(gated.setpoint)
        self._stage.sent, self._streaming = gated.setpoint, True
        return self._clock.now_s()

    def _keep_or_end_stream(self) -> None:
        """Setpoints leave only while we fly, or until PX4 has begun to land; without them the dead man may rest."""
        flight, offboard = self._flight, self._autopilot.status().mode is FlightMode.OFFBOARD
        landing = flight.phase is Phase.HANDED_OVER and flight.level is Reaction.AUTOPILOT_LAND and offboard
        if flight.phase not in STREAMING and not landing:
            self._end_stream()
        elif self._streaming:
            self._dead_man.renew()

    def _end_stream(self) -> None:
        if self._streaming:
            self._autopilot.stop_stream()
            self._streaming = False
        self._dead_man.release()

    def _enter(self, flight: Flight) -> None:
        """Take over the flight's next state, and do what its changes ask of the loop."""
        before, self._flight = self._flight, flight
        if flight.phase is not before.phase:
            LOG.info("%s -> %s%s", before.phase, flight.phase, f": {flight.reason}" if flight.reason else "")
        if flight.action is Action.AUTOPILOT_LAND and before.phase in COMMANDED and self._streaming:
            self._leave_level(before)
        if flight.phase is not before.phase and flight.phase in {Phase.PREFLIGHT, Phase.RESUME}:
            thrust = self._rules.hover_thrust if flight.phase is Phase.RESUME else 0.0
            self._stage.sent, self._streaming = idle_setpoint(flight.yaw_rad, thrust), False
            self._vision.trusted, self._law_fault = True, ""
        if flight.airborne and not before.airborne:
            self._stage.forget()  # what was integrated on the ground would be of the ground
        if flight.action is not None and flight is not before:
            self._calls.begin(flight.action)

    async def _abandon(self, reason: str) -> None:
        """The autopilot lands what is still flown, and we send nothing more.

        Waits until it has answered, and until the arms have folded.
        """
        if self._flight.phase in COMMANDED:
            facts = self._facts(self._clock.now_s())
            self._enter(phases.request(self._flight, HandOver(reason), facts, self._rules))
        ending = asyncio.create_task(self._end_stream_when_told(), name="companion.end_of_stream")
        try:
            await self._settle_arms()
        except Exception:
            LOG.exception("the arms could not be folded")
        await ending
        await self._calls.answered()

    async def _end_stream_when_told(self) -> None:
        """The level setpoint is repeated until PX4 has answered, but not for long: then its own failsafe lands."""
        end_s = self._clock.now_s() + self._safety.land_refused_s
        while self._calls.pending and self._clock.now_s() < end_s and not self._ticking:
            if self._streaming:
                self._dead_man.renew()
            await asyncio.sleep(self._period_s)
        if not self._ticking:
            self._end_stream()

    async def _settle_arms(self) -> None:
        """Let the arms fold, or at least come to rest, for as long as that may take; nothing else is done any more."""
        if self.arms is None:
            return
        end_s = self._clock.now_s() + self._rules.stow_time_s
        while self.arms.is_busy(self._flight) and self._clock.now_s() < end_s:
            if not self._ticking:
                self.arms.read(self._clock.now_s(), self._flight)
                self.arms.tick(self._clock.now_s(), self._flight)
            await asyncio.sleep(self._period_s)
