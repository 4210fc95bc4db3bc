"""State and verdicts of the estimator."""

from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, sqrt
from typing import Protocol

from companion.core.types import Vec3, VehicleState
from companion.estimation.attitude import Attitude
from companion.estimation.clock_sync import ClockSync
from companion.estimation.kalman import Motion
from companion.estimation.others import OtherTrack
from companion.estimation.params import EstimatorParams

__all__ = ["Counts", "Estimate", "EstimatorParams", "EstimatorState", "Verdict"]


class Verdict(StrEnum):
    """Verdict of the estimator on a frame."""

    ACCEPTED = "accepted"
    STARTED = "started"
    """Accepted, and the former estimate discarded: the first frame, after a long gap, or after a real jump."""
    UNTRACKED = "untracked"
    INVALID = "invalid"
    """Not a rotation, or outside of any room."""
    REPEATED = "repeated"
    """The very same pose again: the system is frozen. Real measurements never repeat to the last bit."""
    STALE = "stale"
    """Captured no later than the last accepted frame."""
    AHEAD = "ahead"
    """Its stamp is later than its arrival."""
    OUTLIER = "outlier"
    """Further from the prediction than physics allows."""


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Number of frames by their verdict."""

    accepted: int = 0
    started: int = 0
    untracked: int = 0
    invalid: int = 0
    repeated: int = 0
    stale: int = 0
    ahead: int = 0
    outlier: int = 0

    def plus(self, verdict: Verdict) -> "Counts":
        """Return the counts with one more of this verdict; `replace` would take 3 us more."""
        return Counts(**{**vars(self), verdict.value: getattr(self, verdict.value) + 1})


class Estimate(Protocol):
    """Part of an estimate that setpoints and checks depend on."""

    @property
    def vehicle(self) -> VehicleState | None:
        """State at the capture of the last accepted frame; None before the first one."""

    @property
    def verdict(self) -> Verdict | None:
        """Verdict on the last frame."""

    @property
    def others(self) -> tuple[OtherTrack, ...]:
        """The other vehicles of [separation]."""

    @property
    def others_s(self) -> float:
        """Stamp of the last frame that the others were taken from."""


@dataclass(frozen=True, kw_only=True)
class EstimatorState:
    """State of the estimator; `EstimatorState()` is the initial one."""

    vehicle: VehicleState | None = None
    """State at the capture of the last accepted frame; None before the first one."""
    verdict: Verdict | None = None
    """Verdict on the last frame."""
    run: int = 0
    """Number of frames in a row with this verdict."""
    counts: Counts = field(default_factory=Counts)
    clock: ClockSync = field(default_factory=ClockSync)
    motion: Motion | None = None
    attitude: Attitude | None = None
    stamp_s: float = -inf
    """Stamp of the last accepted frame."""
    received_s: float = -inf
    """Arrival of the last accepted frame."""
    pose: tuple[float, ...] = ()
    """Position and rotation of the last tracked frame, whatever its verdict."""
    velocity_off_w_mps: Vec3 = (0.0, 0.0, 0.0)
    """Without frames: the autopilot's velocity less the true one, as the ground's poses show it."""
    agreeing: int = 0
    """Outliers in a row that agree with each other; 0 unless the last tracked frame was one."""
    others: tuple[OtherTrack, ...] = ()
    """The other vehicles of [separation]."""
    others_s: float = -inf
    """Stamp of the last frame that the others were taken from."""

    @property
    def velocity_std_mps(self) -> float:
        """Standard deviation of the velocity per axis; falls from 1 m/s to its steady value within about 0.1 s."""
        return sqrt(self.motion.covariance.vv) if self.motion is not None else inf
