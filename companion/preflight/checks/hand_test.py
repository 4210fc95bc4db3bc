"""Carrying the vehicle by hand: do motion capture and the autopilot show what the hand did?

What stands still agrees as well when it is mirrored, turned by a quarter, or scaled; moving it tells.
The classic mistakes: a body in QTM whose x axis is not the nose, an axis with the wrong sign, a heading that the
autopilot takes from elsewhere (it then circles ever faster around its place, the "toilet bowl").
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum

import numpy as np

from companion.core.types import Array
from companion.geometry.frames import matrix_from_quat
from companion.preflight.checks.check import Check

_OFF_RAD = math.radians(30.0)
"""A hand does not push more exactly."""
_APART_RAD = math.radians(15.0)
"""Between motion capture's and the autopilot's idea of the same motion."""
_FOLLOWS = 0.3
"""Share of motion capture's displacement below which the autopilot has not seen any."""
_SCALE = (0.8, 1.25)
_REST_S = 0.8
_REST_M = 0.03
_ENDS_S = 0.3
"""Both ends of a move are averaged over so long."""


class Move(StrEnum):
    """Moves of the hand test, in order."""

    LIFT = "lift"
    FORWARD = "forward"
    LEFT = "left"

    @property
    def asks(self) -> str:
        """Instruction for the person who moves the vehicle."""
        return {
            Move.LIFT: "lift the vehicle by about 0.3 m, level, and hold it there",
            Move.FORWARD: "push it by about 0.5 m towards its nose, without turning it, and let it rest",
            Move.LEFT: "push it by about 0.5 m to its left, without turning it, and let it rest",
        }[self]

    @property
    def least_m(self) -> float:
        """Minimum distance of the move, m."""
        return 0.15 if self is Move.LIFT else 0.3

    @property
    def direction(self) -> Array:
        """Direction (3,): in W for the lift, in the body's axes (FLU) for the others."""
        return np.array({Move.LIFT: (0.0, 0.0, 1.0), Move.FORWARD: (1.0, 0.0, 0.0), Move.LEFT: (0.0, 1.0, 0.0)}[self])


@dataclass(frozen=True)
class Track:
    """Positions and attitudes of one move from both sources, sampled at the same times; from rest to rest."""

    time_s: Array
    """(n,), rising."""
    mocap_w_m: Array
    mocap_q_wxyz: Array
    """(n, 4), body FLU into W."""
    autopilot_w_m: Array
    """(n, 3), in W."""
    autopilot_q_wxyz: Array
    """(n, 4), body FLU into W."""


@dataclass(frozen=True)
class Displacement:
    """Displacements of a move between its rests: (3,), m, in W and along the initial body axes."""

    mocap_w_m: Array
    mocap_b_m: Array
    autopilot_w_m: Array
    autopilot_b_m: Array


def at_rest(track: Track) -> bool:
    """Return True when motion capture shows the vehicle at rest at the track's end."""
    return _rests(track.time_s, track.mocap_w_m)


def settled(track: Track) -> bool:
    """Return True when the autopilot's position, which lags a little, is at rest, too."""
    return _rests(track.time_s, track.autopilot_w_m)


def _rests(time_s: Array, position_w_m: Array) -> bool:
    if not len(time_s) or time_s[-1] - time_s[0] < _REST_S:
        return False
    lately = position_w_m[time_s >= time_s[-1] - _REST_S]
    return bool(np.ptp(lately, axis=0).max() < _REST_M)


def is_over(track: Track, move: Move) -> bool:
    """Return True when it moved far enough in any direction and is at rest."""
    return at_rest(track) and bool(np.linalg.norm(moved(track).mocap_w_m) >= move.least_m)


