"""The arms' state machine, tied to the flight's: facts and requests in, phase and joint goal out. Pure.

Arms move only where the flight allows it, fold before a landing, and after a fault hold still: neither limp nor moving.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from companion.arms.model import JOINT_NAMES
from companion.arms.trajectory import JointTrajectory, Times, at_rest
from companion.core.interfaces import ArmError
from companion.core.types import Array, JointMotion
from companion.supervisor.flight_state import Phase


@dataclass(frozen=True)
class Braked:
    """A trajectory whose own time slows down, from `begun_s` on, and stands still after `duration_s`."""

    inner: JointTrajectory
    begun_s: float
    duration_s: float

    @property
    def pieces_s(self) -> Array:
        """Eighths."""
        return np.linspace(0.0, self.duration_s, 9)

    def at(self, time_s: Times) -> JointMotion:
        """Return the motion `time_s` after the braking began."""
        x = np.clip(np.asarray(time_s) / self.duration_s, 0.0, 1.0)
        gone_s = self.duration_s * x * (1.0 - x**3 * (2.5 - 3.0 * x + x * x))
        speed = (1.0 - x**3 * (10.0 - 15.0 * x + 6.0 * x * x))[..., None]
        slowing_ps = (-30.0 * x * x * (1.0 - x) ** 2 / self.duration_s)[..., None]
        motion = self.inner.at(self.begun_s + gone_s)
        return JointMotion(
            motion.position_rad,
            motion.velocity_radps * speed,
            motion.acceleration_radps2 * speed * speed + motion.velocity_radps * slowing_ps,
        )


class ArmPhase(StrEnum):
    """Phase of the arms."""

    OFF = "off"
    """Limp, or holding by what an earlier program left: not ours to move."""
    HOLDING = "holding"
    MOVING = "moving"
    STOWING = "stowing"
    FAULT = "fault"
    """A servo failed: everything that can, holds still until the operator clears it."""


MAY_MOVE = frozenset({Phase.STANDBY, Phase.HOLD, Phase.TRACK, Phase.DISARMED})
"""Flight phases in which the operator's motions are run; on the ground only while nothing is armed."""
MUST_STOW = frozenset({Phase.STOW, Phase.HANDED_OVER})
"""Flight phases that end on the floor soon: folded arms survive it."""


_BRAKING_S = 0.5
_SAME_RAD = 0.02
"""A motion that begins so near to where the joints are held begins there."""


class ArmAction(StrEnum):
    """Action that the machine asks of the bus, apart from goals; set for one cycle."""

    HOLD = "hold"
    TORQUE_OFF = "torque off"


@dataclass(frozen=True)
class ArmRules:
    """Numbers of the machine, and the way to the stowed pose."""

    stow_from: Callable[[Array], JointTrajectory | None]
    """A motion from a pose (8,) to the stowed one, None if it is that one; ArmError when there is no way."""
    torque_off_after_landing: bool = False


@dataclass(frozen=True, kw_only=True)
class ArmFacts:
    """Inputs of the state machine at one cycle."""

    time_s: float
    held_rad: Array
    """The goals that hold the joints (8,), NaN for one that obeys none."""
    obey: bool
    """Every joint has torque and takes our goals."""
    fault: str
    """The first latched fault in words; empty when there is none."""
    stowed: bool
    flight: Phase
    touched_down: bool


@dataclass(frozen=True, kw_only=True)
class ArmState:
    """The machine's state."""

    phase: ArmPhase = ArmPhase.OFF
    since_s: float = 0.0
    motion: JointTrajectory | None = None
    """Motion that is played; while HOLDING, a motion that comes to rest."""
    started_s: float = 0.0
    hold_rad: Array | None = None
    """Held joint angles (rad); None while the joints move or are limp."""
    action: ArmAction | None = None
    reason: str = ""
    """Why the last motion was ended before its time; empty when it was not."""
    no_way: str = ""
    """Why the arms cannot be folded from where they are; empty when they can, or nobody asked."""
    released: bool = False
    """After this landing the torque has been taken off once."""


def goal_at(arms: ArmState, time_s: float) -> JointMotion | None:
    """Return the commanded joint motion at a time (s), which may lie ahead; None while there is no goal."""
    if arms.motion is not None:
        return arms.motion.at(time_s - arms.started_s)
    return None if arms.hold_rad is None else at_rest(arms.hold_rad)


