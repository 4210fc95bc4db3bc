"""Parameters of the estimator."""

from dataclasses import dataclass


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
    parked_below_m: float = 0.35
    """Height of another vehicle's origin in W below which it stands on the ground if it does not move."""
    drop_repeats: bool = True
    """False only for simulations without noise, where a pose can really repeat."""
