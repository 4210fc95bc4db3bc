"""The arms' part of a tick: bus status in, state machine, joint goals out, and the push the law may know of."""

import asyncio
import logging
import math
from collections.abc import Awaitable
from dataclasses import dataclass, replace

import numpy as np

from companion.arms import state_machine
from companion.arms.feedforward import Airframe, ArmFeedforward, leads_of
from companion.arms.model import CLAWS, JOINT_NAMES
from companion.arms.planning import to_pose
from companion.arms.state_machine import ArmAction, ArmFacts, ArmPhase, ArmRules, ArmState, goal_at
from companion.arms.trajectory import JointTrajectory, at_rest
from companion.config.arms_config import ArmsConfig, Feedforward
from companion.control.controller import VehicleModel
from companion.core.interfaces import ArmBus, ArmError, CompanionError
from companion.core.types import ArmStatus, Array, JointMotion
from companion.geometry.frames import matrix_from_quat
from companion.supervisor.flight_state import FlightState, Phase

LOG = logging.getLogger(__name__)

_STALE_S = 0.3
"""Every joint unread for so much longer than `silent_s`, when the driver should have named them: its thread hangs."""


@dataclass(frozen=True)
class ArmTick:
    """State of the arms in one cycle, for recording and for observers."""

    phase: ArmPhase
    reason: str
    goal: JointMotion | None
    status: ArmStatus
    known_accel_w_mps2: Array


def feedforward_of(
    config: ArmsConfig, vehicle: VehicleModel, airframe: Airframe, period_s: float
) -> ArmFeedforward | None:
    """Return the arms' feed-forward for the law; None where it is off."""
    if config.feedforward is Feedforward.OFF:
        return None
    leads, with_tilt = leads_of(vehicle, config.servo_lag_s), config.feedforward is Feedforward.FULL
    return ArmFeedforward(config.model(), airframe, leads, period_s, with_tilt)