def moved(track: Track) -> Displacement:
    """Return the displacement between both ends."""
    first = track.time_s <= track.time_s[0] + _ENDS_S
    last = track.time_s >= track.time_s[-1] - _ENDS_S

    def between(position: Array) -> Array:
        return np.asarray(position[last].mean(axis=0) - position[first].mean(axis=0))

    mocap, autopilot = between(track.mocap_w_m), between(track.autopilot_w_m)
    ours, theirs = matrix_from_quat(track.mocap_q_wxyz[0]), matrix_from_quat(track.autopilot_q_wxyz[0])
    return Displacement(mocap, ours.T @ mocap, autopilot, theirs.T @ autopilot)


def judge(move: Move, seen: Displacement) -> Check:
    """Judge one move; the first deviation found is reported."""
    says = f"mocap {_metres(seen.mocap_w_m)}, autopilot {_metres(seen.autopilot_w_m)}"
    for todo in (_of_mocap(move, seen), _of_position(seen), _of_heading(move, seen)):
        if todo:
            return Check(f"by hand: {move}", False, says, todo)
    return Check(f"by hand: {move}", True, says)


def _of_mocap(move: Move, seen: Displacement) -> str:
    """Return what is wrong with motion capture alone; empty when nothing is."""
    shown = seen.mocap_w_m if move is Move.LIFT else seen.mocap_b_m
    if _angle_rad(shown, move.direction) <= _OFF_RAD:
        return ""
    if move is Move.LIFT:
        return (
            f"motion capture shows the lift along its {_axis(shown)}, not its +z: in QTM, calibrate with the L-frame "
            "so that z points up"
        )
    ways = ("nose", "tail", "left", "right", "top", "belly")
    way = ways[2 * int(np.argmax(np.abs(shown))) + int(shown[np.argmax(np.abs(shown))] < 0.0)]
    wanted = "nose" if move is Move.FORWARD else "left"
    return (
        f"pushed towards its {wanted}, it goes towards the {way} of the body in QTM: turn the body's axes there, x is "
        "the nose, y left, z up"
    )


def _of_position(seen: Displacement) -> str:
    """Return what is wrong with the autopilot's position compared with motion capture's; empty when nothing is."""
    ours_m, theirs_m = float(np.linalg.norm(seen.mocap_w_m)), float(np.linalg.norm(seen.autopilot_w_m))
    if not theirs_m >= _FOLLOWS * ours_m:  # NaN, too
        return "the autopilot's position does not follow: EKF2 does not fuse vision, see EKF2_EV_CTRL and its reset"
    if _angle_rad(seen.mocap_w_m, seen.autopilot_w_m) > _APART_RAD:
        return (
            f"motion capture's {_axis(seen.mocap_w_m)} is the autopilot's {_axis(seen.autopilot_w_m)}"
            f"{_turn(seen)}: its frame is turned or mirrored; is another program sending it poses, and is its "
            "heading taken from vision (EKF2_EV_CTRL bit 3, EKF2_MAG_TYPE = 5)?"
        )
    if not _SCALE[0] <= theirs_m / ours_m <= _SCALE[1]:
        return (
            f"the autopilot shows {theirs_m / ours_m:.2f} times motion capture's distance: are QTM's calibration and "
            "units right, does EKF2 fuse something beside vision (EKF2_GPS_CTRL, EKF2_RNG_CTRL, EKF2_OF_CTRL)?"
        )
    return ""


def _of_heading(move: Move, seen: Displacement) -> str:
    """Return what is wrong with the autopilot's heading, which causes toilet-bowling; empty when nothing is."""
    if move is Move.LIFT:
        return ""
    off_rad = math.atan2(*seen.autopilot_b_m[1::-1].tolist()) - math.atan2(*seen.mocap_b_m[1::-1].tolist())
    off_rad = math.remainder(off_rad, math.tau)
    if abs(off_rad) <= _APART_RAD:
        return ""
    return (
        f"the autopilot's heading is off by {math.degrees(-off_rad):.0f} degrees: it would circle ever faster; take "
        "the heading from vision alone (EKF2_EV_CTRL bit 3, EKF2_MAG_TYPE = 5), reboot PX4"
    )


