"""Planning of motions that keep the limits and touch nothing; ArmError gives the reason before anything moves."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from companion.arms.collision import distances
from companion.arms.model import CLAWS, JOINT_NAMES, ArmModel
from companion.arms.sampling import Samples, TooNear, first_too_near, samples
from companion.arms.trajectory import InTurn, JointTrajectory, Slowed, Waypoints, minimum_jerk
from companion.core.interfaces import ArmError
from companion.core.types import Array

OWN_PACE = 0.5
"""Share of the velocity and acceleration limits that motions take which are not a file's: a gentler push in flight."""
_IN_HAND = 1.01
"""A motion is slowed by so much more than its samples ask for."""
_LEAST_S = 0.3
"""Shortest motion of our own, however near its end."""
_LONGEST_S = 3600.0
_ROUNDING_RAD = 1e-6
_LEAVING_M = 0.0005
"""A pair that begins inside the margin may come nearer by so much, not more, on its way out."""


@dataclass(frozen=True)
class Plan:
    """A motion that begins where the joints are, and what to tell the user."""

    trajectory: JointTrajectory
    slowed_by: float = 1.0
    approach_s: float = 0.0
    """Duration of the approach to the start of the motion."""
    notes: tuple[str, ...] = ()


def plan(
    model: ArmModel,
    trajectory: JointTrajectory,
    start_rad: Array,
    via_rad: Iterable[Array] = (),
    floor_z_m: float | None = None,
) -> Plan:
    """Plan `trajectory` from rest at `start_rad` (8,), slowed as a whole until its limits hold.

    The way to its start is straight in the joints, or through one of the poses `via_rad` (8,) when that would collide;
    `floor_z_m` is the floor's height in the body frame. Raises ArmError, naming the joint or the pair and the time,
    when an angle is beyond its limit or something comes too near.
    """
    _check_known(start_rad)
    looked = _finite_samples(trajectory)
    _check_angles(model, looked)
    factor, notes = _slowing(model, looked)
    slowed = trajectory if factor == 1.0 else Slowed(trajectory, factor)
    near = first_too_near(model, slowed, model.margin_m, floor_z_m)
    if near is not None:
        raise ArmError(f"{near.time_s:.2f} s into the motion {_meeting(near)}")
    parts, note = _way(model, start_rad, looked.motion.position_rad[0], via_rad, floor_z_m)
    approach_s = sum(part.duration_s for part in parts)
    if approach_s > 0.0:
        notes = (*notes, f"the way to the motion's start takes {approach_s:.1f} s{', ' + note if note else ''}")
    return Plan(InTurn((*parts, slowed)), factor, approach_s, notes)


def to_pose(
    model: ArmModel,
    start_rad: Array,
    goal_rad: Array,
    via_rad: Iterable[Array] = (),
    floor_z_m: float | None = None,
) -> Plan:
    """Plan from rest in one pose (8,) to another, straight in the joints, or by one of `via_rad` if that would collide.

    Raises ArmError when the pose is beyond a limit or touches something, or when no way to it is free.
    """
    _check_known(start_rad)
    _check_pose(model, goal_rad, "in the pose asked for")
    parts, note = _way(model, start_rad, goal_rad, via_rad, floor_z_m)
    return Plan(InTurn(parts or (_move(model, start_rad, goal_rad),)), notes=(note,) if note else ())


def grip(model: ArmModel, start_rad: Array, claw_rad: float) -> Plan:
    """Plan both claws to an angle; nothing else moves."""
    goal_rad = start_rad.copy()
    goal_rad[list(CLAWS)] = claw_rad
    return to_pose(model, start_rad, goal_rad)


def _check_known(start_rad: Array) -> None:
    unknown = np.flatnonzero(~np.isfinite(start_rad))
    if unknown.size:
        raise ArmError(f"where {JOINT_NAMES[unknown[0]]} is, is not known: read the servos before moving them")


def _finite_samples(trajectory: JointTrajectory) -> Samples:
    if not 0.0 <= trajectory.duration_s <= _LONGEST_S:
        raise ArmError(f"a motion of {trajectory.duration_s:g} s cannot be checked: at most {_LONGEST_S:g} s")
    looked = samples(trajectory)
    motion = looked.motion
    if not all(np.isfinite(part).all() for part in (motion.position_rad, motion.velocity_radps)):
        raise ArmError("the motion holds values that are not numbers")
    return looked


def _check_angles(model: ArmModel, looked: Samples) -> None:
    low, high, _, _ = model.limit_arrays()
    angles = looked.motion.position_rad
    beyond = (angles < low - _ROUNDING_RAD) | (angles > high + _ROUNDING_RAD)
    if beyond.any():
        row = int(np.argmax(beyond.any(axis=1)))
        _check_pose(model, angles[row], f"{looked.time_s[row]:.2f} s into the motion")


