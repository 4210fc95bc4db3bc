"""Missions of virtual flights: tables of the reference in each cycle, and of the one ahead for the law."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.core.types import Array, Reference
from companion.trajectories.reference import Trajectory


@dataclass(frozen=True)
class References:
    """References of n cycles: vectors (n, ..., 3) in W, heading (n, ...)."""

    position_w_m: Array
    velocity_w_mps: Array
    acceleration_w_mps2: Array
    yaw_rad: Array

    def at(self, cycle: int) -> Reference:
        """Return the references of one cycle."""
        return Reference(
            self.position_w_m[cycle], self.velocity_w_mps[cycle], self.acceleration_w_mps2[cycle], self.yaw_rad[cycle]
        )


_COLUMNS = tuple(References.__dataclass_fields__)


@dataclass(frozen=True)
class Mission:
    """Mission that holds the trajectory's start until time 0, then follows it."""

    time_s: Array
    """Time of each cycle (s), (n,)."""
    now: References
    ahead: References
    """References `preview_s` later, as given to the law."""

    @property
    def lead(self) -> tuple[int, ...]:
        """Leading axes of the batch; () for one vehicle."""
        return self.now.position_w_m.shape[1:-1]


def mission_of(trajectory: Trajectory, preview_s: float, settle_s: float, period_s: float) -> Mission:
    """Return the mission of one vehicle with a law that looks `preview_s` ahead."""
    time_s = _times_s(trajectory, settle_s, period_s)
    now = _table(trajectory, time_s)
    return Mission(time_s, now, _table(trajectory, time_s + preview_s) if preview_s else now)


def _times_s(trajectory: Trajectory, settle_s: float, period_s: float, beyond: int = 0) -> Array:
    """Return the time of each cycle (s), and of `beyond` more after the last."""
    count = round((settle_s + trajectory.duration_s) / period_s) + beyond
    return np.asarray(np.arange(count) * period_s - settle_s)


def stacked(missions: Sequence[Mission]) -> Mission:
    """Return missions as one batch; the shorter ones hold their ends until the longest is over."""
    first = missions[0]
    if all(mission is first for mission in missions):
        tables = (_repeated(table, len(missions)) for table in (first.now, first.ahead))
        return Mission(first.time_s, *tables)
    longest = max(missions, key=lambda mission: len(mission.time_s))
    count = len(longest.time_s)
    return Mission(
        longest.time_s,
        _side_by_side([mission.now for mission in missions], count),
        _side_by_side([mission.ahead for mission in missions], count),
    )


def _repeated(table: References, count: int) -> References:
    """Return one table for all of a batch, without a copy of it for each."""
    columns = (np.asarray(getattr(table, name)) for name in _COLUMNS)
    return References(*(np.broadcast_to(each[:, None], (len(each), count, *each.shape[1:])) for each in columns))


def _table(trajectory: Trajectory, time_s: Array) -> References:
    points = [trajectory.at(float(instant)) for instant in time_s]
    return References(*(np.array([getattr(point, name) for point in points]) for name in _COLUMNS))


def _side_by_side(tables: Sequence[References], count: int) -> References:
    return References(
        *(np.stack([_held(getattr(table, name), count) for table in tables], axis=1) for name in _COLUMNS)
    )


def _held(rows: Array, count: int) -> Array:
    return np.concatenate((rows, np.repeat(rows[-1:], count - len(rows), axis=0))) if len(rows) < count else rows


def looking_ahead(trajectory: Trajectory, previews_s: Array, settle_s: float, period_s: float) -> Mission:
    """Return a batch (B,) on one trajectory whose laws look ahead by different times, `previews_s` (B,).

    The reference ahead is interpolated between cycles: at 100 Hz the error is micrometres.
    """
    beyond = int(np.ceil(previews_s.max() / period_s)) + 1
    time_s = _times_s(trajectory, settle_s, period_s, beyond)
    count, whole = len(time_s) - beyond, _table(trajectory, time_s)
    steps = previews_s / period_s
    first = np.floor(steps).astype(np.int64)
    rows, share = np.arange(count)[:, None] + first, steps - first
    each = [np.asarray(getattr(whole, name)) for name in _COLUMNS]
    ahead = [
        column[rows] + (share[:, None] if column.ndim > 1 else share) * (column[rows + 1] - column[rows])
        for column in each
    ]
    here = [np.repeat(column[:count, None], len(previews_s), axis=1) for column in each]
    return Mission(time_s[:count], References(*here), References(*ahead))
