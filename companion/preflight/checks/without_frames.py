"""A vehicle that motion capture's frames do not reach: what it knows of its pose, and what is off without them."""

import math
from dataclasses import dataclass

from companion.core.types import AutopilotStatus
from companion.preflight.checks.check import Check
from companion.supervisor.without_frames import OFF_BESIDE_FAULTS, OFF_BY_NEED, off_words

OFF_HERE = (
    "body seen", "mocap rate", "mocap age", "mocap residual", "roll agrees", "pitch agrees", "carried by hand",
)  # fmt: skip
"""Checks of the list that need frames on the vehicle."""
_LEAST_HZ = 15.0
"""Rate of poses: a beat every 0.05 s, the slowest allowed, and a quarter of them lost."""
_MOST_AGE_S = 0.15
_TODO = "to have them, let the frames reach the vehicle (law.onboard_mocap = true); docs/split.md says what is lost"


@dataclass(frozen=True)
class GroundPoseFacts:
    """Poses of the law on the ground over some seconds."""

    poses: int
    seconds_s: float

    @property
    def rate_hz(self) -> float:
        """Rate of poses that were new, Hz."""
        return self.poses / self.seconds_s if self.seconds_s > 0.0 else 0.0


def check_off() -> tuple[Check, ...]:
    """Return a warning for each kind of check that is off."""
    faults = tuple(Check(need, False, off_words(names), _TODO, must=False) for need, names in OFF_BY_NEED.items())
    guard = Check("guard and horizon", False, off_words(OFF_BESIDE_FAULTS), _TODO, must=False)
    here = Check("preflight checks", False, off_words(OFF_HERE), _TODO, must=False)
    return *faults, guard, here


def check_ground_poses(seen: GroundPoseFacts) -> Check:
    """Check that the ground's poses come often enough for phases, landing, and the autopilot's estimator."""
    says = f"{seen.rate_hz:.0f} poses a second, at least {_LEAST_HZ:g} wanted"
    todo = "does `companion law` run on the ground with law.onboard_mocap = false, and see the body?"
    return Check("ground's poses", seen.rate_hz >= _LEAST_HZ, says, todo)


def check_own_motion(status: AutopilotStatus, now_s: float) -> Check:
    """Check that the autopilot's attitude and velocity come, from which the motion is estimated."""
    ages_s = now_s - status.attitude_s, now_s - status.velocity_s
    known = all(map(math.isfinite, ages_s))
    attitude_ms, velocity_ms = (1e3 * age_s for age_s in ages_s)
    says = f"attitude {attitude_ms:.0f} ms old, velocity {velocity_ms:.0f} ms" if known else "not both heard"
    todo = (
        "set up PX4's link as onboard (MAV_x_MODE = 2), which sends ATTITUDE_QUATERNION at 50 Hz and "
        "LOCAL_POSITION_NED at 30 Hz"
    )
    most = f"at most {1e3 * _MOST_AGE_S:.0f} ms wanted"
    return Check("autopilot's motion", known and max(ages_s) <= _MOST_AGE_S, f"{says}, {most}", todo)