def _check_pose(model: ArmModel, angles_rad: Array, where: str) -> None:
    low, high, _, _ = model.limit_arrays()
    beyond = np.maximum(low - angles_rad, angles_rad - high)
    joint = int(np.argmax(beyond))
    if beyond[joint] > _ROUNDING_RAD:
        raise ArmError(
            f"{where} {JOINT_NAMES[joint]} would be at {_angle(angles_rad[joint])}, "
            f"allowed is {_angle(low[joint])} to {_angle(high[joint])}"
        )


def _angle(angle_rad: float) -> str:
    return f"{angle_rad:.3f} rad ({math.degrees(angle_rad):.1f} deg)"


def _slowing(model: ArmModel, looked: Samples) -> tuple[float, tuple[str, ...]]:
    _, _, speed, accel = model.limit_arrays()
    quickest = np.abs(looked.motion.velocity_radps).max(axis=0)
    sharpest = np.abs(looked.motion.acceleration_radps2).max(axis=0)
    by_speed, by_accel = _IN_HAND * quickest / speed, np.sqrt(_IN_HAND * sharpest / accel)
    factor = float(max(by_speed.max(), by_accel.max()))
    if factor <= 1.0:
        return 1.0, ()
    if by_speed.max() >= by_accel.max():
        joint = int(np.argmax(by_speed))
        why = f"{JOINT_NAMES[joint]} would turn at {quickest[joint]:.2f} rad/s, allowed is {speed[joint]:g} rad/s"
    else:
        joint = int(np.argmax(by_accel))
        why = f"{JOINT_NAMES[joint]} would take {sharpest[joint]:.1f} rad/s^2, allowed is {accel[joint]:g} rad/s^2"
    took_s = float(looked.time_s[-1])
    return factor, (f"slowed down {factor:.2f} times, {took_s * factor:.1f} s instead of {took_s:.1f} s: {why}",)


def _way(
    model: ArmModel, start_rad: Array, goal_rad: Array, via_rad: Iterable[Array], floor_z_m: float | None
) -> tuple[tuple[JointTrajectory, ...], str]:
    """Return moves from rest to rest, none if the joints are there already; and a note when they are not straight."""
    if np.abs(goal_rad - start_rad).max() < _ROUNDING_RAD:
        return (), ""
    keep_m = _kept_m(model, start_rad, goal_rad, floor_z_m)
    straight = _move(model, start_rad, goal_rad)
    near = first_too_near(model, straight, keep_m, floor_z_m)
    if near is None:
        return (straight,), ""
    for via in via_rad:
        bent = (_move(model, start_rad, via), _move(model, via, goal_rad))
        if first_too_near(model, InTurn(bent), keep_m, floor_z_m) is None:
            return bent, f"round about, because straight there {_meeting(near)}"
    raise ArmError(f"{near.time_s:.2f} s into the way there {_meeting(near)}")


def _kept_m(model: ArmModel, start_rad: Array, goal_rad: Array, floor_z_m: float | None) -> Array:
    """Return the distance that each pair keeps, the margin or less if it starts nearer; ArmError if not at the goal."""
    found = distances(model, np.stack((start_rad, goal_rad)), floor_z_m)
    leaving_m, there_m = found.distance_m
    keep_m = np.minimum(model.margin_m, leaving_m - _LEAVING_M)
    pair = int(np.argmin(there_m - keep_m))
    if there_m[pair] < keep_m[pair]:
        near = TooNear(0.0, found.what[pair], float(there_m[pair]), float(keep_m[pair]))
        raise ArmError(f"in the pose asked for {_meeting(near)}")
    return np.asarray(keep_m)


def _move(model: ArmModel, start_rad: Array, goal_rad: Array) -> Waypoints:
    """Return the straight way in the joints at our own pace; never beyond the two ends of any joint's way."""
    _, _, speed, accel = model.limit_arrays()
    way = np.abs(goal_rad - start_rad)
    by_speed, by_accel = 1.875 * way / (OWN_PACE * speed), np.sqrt(5.7735 * way / (OWN_PACE * accel))
    duration_s = max(_LEAST_S, float(by_speed.max()), float(by_accel.max()))
    return minimum_jerk(start_rad, goal_rad, duration_s)


def _meeting(near: TooNear) -> str:
    apart = "would touch" if near.distance_m <= 0.0 else f"would come within {near.distance_m:.3f} m"
    return f"{near.what} {apart}, {max(near.keep_m, 0.0):.3f} m is to be kept"