class ArmStep:
    """Holds the arms' state and their bus. Call `read`, then `known_accel_w_mps2`, then `tick`, once a cycle."""

    def __init__(
        self, bus: ArmBus, config: ArmsConfig, vehicle: VehicleModel, airframe: Airframe, period_s: float
    ) -> None:
        self._bus, self._config, self._model = bus, config, config.model()
        self._period_s, self._feedforward = period_s, feedforward_of(config, vehicle, airframe, period_s)
        self._stow_rad = config.stow_rad()
        self._rules = ArmRules(self.way_to_stow, config.torque_off_after_landing)
        self._state = ArmState()
        self._status = bus.status()
        self._off_stow = self._farthest_from_stow()
        self._facts: ArmFacts | None = None
        self._known_b = np.zeros(3)
        self._known = np.zeros(3)
        self._broken = ""
        """Error of this side of the bus; latched."""
        self._releasing: set[asyncio.Task[None]] = set()

    @property
    def state(self) -> ArmState:
        """Phase and goal."""
        return self._state

    @property
    def status(self) -> ArmStatus:
        """Return the bus's latest status."""
        return self._status

    @property
    def stowed(self) -> bool:
        """Folded, and at rest: a motion that passes the stowed pose is not there."""
        return self._state.motion is None and not self.off_stow

    def is_busy(self, flight: FlightState) -> bool:
        """Return True if a motion is running, or a fold is due and possible."""
        due = flight.phase in state_machine.MUST_STOW and bool(self.off_stow) and not self._state.no_way
        able = not self.fault and self._state.phase is not ArmPhase.OFF
        return able and (due or self._state.motion is not None)

    @property
    def held_rad(self) -> Array | None:
        """The joint angles (8,) that are asked for while nothing moves; None at all other times."""
        return self._state.hold_rad

    @property
    def fault(self) -> str:
        """Return the arms' faults in words, naming the joint; empty when there is none."""
        texts = [fault.text for fault in self._status.faults]
        return "; ".join([*texts, self._broken] if self._broken else texts)

    @property
    def off_stow(self) -> str:
        """The joint farthest from its stowed angle, in words; empty when the arms are stowed. Claws may be anywhere."""
        return self._off_stow

    def _farthest_from_stow(self) -> str:
        off = np.abs(self._status.position_rad - self._stow_rad)
        off[list(CLAWS)] = 0.0
        worst = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
        if off[worst] <= self._config.stowed_within_rad:
            return ""
        if math.isnan(off[worst]):
            return f"{JOINT_NAMES[worst]} was never read"
        return f"{JOINT_NAMES[worst]} is {math.degrees(off[worst]):.0f} degrees from its stowed angle"

    def read(self, now_s: float, flight: FlightState) -> None:
        """Take in what the bus says; never waits."""
        self._status = self._bus.status()
        self._off_stow = self._farthest_from_stow()
        unread_s = now_s - float(self._status.read_s.max())
        if unread_s > self._config.silent_s + _STALE_S and math.isfinite(unread_s) and not self._broken:
            self._broken = f"bus: no servo was read for {unread_s:.1f} s"
        held_rad = self._status.held_rad
        obey = bool(np.isfinite(held_rad).all())  # torque that an earlier program left is not ours to move with
        self._facts = ArmFacts(
            time_s=now_s,
            held_rad=held_rad,
            obey=obey,
            fault=self.fault,
            stowed=self.stowed,
            flight=flight.phase,
            touched_down=flight.touched_down,
        )

    def known_accel_w_mps2(self, q_w_flu_wxyz: Array) -> Array:
        """Return the acceleration that the arms' motion gives when a setpoint sent now acts, (3,) in W, m/s^2.

        Zero on the ground, and where feedforward is off.
        """
        self._known = np.asarray(matrix_from_quat(q_w_flu_wxyz) @ self._known_b)
        return self._known

    def tick(self, now_s: float, flight: FlightState) -> ArmTick:
        """Advance the state machine, send the joints' goals, and work out the push of the next cycle.

        A mistake in here stops the arms and is a fault like a servo's; the flight loop goes on.
        """
        try:
            return self._tick(now_s, flight)
        except Exception as error:
            LOG.exception("arms: the stage failed")
            self._broken = self._broken or f"the arms' software failed: {type(error).__name__}: {error}"
            self._bus.hold()
            self._known_b = np.zeros(3)
            return ArmTick(ArmPhase.FAULT, self._broken, None, self._status, self._known)

    def _tick(self, now_s: float, flight: FlightState) -> ArmTick:
        assert self._facts is not None
        before = self._state
        self._facts = replace(self._facts, flight=flight.phase, touched_down=flight.touched_down)
        self._state = state_machine.advance(before, self._facts, self._rules)
        self._announce(before)
        self._act(self._state.action)
        goal = goal_at(self._state, now_s)
        if goal is not None:
            self._bus.move(goal.position_rad)
        self._known_b = self._push_of_next_cycle(now_s + self._period_s, flight)
        return ArmTick(self._state.phase, self._state.reason, goal, self._status, self._known)

    def play(self, motion: JointTrajectory, flight: Phase) -> None:
        """Begin a motion that was planned from `held_rad`; ArmError with the reason why it may not begin now."""
        refusal = state_machine.refusal(self._state, motion, flight)
        if refusal or self._facts is None:
            raise ArmError(refusal or "the arms have not been read yet")
        self._state = state_machine.play(self._state, motion, replace(self._facts, flight=flight))

    def stop(self, reason: str) -> None:
        """Bring a motion to rest on its way."""
        if self._facts is not None:
            self._state = state_machine.stop(self._state, self._facts, reason)

    async def torque_on(self) -> None:
        """Hold where the joints are; ArmError naming the joints that refuse."""
        await self._bus.torque_on()

    async def torque_off(self) -> None:
        """Let every joint go limp; ArmError naming the joints that do not answer."""
        await self._bus.torque_off()

    async def clear_faults(self) -> None:
        """Forget what is latched, on this side, too; ArmError naming what is still wrong."""
        await self._bus.clear_faults()
        self._broken = ""

    async def close(self) -> None:
        """Wait for what was begun."""
        await asyncio.gather(*self._releasing, return_exceptions=True)

    def way_to_stow(self, held_rad: Array, floor_z_m: float | None = None) -> JointTrajectory | None:
        """Plan from where the joints are held (8,) to the stowed pose; return None where the goals are there already.

        Claws keep what they hold. `floor_z_m` is the floor's height in the body frame, for a vehicle that stands.
        Raises ArmError when there is no way.
        """
        claws = list(CLAWS)
        goal_rad, home_rad = self._stow_rad.copy(), self._config.home_rad()
        goal_rad[claws] = home_rad[claws] = held_rad[claws]
        if np.allclose(goal_rad, held_rad):
            return None
        return to_pose(self._model, held_rad, goal_rad, (home_rad,), floor_z_m).trajectory

    def _push_of_next_cycle(self, time_s: float, flight: FlightState) -> Array:
        """Acceleration (3,), body frame, that the arms give the vehicle when a setpoint of `time_s` has its effect."""
        if self._feedforward is None:
            return np.zeros(3)
        if not flight.airborne:
            self._feedforward.reset()
            return np.zeros(3)
        return self._feedforward.step(self.motion_at, time_s)

    def motion_at(self, time_s: float) -> JointMotion:
        """Return the commanded motion; without a goal, rest at the present angles, which still tilts the vehicle."""
        goal = goal_at(self._state, time_s)
        return at_rest(self._status.position_rad) if goal is None else goal

    def _announce(self, before: ArmState) -> None:
        if self._state.phase is before.phase and self._state.reason == before.reason:
            return
        say = LOG.error if self._state.phase is ArmPhase.FAULT else LOG.info
        why = f": {self._state.reason}" if self._state.reason else ""
        say("arms: %s -> %s%s", before.phase, self._state.phase, why)

    def _act(self, action: ArmAction | None) -> None:
        if action is ArmAction.HOLD:
            self._bus.hold()
        elif action is ArmAction.TORQUE_OFF:
            call = _attempt(self._bus.torque_off())
            task = asyncio.get_running_loop().create_task(call, name="companion.arms_torque_off")
            self._releasing.add(task)
            task.add_done_callback(self._releasing.discard)


async def _attempt(call: Awaitable[None]) -> None:
    try:
        await call
    except CompanionError as error:
        LOG.error("arms: %s", error)  # noqa: TRY400 - the sentence is for the operator, the trace would hide it
