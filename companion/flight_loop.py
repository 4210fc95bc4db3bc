"""One tick: read, estimate, supervise, control, limit, send, record. Short enough to read aloud."""

import asyncio
import logging
import math
from collections.abc import Awaitable
from dataclasses import dataclass

import numpy as np

from companion.arm_stage import ArmStage
from companion.config import CompanionConfig
from companion.control.controller import Controller
from companion.control.frames import yaw_of
from companion.control.limits import Gated
from companion.control_stage import Asked, ControlStage, idle_setpoint, same_setpoint
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState, Verdict
from companion.ports import ArmBus, Autopilot, Clock, CompanionError, MocapSource
from companion.supervisor import phases
from companion.supervisor.flight import (
    COMMANDED,
    IN_THE_AIR,
    STREAMING,
    Action,
    Facts,
    Flight,
    HandOver,
    Phase,
    Prepare,
    Request,
)
from companion.tick import Tick, TickSink
from companion.tick_timer import TickTimer

LOG = logging.getLogger(__name__)

_NOT_FINITE_CYCLES = 20
_SINKING = 0.97
"""Share of hover thrust with which the vehicle comes down gently while nobody steers it."""
_TURNS = 3
"""Turns of the event loop after which every socket has been read."""
_NOTHING = np.zeros(3)
_USED = frozenset({Verdict.ACCEPTED, Verdict.STARTED})


@dataclass(frozen=True)
class Devices:
    """The real or simulated parts the loop speaks to."""

    mocap: MocapSource
    autopilot: Autopilot
    clock: Clock
    arms: ArmBus | None = None