def judge_together(seen: Mapping[Move, Displacement]) -> Check:
    """Judge all three moves together: a turned and a mirrored frame differ only in more than one direction."""
    name = "by hand: frames"
    ours = np.stack([seen[move].mocap_w_m for move in Move], axis=-1)
    theirs = np.stack([seen[move].autopilot_w_m for move in Move], axis=-1)
    body = np.stack([seen[move].mocap_b_m for move in Move], axis=-1)
    if not np.linalg.cond(ours) < 20.0:
        return Check(name, False, "the three moves were not across each other", "move it up, forward, then left")
    if np.linalg.det(body) < 0.0:
        todo = "motion capture is mirrored: calibrate QTM with the L-frame lying as its arms are marked"
        return Check(name, False, "mocap's axes are left-handed", todo)
    turned = theirs @ np.linalg.inv(ours)
    says = ", ".join(f"autopilot's {name} is mocap's {_axis(row)}" for name, row in zip("xyz", turned, strict=True))
    if not np.isfinite(turned).all() or np.linalg.det(turned) < 0.0:
        return Check(name, False, says, "the autopilot's frame is mirrored: who converts its poses besides this?")
    same = all(_angle_rad(row, axis) <= _OFF_RAD for row, axis in zip(turned, np.eye(3), strict=True))
    return Check(
        name, same, says, "" if same else "the autopilot's frame is turned: take the heading from vision alone"
    )


def _turn(seen: Displacement) -> str:
    """Return the turn about the vertical between both displacements as text; empty where it is not defined."""
    a, b = seen.mocap_w_m, seen.autopilot_w_m
    if min(math.hypot(a[0], a[1]), math.hypot(b[0], b[1])) < 0.5 * float(np.linalg.norm(a)):
        return ""
    angle_rad = math.remainder(math.atan2(b[1], b[0]) - math.atan2(a[1], a[0]), math.tau)
    return f", {abs(math.degrees(angle_rad)):.0f} degrees to the {'left' if angle_rad >= 0.0 else 'right'}"


def _angle_rad(a: Array, b: Array) -> float:
    """Return the angle between two directions, rad; pi when one has no length."""
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return math.acos(min(1.0, max(-1.0, float(a @ b) / size))) if size > 0.0 else math.pi


def _axis(vector: Array) -> str:
    """Return the nearest axis with its sign, such as "+x"."""
    if not np.isfinite(vector).all():
        return "nothing"
    index = int(np.argmax(np.abs(vector)))
    return f"{'-' if vector[index] < 0.0 else '+'}{'xyz'[index]}"


def _metres(vector: Array) -> str:
    return " ".join(f"{value:+.2f}" for value in vector.tolist()) + " m"


@dataclass(frozen=True)
class HandTest:
    """Last hand test that passed."""

    body: str
    """The rigid body's name in QTM."""
    when: datetime
    """With its time zone."""
    file: str = ""
    """File that keeps the result."""


def check_hand_test(kept: HandTest | str, body: str, now: datetime, within_h: float) -> Check:
    """Check that a hand test passed within `within_h` (0: none needed); `kept` may be the reason why none is known."""
    todo = "run `companion preflight --by-hand` again whenever the body in QTM, the room or the autopilot has changed"
    name = "carried by hand"
    if within_h <= 0.0:
        return Check(name, True, "not asked for (preflight.by_hand_within_h = 0)")
    if isinstance(kept, str):
        return Check(name, False, kept, todo)
    ago_h = (now - kept.when).total_seconds() / 3600.0
    good = kept.body == body and 0.0 <= ago_h <= within_h
    says = f"{kept.body!r} {ago_h:.1f} h ago, {body!r} within {within_h:g} h wanted"
    return Check(name, good, says if good else f"{says} (in {kept.file})", todo)
