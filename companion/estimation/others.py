"""Motion of the other vehicles, from their positions in motion capture's frames. Pure, floats.

The filter of each is that of the vehicle's own position, with the same gate: a position that it cannot have reached is
not believed until ten frames agree on it, so that a reflection, or two bodies whose names are swapped, moves nobody.
"""

import math
from collections.abc import Iterable
from dataclasses import replace

from companion.core.types import OtherBody, OtherVehicle, Vec3
from companion.core.values import value
from companion.estimation import kalman
from companion.estimation.kalman import Motion
from companion.estimation.params import EstimatorParams

_UNKNOWN: Vec3 = (math.nan, math.nan, math.nan)
_COAST_S = 0.5
"""Time for which an unseen vehicle is taken to fly on; then it is taken to have stopped there."""
_STILL_MPS = 0.1
"""Speed below which a vehicle stands still: several times the noise of a body at rest."""
_STILL_S = 1.0
"""Time of standing still on the ground after which a vehicle is parked."""


@value(kw_only=True)
class OtherTrack:
    """Filter of one other vehicle."""

    body: str
    motion: Motion | None = None
    """Motion at `stamp_s`; None before the first position."""
    stamp_s: float = -math.inf
    """Stamp of the last believed position, on motion capture's clock."""
    rejected_w_m: Vec3 = _UNKNOWN
    """Last position that was not believed."""
    agreeing: int = 0
    """Positions in a row that were not believed and agree with each other."""
    still_since_s: float = math.inf
    """Stamp since which it has stood still on the ground; infinite while it does not."""


def step(
    tracks: tuple[OtherTrack, ...], seen: Iterable[OtherBody], stamp_s: float, params: EstimatorParams
) -> tuple[OtherTrack, ...]:
    """Return the tracks after one frame; they stand in the frame's order."""
    known = {track.body: track for track in tracks}
    return tuple(_step(known.get(one.body) or OtherTrack(body=one.body), one, stamp_s, params) for one in seen)


def on_new_clock(tracks: Iterable[OtherTrack], jump_s: float) -> tuple[OtherTrack, ...]:
    """Return the tracks with their stamps on a clock that has jumped: their ages stay as they are."""
    return tuple(
        replace(track, stamp_s=track.stamp_s + jump_s, still_since_s=track.still_since_s + jump_s) for track in tracks
    )


def vehicles_of(tracks: Iterable[OtherTrack], stamp_s: float) -> tuple[OtherVehicle, ...]:
    """Return the vehicles' motion at a stamp that is not before the last frame's."""
    return tuple(_vehicle(track, stamp_s) for track in tracks)


def _vehicle(track: OtherTrack, stamp_s: float) -> OtherVehicle:
    if track.motion is None:
        return OtherVehicle(body=track.body, position_w_m=_UNKNOWN, velocity_w_mps=_UNKNOWN, unseen_s=math.inf)
    unseen_s = max(stamp_s - track.stamp_s, 0.0)
    x, y, z, vx, vy, vz = (float(number) for number in (*track.motion.position, *track.motion.velocity))
    coasted_s = min(unseen_s, _COAST_S)
    stopped = unseen_s > _COAST_S
    return OtherVehicle(
        body=track.body,
        position_w_m=(x + vx * coasted_s, y + vy * coasted_s, z + vz * coasted_s),
        velocity_w_mps=(0.0, 0.0, 0.0) if stopped else (vx, vy, vz),
        unseen_s=unseen_s,
        parked=track.stamp_s - track.still_since_s >= _STILL_S,
    )


def _step(track: OtherTrack, seen: OtherBody, stamp_s: float, params: EstimatorParams) -> OtherTrack:
    place = seen.position_w_m
    if place is None:
        return track
    dt_s = stamp_s - track.stamp_s
    if track.motion is None or abs(dt_s) > params.max_gap_s:
        return _begun(track.body, place, stamp_s, params)
    if dt_s <= 0.0:
        return track
    motion = kalman.predict(track.motion, dt_s, params.jerk_density)
    gate_m = params.gate_m + 0.5 * params.max_accel_mps2 * dt_s * dt_s + 3.0 * math.sqrt(motion.covariance.pp)
    if math.dist(place, motion.position) > gate_m:
        return _rejected(track, place, stamp_s, params)
    motion = kalman.update(motion, place, params.noise_m**2)
    slow = math.hypot(*motion.velocity) < _STILL_MPS and place[2] < params.parked_below_m
    since_s = min(track.still_since_s, stamp_s) if slow else math.inf
    return OtherTrack(body=track.body, motion=motion, stamp_s=stamp_s, still_since_s=since_s)


def _begun(body: str, place: Vec3, stamp_s: float, params: EstimatorParams) -> OtherTrack:
    at_rest = Motion(place, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), kalman.first_covariance(params.noise_m))
    return OtherTrack(body=body, motion=at_rest, stamp_s=stamp_s)


def _rejected(track: OtherTrack, place: Vec3, stamp_s: float, params: EstimatorParams) -> OtherTrack:
    agreeing = track.agreeing + 1 if math.dist(place, track.rejected_w_m) <= params.agree_m else 1
    if agreeing >= params.outliers_to_restart:
        return _begun(track.body, place, stamp_s, params)
    return OtherTrack(
        body=track.body,
        motion=track.motion,
        stamp_s=track.stamp_s,
        rejected_w_m=place,
        agreeing=agreeing,
        still_since_s=track.still_since_s,
    )
