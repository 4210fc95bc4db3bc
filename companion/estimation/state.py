"""What the estimator is told, what it remembers, and what it says of each frame."""

from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, sqrt

from companion.core.types import VehicleState
from companion.estimation.attitude import Attitude
from companion.estimation.clock_sync import ClockSync
from companion.estimation.kalman import Motion


class Verdict(StrEnum):
    """What became of a frame."""

    ACCEPTED = "accepted"
    STARTED = "started"
    """Accepted, and everything known before is void: the first one, after a long gap, or after a real jump."""
    UNTRACKED = "untracked"
    INVALID = "invalid"
    """Not a rotation, or outside of any room."""
    REPEATED = "repeated"
    """The very same pose again: the system is frozen. Real measurements never repeat to the last bit."""
    STALE = "stale"
    """Captured no later than the last accepted frame."""
    AHEAD = "ahead"
    """Captured later than it came, says its stamp."""
    OUTLIER = "outlier"
    """Further from the prediction than physics allows."""


@dataclass(frozen=True)
class EstimatorParams:
    """Tuning. The defaults fit Qualisys at 100 Hz: 0.3 mm, 2 mrad, an airframe of 6 to 8 rad/s."""

    delay_s: float = 0.010
    """Least time from capture to arrival."""
    clock_window_s: float = 10.0
    """How far back the clocks are compared."""
    noise_m: float = 0.0003
    """Standard deviation of a measured position, per axis."""
    noise_rad: float = 0.002
    """Standard deviation of a measured attitude, per body axis."""
    jerk_density: float = 4.0
    """m^2/s^5; places the position filter's poles at 41 rad/s. Lower (0.05: 20 rad/s) when an input is given."""
    angular_jerk_density: float = 80.0
    """rad^2/s^5; places the attitude filter's poles at 35 rad/s."""
    gate_m: float = 0.03
    """Surprise that is never an outlier; what the vehicle's acceleration can explain comes on top."""
    gate_rad: float = 0.35
    """The same for the attitude."""
    max_accel_mps2: float = 20.0
    """Twice gravity: more than this airframe can do."""
    max_turn_radps2: float = 60.0
    """Angular acceleration beyond what this airframe can do."""
    outliers_to_restart: int = 10
    """So many outliers that agree with each other are the truth: start anew from there."""
    agree_m: float = 0.05
    """Outliers agree when each is so close to the one before."""
    agree_rad: float = 0.35
    """The same for the attitude."""
    ahead_s: float = 0.1
    """A stamp so far ahead of its frame's arrival is of a clock that has jumped."""
    stamps_to_restart: int = 10
    """So many stamps in a row that go back, or are ahead, are a new clock: start anew from there."""
    max_gap_s: float = 1.0
    """Start anew after so long without an accepted frame, by both clocks."""
    room_m: float = 100.0
    """No room is larger."""
    drop_repeats: bool = True
    """False only for simulations without noise, where a pose may repeat honestly."""


@dataclass(frozen=True)
class Counts:
    """How many frames got which verdict."""

    accepted: int = 0
    started: int = 0
    untracked: int = 0
    invalid: int = 0
    repeated: int = 0
    stale: int = 0
    ahead: int = 0
    outlier: int = 0


@dataclass(frozen=True)
class EstimatorState:
    """Everything the estimator remembers; `EstimatorState()` is its beginning."""

    vehicle: VehicleState | None = None
    """At the capture of the last accepted frame; None before the first one."""
    verdict: Verdict | None = None
    """On the last frame."""
    run: int = 0
    """How many frames in a row got it."""
    counts: Counts = field(default_factory=Counts)
    clock: ClockSync = field(default_factory=ClockSync)
    motion: Motion | None = None
    attitude: Attitude | None = None
    stamp_s: float = -inf
    """Of the last accepted frame."""
    received_s: float = -inf
    """Its arrival."""
    pose: tuple[float, ...] = ()
    """Position and rotation of the last tracked frame, whatever the verdict on it."""
    agreeing: int = 0
    """Outliers in a row that agree with each other; 0 unless the last tracked frame was one."""

    @property
    def velocity_std_mps(self) -> float:
        """How uncertain the velocity is, per axis; falls from 1 m/s to its steady value within some 0.1 s."""
        return sqrt(self.motion.covariance.vv) if self.motion is not None else inf