def refusal(arms: ArmState, motion: JointTrajectory, flight: Phase) -> str:
    """Return why a motion may not begin now; empty when it may."""
    if arms.hold_rad is None:
        return f"the arms must hold still first, they are {arms.phase}"
    if flight not in MAY_MOVE:
        return f"the arms may not move in flight phase {flight}"
    off_rad = np.abs(motion.at(0.0).position_rad - arms.hold_rad)
    worst = int(np.argmax(off_rad))
    if off_rad[worst] > _SAME_RAD:
        return f"the motion begins {math.degrees(off_rad[worst]):.0f} degrees from where {JOINT_NAMES[worst]} is held"
    return ""


def play(arms: ArmState, motion: JointTrajectory, facts: ArmFacts) -> ArmState:
    """Begin a motion that was planned from where the joints are held; ignored where `refusal` has a reason."""
    if refusal(arms, motion, facts.flight):
        return arms
    return _begin(arms, ArmPhase.MOVING, motion, facts)


def advance(arms: ArmState, facts: ArmFacts, rules: ArmRules) -> ArmState:
    """Advance by one cycle."""
    arms = replace(arms, action=None) if arms.action else arms
    if facts.flight is not Phase.DISARMED and arms.released:
        arms = replace(arms, released=False)
    if facts.fault:
        held = {"motion": None, "hold_rad": None, "action": ArmAction.HOLD, "reason": facts.fault}
        return arms if arms.phase is ArmPhase.FAULT else _enter(arms, ArmPhase.FAULT, facts, **held)
    if not facts.obey:
        return arms if arms.phase is ArmPhase.OFF else _enter(arms, ArmPhase.OFF, facts, motion=None, hold_rad=None)
    if arms.phase in {ArmPhase.OFF, ArmPhase.FAULT}:
        return _enter(arms, ArmPhase.HOLDING, facts, motion=None, hold_rad=facts.held_rad, reason="")
    if facts.flight in MUST_STOW and arms.phase is ArmPhase.MOVING:
        return stop(arms, facts, "")  # the fold begins at rest
    if arms.phase is ArmPhase.MOVING and facts.flight not in MAY_MOVE:
        return stop(arms, facts, f"arms may not move in flight phase {facts.flight}")
    return _next(arms, facts, rules)


def _next(arms: ArmState, facts: ArmFacts, rules: ArmRules) -> ArmState:
    """Hold after a motion; at rest, fold where the flight needs it, and release torque after the landing."""
    if arms.motion is not None:
        if facts.time_s - arms.started_s < arms.motion.duration_s:
            return arms
        end = arms.motion.at(arms.motion.duration_s)
        return _enter(arms, ArmPhase.HOLDING, facts, motion=None, hold_rad=end.position_rad)
    if facts.flight in MUST_STOW and not facts.stowed and not arms.no_way:
        return _stow(arms, facts, rules)
    landed = facts.flight is Phase.DISARMED and facts.touched_down
    if landed and rules.torque_off_after_landing and not arms.released:
        return replace(arms, action=ArmAction.TORQUE_OFF, released=True)
    return arms


def _stow(arms: ArmState, facts: ArmFacts, rules: ArmRules) -> ArmState:
    """Begin to fold; if there is no way, the arms stay as they are, and the reason is given once."""
    assert arms.hold_rad is not None
    try:
        fold = rules.stow_from(arms.hold_rad)
    except ArmError as error:
        return replace(arms, no_way=f"the arms cannot be stowed: {error}")
    return arms if fold is None else _begin(arms, ArmPhase.STOWING, fold, facts)


def _begin(arms: ArmState, phase: ArmPhase, motion: JointTrajectory, facts: ArmFacts) -> ArmState:
    return _enter(arms, phase, facts, motion=motion, started_s=facts.time_s, hold_rad=None, reason="", no_way="")


def stop(arms: ArmState, facts: ArmFacts, reason: str) -> ArmState:
    """Stop along the planned way, and hold."""
    if arms.motion is None or isinstance(arms.motion, Braked):
        return arms
    braking = Braked(arms.motion, facts.time_s - arms.started_s, _BRAKING_S)
    return _enter(arms, ArmPhase.HOLDING, facts, motion=braking, started_s=facts.time_s, reason=reason)


def _enter(arms: ArmState, phase: ArmPhase, facts: ArmFacts, **changes: Any) -> ArmState:
    return replace(arms, phase=phase, since_s=facts.time_s, **changes)
