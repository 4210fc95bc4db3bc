"""Recorded flight as arrays for numbers and figures: times since lift-off, errors, phases. Pure."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.analysis.report.trajectories import (
    LEAST_CYCLES,
    UNNAMED,
    Mask,
    Trajectory,
    law_label,
    runs,
    trajectory_name,
)
from companion.analysis.summary import tracking_error_w_m
from companion.core.types import Array
from companion.records.read import FlightRecord
from companion.supervisor.flight_state import Phase

__all__ = ["Flown", "Mask", "Stretch", "Trajectory"]
STALE_S = 0.5
"""Age from which a pose no longer shows the vehicle's position."""
FRAME_TO_SETPOINT = "frame to setpoint"
GROUND_TO_SETPOINT = "ground's capture to setpoint"


@dataclass(frozen=True)
class Stretch:
    """Phase or law, from its first cycle to the first one of the next."""

    name: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Flown:
    """One flight; columns are NaN, or absent, where nothing was recorded."""

    record: FlightRecord

    @property
    def name(self) -> str:
        """Name of the file without its suffix."""
        return self.record.path.stem

    def column(self, name: str, width: int = 0) -> Array:
        """Return a column as floats, (n,) or (n, width); NaN if the record does not have it."""
        found = self.record.columns.get(name)
        if found is not None:
            return np.asarray(found, dtype=np.float64)
        count = len(self.record.columns["time_s"])
        return np.full((count, width) if width else count, np.nan)

    def words(self, name: str) -> NDArray[np.str_]:
        """Return a column of strings; empty strings if the record does not have it."""
        found = self.record.columns.get(name)
        return np.full(len(self.record.columns["time_s"]), "") if found is None else found.astype(str)

    def has(self, name: str) -> bool:
        """Return whether the column exists and has a finite value."""
        return name in self.record.columns and bool(np.isfinite(self.column(name)).any())

    @cached_property
    def zero_s(self) -> float:
        """Service's time at lift-off; without a flight, at the start of the record."""
        return float(self.column("time_s")[np.argmax(self.airborne)])

    @cached_property
    def time_s(self) -> Array:
        """Time since lift-off, (n,), s."""
        return self.column("time_s") - self.zero_s

    @cached_property
    def airborne(self) -> Mask:
        """Cycles that the law flew, (n,)."""
        return self.column("airborne") > 0.0

    @cached_property
    def free(self) -> Mask:
        """Cycles in the air whose reference is above the floor, unlike at the end of a landing, (n,)."""
        return np.asarray(self.airborne & ~(self.column("reference_position_w_m", 3)[:, 2] < 0.0))

    @cached_property
    def in_the_air(self) -> Mask:
        """Cycles from lift-off on in which the law flew, or the autopilot reported that it was in the air, (n,)."""
        landing = np.isin(self.words("phase"), [str(Phase.LAND), str(Phase.DISARMED)])
        theirs = (self.column("in_air") > 0.0) & (self.time_s >= 0.0) & ~landing & self.airborne.any()
        return np.asarray(self.airborne | theirs)

    @cached_property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """Trajectories in order of time; a goto does not count."""
        number = self.runs(self.airborne & (self.words("phase") == str(Phase.TRACK)))
        otherwise = str(self.record.metadata.get("trajectory") or UNNAMED)
        found = []
        for one in range(int(number.max(initial=-1)) + 1):
            mask = number == one
            rows = np.flatnonzero(mask)
            begin_s = float(self.column("time_s")[rows[0]])
            name = trajectory_name(self.record.events, begin_s, law_label(otherwise))
            if len(rows) >= LEAST_CYCLES and name:
                laws = ", ".join(dict.fromkeys(law_label(str(law)) for law in self.words("law_name")[mask] if law))
                times = (float(self.time_s[rows[0]]), float(self.time_s[rows[-1]]))
                found.append(Trajectory(name, laws or ", ".join(self.law_names), *times, mask))
        return tuple(found)

    @cached_property
    def tracked(self) -> Mask:
        """Cycles that flew a trajectory, (n,)."""
        tracked = np.zeros(len(self.time_s), dtype=bool)
        for one in self.trajectories:
            tracked |= one.mask
        return tracked

    def runs(self, among: Mask) -> NDArray[np.int_]:
        """Number the runs of these cycles without missing ones, (n,); -1 elsewhere."""
        return runs(among, self.column("tick"))

    @cached_property
    def position_w_m(self) -> Array:
        """Position of the vehicle, (n, 3) in W, m; NaN while there is no fresh pose."""
        stale = self.column("age_s") > STALE_S
        return np.where(stale[:, None], np.nan, self.column("position_w_m", 3))

    @cached_property
    def reference_w_m(self) -> Array:
        """Reference position, (n, 3) in W, m; NaN where it is below the floor, at the end of a landing."""
        reference = self.column("reference_position_w_m", 3)
        return np.where(reference[:, 2:] < 0.0, np.nan, reference)

    @cached_property
    def error_w_m(self) -> Array:
        """Position at the time of the cycle minus the reference, (n, 3) in W, m; NaN without one of them.

        It is NaN also where the reference is below the floor, at the end of a landing.
        """
        columns: dict[str, NDArray[np.generic]] = {
            name: self.column(name, width)
            for name, width in (
                ("age_s", 0),
                ("velocity_w_mps", 3),
                ("position_w_m", 3),
                ("reference_position_w_m", 3),
            )
        }
        return np.where(np.isnan(self.reference_w_m), np.nan, tracking_error_w_m(columns))

    @cached_property
    def distance_m(self) -> Array:
        """Norm of the error, (n,), m."""
        return np.asarray(np.sqrt((self.error_w_m**2).sum(axis=1)))

    @cached_property
    def sent(self) -> Mask:
        """Cycles that sent a setpoint, (n,)."""
        return np.isfinite(self.column("sent_s"))

    @cached_property
    def event(self) -> Mask:
        """Cycles in which the law's trigger fired, (n,)."""
        return self.column("event") > 0.0

    def latencies_s(self) -> dict[str, Array]:
        """Return the latencies of the cycles in the air by name, s, without those not recorded."""
        time_s, sent_s, came_s = (self.column(name) for name in ("time_s", "sent_s", "frame_received_s"))
        found = {
            "age of the pose used": self.column("age_s"),
            "cycle late": self.column("late_s"),
            FRAME_TO_SETPOINT: sent_s - came_s,
            "capture to setpoint": sent_s - time_s + self.column("age_s"),
            GROUND_TO_SETPOINT: sent_s - np.where(self.event, self._ground_capture_s, np.nan),
        }
        return {name: known for name, all_s in found.items() if len(known := _finite(all_s[self.airborne]))}

    @property
    def _ground_capture_s(self) -> Array:
        """Capture of the frame that the newest command of a law on the ground was computed from, s; else NaN."""
        return self.column("link_command_sent_s") - self.column("link_capture_ago_s")

    def gaps_s(self, among: Mask) -> tuple[Array, Array]:
        """Return the times of triggers among these cycles, and the time since the previous one in the same run, s.

        The first trigger of each run is left out: the time between two trajectories is no gap.
        """
        rows = np.flatnonzero(among & self.event)
        same = np.diff(self.runs(among)[rows]) == 0
        return self.time_s[rows][1:][same], np.diff(self.time_s[rows])[same]

    @cached_property
    def phases(self) -> tuple[Stretch, ...]:
        """Phases of the flight in order of time."""
        return self._stretches(self.words("phase"))

    @cached_property
    def laws(self) -> tuple[Stretch, ...]:
        """Laws that flew, in order of time."""
        labels = [law_label(name) for name in self.words("law_name").tolist()]
        names = np.where(self.airborne, np.array(labels, dtype=str), "")
        if not (names != "").any():
            return ()
        return tuple(stretch for stretch in self._stretches(names) if stretch.name)

    def _stretches(self, words: NDArray[np.str_]) -> tuple[Stretch, ...]:
        edges = [0, *(np.flatnonzero(words[1:] != words[:-1]) + 1).tolist(), len(words) - 1]
        return tuple(
            Stretch(str(words[begin]), float(self.time_s[begin]), float(self.time_s[end]))
            for begin, end in pairwise(edges)
            if end > begin
        )

    @property
    def law_names(self) -> tuple[str, ...]:
        """Names of the laws that flew; the configured one if the record has none."""
        names = tuple(dict.fromkeys(stretch.name for stretch in self.laws))
        configured: Any = (self.record.metadata.get("controller") or {}).get("name", "")
        return names or ((law_label(str(configured)),) if configured else ())


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]