class FlightLoop:
    """Owns the flight's phase and calls, in order, what is pure and what is a device."""

    def __init__(self, devices: Devices, controller: Controller, config: CompanionConfig, sink: TickSink) -> None:
        self._mocap, self._autopilot, self._clock = devices.mocap, devices.autopilot, devices.clock
        self._sink: TickSink | None = sink
        self._not_finite = 0
        self._period_s = 1.0 / config.control.rate_hz
        self._rules = config.flight_rules()
        self._stage = ControlStage(controller, config.vehicle.thrust_model(), config.limits.limits())
        self.arms = self._arm_stage(devices.arms, config)
        """The arms' part; None for a vehicle without."""
        self._estimator_params = EstimatorParams(delay_s=config.mocap.delay_s)
        self._vision_period_s = 1.0 / config.px4.vision_rate_hz if config.px4.vision_rate_hz > 0.0 else math.inf
        self._vision_due_s = 0.0
        self._vision_trusted = True
        self._estimate = EstimatorState()
        self._frame_number: int | None = None
        self._flight = Flight()
        self._streaming = False
        self._ticking = False
        self._last_tick_s = -math.inf
        self._tasks: set[asyncio.Task[None]] = set()
        self.missed_cycles = 0
        """Whole periods that passed without a cycle."""
        self.action_failure = ""
        """Why the autopilot did not do what the loop asked of it on its own; empty if it did."""

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

    def ask(self, wanted: Request) -> bool:
        """Hand in an operator's request; False when it does not fit the phase."""
        status = self._autopilot.status()
        if isinstance(wanted, Prepare) and (status.armed or status.in_air):
            return False  # it would stream zero thrust, and PX4 takes OFFBOARD up by itself when a stream begins
        fits = phases.can(self._flight, wanted)
        if fits:
            facts = self._facts(self._clock.now_s())
            self._enter(phases.request(self._flight, wanted, facts, self._rules))
        return fits

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
            for task in list(self._tasks):
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
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
        self._judge_estimate()
        if self.arms is not None:
            self.arms.read(now_s, self._flight)
        facts = self._facts(now_s)
        self._enter(phases.advance(self._flight, facts, self._rules))
        asked, gated = self._control_or_hand_over(facts)
        sent_s = self._send(gated)
        late_signals = self._stage.settle()
        self._forward_vision(now_s, frame_received_s)
        self._last_tick_s = now_s
        self._tell(
            Tick(
                now_s,
                late_s,
                frame_received_s,
                sent_s,
                self._estimate.vehicle,
                facts.mocap_age_s,
                self._autopilot.status(),
                self._flight,
                phases.reference_at(self._flight, now_s) if asked else None,
                asked,
                gated,
                late_signals,
                self.arms.tick(now_s, self._flight) if self.arms is not None else None,
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

    def _facts(self, now_s: float) -> Facts:
        status, vehicle = self._autopilot.status(), self._estimate.vehicle
        if vehicle is None:
            nowhere = np.full(3, np.nan)
            return Facts(now_s, nowhere, nowhere, 0.0, math.inf, status.armed, status.mode, *self._of_the_arms())
        yaw_rad = float(yaw_of(vehicle.q_w_flu_wxyz))
        age_s = now_s - vehicle.time_s
        position, velocity = vehicle.position_w_m, vehicle.velocity_w_mps
        return Facts(now_s, position, velocity, yaw_rad, age_s, status.armed, status.mode, *self._of_the_arms())

    def _of_the_arms(self) -> tuple[bool, str, str]:
        """Whether they are stowed, what is wrong with them, and why they cannot be stowed."""
        arms = self.arms
        return (True, "", "") if arms is None else (arms.stowed, arms.fault, arms.state.no_way)

    def _judge_estimate(self) -> None:
        """A filter that had to begin anew in the air means that motion capture jumped: nothing known before holds."""
        if self._flight.airborne and self._estimate.verdict is Verdict.STARTED:
            self._vision_trusted = False  # the autopilot, landing on its own, must not follow the jump either
            self._hand_over("motion capture jumped, or came back after a gap, by more than the vehicle can move")

    def _control_or_hand_over(self, facts: Facts) -> tuple[Asked | None, Gated | None]:
        """A law that raises, or goes on giving what is no number, has lost the vehicle; the loop and vision go on."""
        try:
            asked, gated = self._control(facts)
        except Exception as error:
            LOG.exception("the control law failed")
            self._hand_over(f"the control law failed: {type(error).__name__}: {error}")
            return None, None
        bad = gated is not None and bool(gated.not_finite.any())
        self._not_finite = self._not_finite + 1 if bad else 0
        if self._not_finite > _NOT_FINITE_CYCLES:
            self._hand_over(f"the control law gave no finite command for {_NOT_FINITE_CYCLES} cycles")
            return asked, None
        return asked, gated

    def _hand_over(self, reason: str) -> None:
        """Let the autopilot land. MAVSDK goes on re-sending our last setpoint until it does: that one must be level."""
        facts = self._facts(self._clock.now_s())
        self._enter(phases.request(self._flight, HandOver(reason), facts, self._rules))

    def _leave_level(self) -> None:
        """The last setpoint of ours: level and sinking gently, whatever the law wanted last."""
        level = self._stage.level(self._flight.yaw_rad, _SINKING * self._rules.hover_thrust)
        self._autopilot.send_setpoint(level)
        self._stage.sent = level

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
        asked = self._stage.fly(vehicle, facts.mocap_age_s, ahead, dt_s, known)
        return asked, asked.gated

    def _send(self, gated: Gated | None) -> float:
        """Send what the gate let through if the autopilot does not have it yet; the time it had left (s), or NaN."""
        if gated is None or (self._streaming and same_setpoint(gated.setpoint, self._stage.sent)):
            return math.nan
        self._autopilot.send_setpoint(gated.setpoint)
        self._stage.sent, self._streaming = gated.setpoint, True
        return self._clock.now_s()

    def _forward_vision(self, now_s: float, frame_received_s: float) -> None:
        """Every so often a new pose goes to the autopilot's own estimator, after the setpoint."""
        vehicle = self._estimate.vehicle
        fresh = math.isfinite(frame_received_s) and self._estimate.verdict in _USED and self._vision_trusted
        if vehicle is None or not fresh or now_s < self._vision_due_s - 0.5 * self._period_s:
            return
        self._vision_due_s = max(self._vision_due_s, now_s - self._vision_period_s) + self._vision_period_s
        self._autopilot.send_vision(vehicle.position_w_m, vehicle.q_w_flu_wxyz)

    def _enter(self, flight: Flight) -> None:
        """Take over the flight's next state, and do what its changes ask of the loop."""
        before, self._flight = self._flight, flight
        if flight.phase is not before.phase:
            LOG.info("%s -> %s%s", before.phase, flight.phase, f": {flight.reason}" if flight.reason else "")
        if flight.action is Action.AUTOPILOT_LAND and before.phase in IN_THE_AIR and self._streaming:
            self._leave_level()
        if flight.phase is Phase.PREFLIGHT and before.phase is not Phase.PREFLIGHT:
            self._stage.sent, self._streaming = idle_setpoint(flight.yaw_rad), False
            self._vision_trusted = True
        if flight.airborne and not before.airborne:
            self._stage.forget()  # what was integrated on the ground would be of the ground
        if flight.action is not None and flight is not before:
            self._act(flight.action)

    def _act(self, action: Action) -> None:
        call = self._autopilot.disarm() if action is Action.DISARM else self._autopilot.land()
        task = asyncio.get_running_loop().create_task(self._attempt(call), name=f"companion.{action}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _attempt(self, call: Awaitable[None]) -> None:
        try:
            await call
        except CompanionError as error:
            self.action_failure = str(error)
            LOG.error("%s", error)  # noqa: TRY400 - the sentence is for the operator, the trace would hide it
        except Exception as error:
            self.action_failure = f"{type(error).__name__}: {error}"
            LOG.exception("what the loop asked of the autopilot failed")

    async def _abandon(self, reason: str) -> None:
        """The autopilot lands what is still flown, and we send nothing more.

        Waits until it has answered, and until the arms have folded.
        """
        if self._flight.phase in COMMANDED:
            self._hand_over(reason)
        told = asyncio.gather(*self._tasks, return_exceptions=True)  # each logs its own failure
        try:
            await self._settle_arms()
        except Exception:
            LOG.exception("the arms could not be folded")
        await told

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
