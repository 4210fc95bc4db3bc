"""Commands to the vehicle and its response, from a record and on one clock."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from companion.analysis.report.recorded_flight import Flown, Mask
from companion.core.types import Array
from companion.geometry.frames import up_axis
from companion.records.errors import RecordError, UnfitFlightError

WINDOW_S = 10.0
"""Window over which clocks are compared, as in the estimator."""
_NEEDED = ("setpoint_thrust", "setpoint_q_w_flu_wxyz", "attitude_s")
_FRAMES = ("frame_stamp_s", "estimate_clock_offset_s")
_CLEAR_M = 0.25
"""Height above which the ground effect is negligible."""
_LEAST_S = 8.0
_MOVES_RADPS = 0.02
_RINGS_S = 1.0
"""Time after a motion of the arms until the vehicle counts as undisturbed."""


@dataclass(frozen=True, kw_only=True)
class Observed:
    """Signals of one flight while it is clear of the ground; times are the service's, s."""

    begin_s: float
    end_s: float
    sent_s: Array
    """Time at which each setpoint was sent, (m,), from before `begin_s` on."""
    sent_up_w: Array
    """Commanded up axis, (m, 3)."""
    sent_thrust: Array
    came_s: Array
    """Arrival of each frame without queueing, (n,); includes the delay from the capture."""
    position_w_m: Array
    up_w: Array
    """The body's up axis by motion capture, (n, 3)."""
    heard_s: Array
    """Arrival of each attitude of the autopilot without queueing, (k,)."""
    autopilot_up_w: Array
    """Up axis by the autopilot, (k, 3)."""
    quiet: Mask
    """Frames in which the arms had been at rest for a while, (n,)."""
    of_ground: bool = False
    """The frames are those that a law on the ground got, on the vehicle's clock."""
    linked_s: Array = field(default_factory=lambda: np.zeros(0))
    """Arrival of each message of a law on the ground, (l,); none for a law on board."""
    link_age_s: Array = field(default_factory=lambda: np.zeros(0))
    """Their ages then, (l,)."""


def observed(flown: Flown) -> Observed:
    """Read the signals from the record; UnfitFlightError for an unsuitable flight, RecordError without the columns."""
    path = flown.record.path
    if not flown.airborne.any():
        raise UnfitFlightError(f"{path}: the law was never in charge in this flight: nothing to calibrate from")
    if flown.record.is_of_ground:
        raise UnfitFlightError(f"{path}: is the record of a law on the ground: give the vehicle's, or both merged")
    seen = _with_frames(flown)
    missing = [name for name in _NEEDED if not flown.has(name)]
    missing += [name for name in _FRAMES if not seen.has(name)]
    if missing:
        raise RecordError(f"{path}: no column {missing[0]}: a record of `companion serve` is needed")
    begin_s, end_s = _clear_of_ground(flown)
    if end_s - begin_s < _LEAST_S:
        raise UnfitFlightError(
            f"{path}: only {max(end_s - begin_s, 0.0):.0f} s above {_CLEAR_M:g} m: hover for at least half a minute"
        )
    time_s = seen.column("time_s")
    sent = flown.sent & np.isfinite(flown.column("setpoint_thrust"))
    framed = np.isfinite(seen.column("frame_stamp_s")) & np.isfinite(seen.column("frame_position_w_m", 3)).all(axis=1)
    framed &= (time_s >= begin_s) & (time_s <= end_s)
    rotation = np.asarray(seen.record.columns["frame_rotation_w_b"])
    heard_s, their_up_w = _autopilots(flown)
    quiet = _arms_at_rest(flown, time_s[framed])
    if quiet.mean() * (end_s - begin_s) < _LEAST_S:
        raise UnfitFlightError(f"{path}: the arms moved nearly all the time: hover with the arms stowed")
    linked_s, link_age_s = _messages(flown, begin_s, end_s)
    return Observed(
        begin_s=begin_s,
        end_s=end_s,
        sent_s=flown.column("sent_s")[sent],
        sent_up_w=up_axis(_left(flown)[sent]),
        sent_thrust=flown.column("setpoint_thrust")[sent],
        came_s=(seen.column("frame_stamp_s") + seen.column("estimate_clock_offset_s"))[framed],
        position_w_m=seen.column("frame_position_w_m", 3)[framed],
        up_w=rotation[framed][:, :, 2],
        heard_s=heard_s,
        autopilot_up_w=their_up_w,
        quiet=quiet,
        of_ground=seen is not flown,
        linked_s=linked_s,
        link_age_s=link_age_s,
    )


def _with_frames(flown: Flown) -> Flown:
    """Return the side of the flight that frames have reached; UnfitFlightError where that side's record is missing."""
    if flown.record.frames:
        return flown
    if flown.record.ground is None:
        raise UnfitFlightError(
            f"{flown.record.path}: no frames reached the vehicle (law.onboard_mocap = false): merge it with the "
            "ground's record first, `companion records merge`"
        )
    return Flown(flown.record.ground)


