"""The arms' state machine, tied to the flight's: facts and requests in, phase and joint goal out. Pure.

Arms move only where the flight allows it, fold before a landing, and after a fault hold still: neither limp nor moving.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from companion.arms.braking import Braked
from companion.arms.trajectory import JointTrajectory, at_rest
from companion.ports import ArmError
from companion.supervisor.flight import Phase
from companion.types import Array, JointMotion


class ArmPhase(StrEnum):
    """What the arms are doing."""

    OFF = "off"
    """Limp: no torque."""
    HOLDING = "holding"
    MOVING = "moving"
    STOWING = "stowing"
    """Folding for the landing."""
    FAULT = "fault"
    """A servo failed: everything that can, holds still until the operator clears it."""


MAY_MOVE = frozenset({Phase.STANDBY, Phase.HOLD, Phase.TRACK, Phase.DISARMED})
"""Flight phases in which the operator's motions are run; on the ground only while nothing is armed."""
MUST_STOW = frozenset({Phase.STOW, Phase.HANDED_OVER})
"""Flight phases that end on the floor soon: folded arms survive it."""


_BRAKING_S = 0.5
_NO_WAY = "the arms cannot be stowed"


class ArmAction(StrEnum):
    """What the machine has to ask of the bus, apart from goals; set for one cycle."""

    HOLD = "hold"
    TORQUE_OFF = "torque off"


@dataclass(frozen=True)
class ArmRules:
    """Numbers of the machine, and the way to the stowed pose."""

    stow_from: Callable[[JointMotion], JointTrajectory]
    """A motion from here to the stowed pose; ArmError when there is no way."""
    torque_off_after_landing: bool = False


@dataclass(frozen=True)
class ArmFacts:
    """What is known at a cycle."""

    time_s: float
    position_rad: Array
    torque_on: bool
    """Every joint has torque."""
    fault: str
    """The first latched fault in words; empty when there is none."""
    stowed: bool
    flight: Phase
    touched_down: bool


@dataclass(frozen=True)
class ArmState:
    """The machine's state."""

    phase: ArmPhase = ArmPhase.OFF
    since_s: float = 0.0
    motion: JointTrajectory | None = None
    """What is being run: while HOLDING, a motion coming to rest."""
    started_s: float = 0.0
    hold_rad: Array | None = None
    """Where the joints are held while nothing moves."""
    action: ArmAction | None = None
    reason: str = ""
    """Why the last motion was ended before its time; empty when it was not."""


def goal_at(arms: ArmState, time_s: float) -> JointMotion | None:
    """The joint motion asked for at a time (s), which may lie ahead; None while no goal is given."""
    if arms.motion is not None:
        return arms.motion.at(time_s - arms.started_s)
    return None if arms.hold_rad is None else at_rest(arms.hold_rad)


def can_play(arms: ArmState, flight: Phase) -> bool:
    """Whether a motion may begin."""
    return arms.phase is ArmPhase.HOLDING and arms.motion is None and flight in MAY_MOVE


def play(arms: ArmState, motion: JointTrajectory, facts: ArmFacts) -> ArmState:
    """Begin a motion, which has been planned from where the joints are held; ignored where it may not begin."""
    if not can_play(arms, facts.flight):
        return arms
    return replace(_enter(arms, ArmPhase.MOVING, facts), motion=motion, started_s=facts.time_s, reason="")


def advance(arms: ArmState, facts: ArmFacts, rules: ArmRules) -> ArmState:
    """One cycle: what the facts make of the phase."""
    arms = replace(arms, action=None) if arms.action else arms
    if facts.fault:
        return arms if arms.phase is ArmPhase.FAULT else _fail(arms, facts)
    if not facts.torque_on:
        return arms if arms.phase is ArmPhase.OFF else _limp(arms, facts)
    if arms.phase in {ArmPhase.OFF, ArmPhase.FAULT}:
        return replace(_enter(arms, ArmPhase.HOLDING, facts), motion=None, hold_rad=facts.position_rad, reason="")
    if facts.flight in MUST_STOW and arms.phase is not ArmPhase.STOWING and not facts.stowed:
        return _stow(arms, facts, rules)
    if arms.phase is ArmPhase.MOVING and facts.flight not in MAY_MOVE | MUST_STOW:
        return stop(arms, facts, f"arms may not move in flight phase {facts.flight}")
    return _next(arms, facts, rules)


def _next(arms: ArmState, facts: ArmFacts, rules: ArmRules) -> ArmState:
    """A motion that has ended is held; after the landing the torque may go."""
    if arms.motion is not None and facts.time_s - arms.started_s >= arms.motion.duration_s:
        end = arms.motion.at(arms.motion.duration_s)
        return replace(_enter(arms, ArmPhase.HOLDING, facts), motion=None, hold_rad=end.position_rad)
    landed = facts.flight is Phase.DISARMED and facts.touched_down
    if landed and rules.torque_off_after_landing and arms.phase is ArmPhase.HOLDING:
        return replace(arms, action=ArmAction.TORQUE_OFF)
    return arms


def _stow(arms: ArmState, facts: ArmFacts, rules: ArmRules) -> ArmState:
    """Once: if there is no way to fold them, the arms stay as they are and the landing does not wait for ever."""
    now = goal_at(arms, facts.time_s)
    if now is None or arms.reason.startswith(_NO_WAY):
        return _next(arms, facts, rules)
    try:
        motion = rules.stow_from(now)
    except ArmError as error:
        return replace(stop(arms, facts, ""), reason=f"{_NO_WAY}: {error}")
    return replace(_enter(arms, ArmPhase.STOWING, facts), motion=motion, started_s=facts.time_s, reason="")


def stop(arms: ArmState, facts: ArmFacts, reason: str) -> ArmState:
    """Come to rest along the way that was planned, and hold."""
    if arms.motion is None or isinstance(arms.motion, Braked):
        return arms
    braking = Braked(arms.motion, facts.time_s - arms.started_s, _BRAKING_S)
    return replace(_enter(arms, ArmPhase.HOLDING, facts), motion=braking, started_s=facts.time_s, reason=reason)


def _fail(arms: ArmState, facts: ArmFacts) -> ArmState:
    failed = _enter(arms, ArmPhase.FAULT, facts)
    return replace(failed, motion=None, hold_rad=None, action=ArmAction.HOLD, reason=facts.fault)


def _limp(arms: ArmState, facts: ArmFacts) -> ArmState:
    return replace(_enter(arms, ArmPhase.OFF, facts), motion=None, hold_rad=None)


def _enter(arms: ArmState, phase: ArmPhase, facts: ArmFacts) -> ArmState:
    return replace(arms, phase=phase, since_s=facts.time_s)
