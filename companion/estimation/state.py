"""Parameters, state and verdicts of the estimator."""

from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, sqrt

from companion.core.types import Vec3, VehicleState
from companion.estimation.attitude import Attitude
from companion.estimation.clock_sync import ClockSync
from companion.estimation.kalman import Motion


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
class EstimatorParams:
    """Tuning. The defaults fit Qualisys at 100 Hz: 0.3 mm, 2 mrad, an airframe of 6 to 8 rad/s."""

    delay_s: float = 0.010
    """Least time from capture to arrival."""
    clock_window_s: float = 10.0
    """Time window over which the clocks are compared."""
    noise_m: float = 0.0003
    """Standard deviation of a measured position, per axis."""
    noise_rad: float = 0.002
    """Standard deviation of a measured attitude, per body axis."""
    jerk_density: float = 4.0
    """m^2/s^5; places the position filter's poles at 41 rad/s. Lower (0.05: 20 rad/s) when an input is given."""
    angular_jerk_density: float = 80.0
    """rad^2/s^5; places the attitude filter's poles at 35 rad/s."""
    gate_m: float = 0.03
    """Innovation that is never an outlier; what the vehicle's acceleration can explain is added."""
    gate_rad: float = 0.35
    """The same for the attitude."""
    max_accel_mps2: float = 20.0
    """Twice gravity: more than this airframe can do."""
    max_turn_radps2: float = 60.0
    """Angular acceleration beyond what this airframe can do."""
    outliers_to_restart: int = 10
    """Number of outliers in agreement after which the estimate restarts from them."""
    agree_m: float = 0.05
    """Largest distance between successive outliers that agree."""
    agree_rad: float = 0.35
    """The same for the attitude."""
    ahead_s: float = 0.1
    """Time by which a stamp must be ahead of its frame's arrival to show a clock that has jumped."""
    stamps_to_restart: int = 10
    """Number of stamps in a row that go back, or are ahead, after which the estimate restarts with the new clock."""
    max_gap_s: float = 1.0
    """Time without an accepted frame, by both clocks, after which the estimate restarts."""
    room_m: float = 100.0
    """Largest distance from the origin of W; no room is larger."""
    drop_repeats: bool = True
    """False only for simulations without noise, where a pose can really repeat."""


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

    @property
    def velocity_std_mps(self) -> float:
        """Standard deviation of the velocity per axis; falls from 1 m/s to its steady value within about 0.1 s."""
        return sqrt(self.motion.covariance.vv) if self.motion is not None else inf