def _messages(flown: Flown, begin_s: float, end_s: float) -> tuple[Array, Array]:
    """Return arrival and age of each message of a law on the ground, (l,); none for a law on board."""
    if not flown.has("link_message_sent_s"):
        return np.zeros(0), np.zeros(0)
    arrived_s = flown.column("link_message_arrived_s")
    ages_s = arrived_s - flown.column("link_message_sent_s")
    among = np.isfinite(ages_s) & (np.diff(arrived_s, prepend=np.nan) != 0.0)
    among &= (arrived_s >= begin_s) & (arrived_s <= end_s)
    return arrived_s[among], ages_s[among]


def _left(flown: Flown) -> Array:
    """Return the attitudes that the autopilot was sent, (n, 4): with its horizon corrected, in a record that has it."""
    on_wire = flown.column("wire_q_w_flu_wxyz", 4)
    return np.where(np.isfinite(on_wire), on_wire, flown.column("setpoint_q_w_flu_wxyz", 4))


def _clear_of_ground(flown: Flown) -> tuple[float, float]:
    height = flown.column("position_w_m", 3)[:, 2]
    flying = flown.airborne & np.isfinite(height)
    if not flying.any():
        return 0.0, 0.0
    clear = flying & (height > height[np.argmax(flying)] + _CLEAR_M)
    if not clear.any():
        return 0.0, 0.0
    first = int(np.argmax(clear))
    ends = np.flatnonzero(~clear[first:])
    last = first + int(ends[0]) - 1 if ends.size else len(clear) - 1
    return float(flown.column("time_s")[first]), float(flown.column("time_s")[last])


def _arms_at_rest(flown: Flown, at_s: Array) -> Mask:
    """Return at which of these times the arms had been at rest for a while."""
    goals = flown.column("joint_goal_velocity_radps", 8)
    moved_s = flown.column("time_s")[np.nan_to_num(np.abs(goals)).max(axis=1) > _MOVES_RADPS]
    if not moved_s.size:
        return np.ones(len(at_s), dtype=bool)
    last = np.searchsorted(moved_s, at_s, side="right") - 1
    return np.asarray((last < 0) | (at_s - moved_s[np.maximum(last, 0)] > _RINGS_S))


def _autopilots(flown: Flown) -> tuple[Array, Array]:
    heard, boot = flown.column("attitude_s"), flown.column("boot_s")
    fresh = np.isfinite(heard) & np.isfinite(boot) & np.append(True, np.diff(heard) > 0.0)
    up_w = up_axis(flown.column("autopilot_q_w_flu_wxyz", 4)[fresh])
    return without_waiting(boot[fresh], heard[fresh]), up_w


def without_waiting(stamp_s: Array, came_s: Array) -> Array:
    """Return arrivals (n,) without queueing, by the shortest delay of the last seconds."""
    on_way = came_s - stamp_s
    quickest = np.empty_like(on_way)
    first = 0
    for row, now_s in enumerate(came_s):
        while now_s - came_s[first] > WINDOW_S:
            first += 1
        quickest[row] = on_way[first : row + 1].min()
    return np.asarray(stamp_s + quickest)


def held(at_s: Array, sent_s: Array, values: Array) -> Array:
    """Return the value in force at each instant; the first one before anything was sent."""
    return values[np.clip(np.searchsorted(sent_s, at_s, side="right") - 1, 0, None)]


def smooth_held(grid_s: Array, sent_s: Array, values: Array) -> Array:
    """Return `held` on a grid, (n, ...), each step shared by the two points around it to keep its time."""
    step_s = float(grid_s[1] - grid_s[0])
    start = held(grid_s[:1], sent_s, values)[0]
    inside = (sent_s > grid_s[0]) & (sent_s < grid_s[-2])
    rows = np.flatnonzero(inside)
    changes = values[rows] - np.concatenate(([start], values[rows][:-1])) if rows.size else values[:0]
    place = (sent_s[rows] - grid_s[0]) / step_s
    low = place.astype(int)
    share = (place - low).reshape(-1, *[1] * (values.ndim - 1))
    jumps = np.zeros((len(grid_s), *values.shape[1:]))
    np.add.at(jumps, low, (1.0 - share) * changes)
    np.add.at(jumps, low + 1, share * changes)
    return np.asarray(start + np.cumsum(jumps, axis=0))


def blocks(at_s: Array, for_s: float) -> NDArray[np.int_]:
    """Return the index of the block of length `for_s` that each sample belongs to, (n,)."""
    return np.asarray((at_s - at_s[0]) / for_s, dtype=np.int_)
