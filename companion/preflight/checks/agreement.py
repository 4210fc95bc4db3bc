"""Agreement of motion capture and the autopilot's estimator for a vehicle that stands."""

import math
from dataclasses import dataclass

import numpy as np

from companion.core.types import Array
from companion.geometry.frames import matrix_from_quat, yaw_of
from companion.preflight.checks.check import Check

HORIZON_SETTLED_S = 60.0
"""Longer than the horizon of a landed PX4 needs; recorded, v1.17: 3.8 degrees off at first, below 2.9 after 3 s."""
HORIZON_APART_RAD = 0.1
"""More than a flight leaves: a slipped marker plate, or a vehicle that lies on its side."""


@dataclass(frozen=True)
class Difference:
    """The autopilot's angles less motion capture's, medians, rad."""

    roll_rad: float
    """Right side down is positive."""
    pitch_rad: float
    """Nose up is positive."""
    heading_rad: float
    """To the left is positive."""


@dataclass(frozen=True)
class VisionFacts:
    """State of the autopilot's vision fusion."""

    fused: bool
    """Its estimator says that it has a position relative to its origin."""
    apart_m: float
    """Median distance between its position and motion capture's; NaN when it tells none."""


def apart(mocap_q_wxyz: Array, autopilot_q_wxyz: Array) -> Difference:
    """Return the median differences of attitudes (n, 4) taken at the same times, body FLU to W; NaN without any."""
    if not len(mocap_q_wxyz):
        return Difference(math.nan, math.nan, math.nan)
    ours, theirs = _angles_rad(mocap_q_wxyz), _angles_rad(autopilot_q_wxyz)
    off = (theirs - ours + math.pi) % math.tau - math.pi
    first = off[0]
    around = first + np.median((off - first + math.pi) % math.tau - math.pi, axis=0)
    roll, pitch, heading = (math.remainder(angle, math.tau) for angle in around.tolist())
    return Difference(roll, pitch, heading)


def _angles_rad(q: Array) -> Array:
    """Return roll, pitch and heading, rad, (n, 3), with the signs of `Difference`."""
    up_b = matrix_from_quat(q)[:, 2, :]
    roll = np.arctan2(up_b[:, 1], up_b[:, 2])
    pitch = np.arcsin(np.clip(up_b[:, 0], -1.0, 1.0))
    return np.stack((roll, pitch, yaw_of(q)), axis=-1)


def settles(tilt_rad: float, landed_age_s: float) -> bool:
    """Return whether a tilt apart (rad) may be what the last flight has left of PX4's horizon, which passes."""
    return landed_age_s < HORIZON_SETTLED_S and abs(tilt_rad) < HORIZON_APART_RAD


def check_tilts(off: Difference, most_rad: float, landed_age_s: float = math.inf) -> tuple[Check, Check]:
    """Check roll and pitch: the body's definition in QTM must be level when the autopilot is.

    `landed_age_s` is the time since a flight ended before which both agreed; infinite when none is known.
    """
    return (
        _check("roll agrees", off.roll_rad, most_rad, landed_age_s, ("right side down", "left side down"), "x"),
        _check("pitch agrees", off.pitch_rad, most_rad, landed_age_s, ("nose up", "nose down"), "y"),
    )


def _check(
    name: str, angle_rad: float, most_rad: float, landed_age_s: float, ways: tuple[str, str], axis: str
) -> Check:
    says = _degrees(angle_rad, most_rad, ways)
    quarter = _quarter(angle_rad)
    if settles(angle_rad, landed_age_s):
        todo = (
            "wait half a minute and try again: both agreed before the flight, and PX4's horizon is still off from it; "
            "if it stays, look at the markers, which a landing may have moved"
        )
    elif quarter:
        todo = f"the body in QTM is turned by {quarter} degrees about its {axis} axis: x is the nose, y left, z up"
    else:
        todo = (
            "define the body in QTM while the vehicle stands level, or calibrate PX4's level horizon; right after a "
            "flight, wait half a minute first"
        )
    return Check(name, abs(angle_rad) <= most_rad, says, todo)


def check_heading(off: Difference, most_rad: float) -> Check:
    """Check the heading: setpoints use motion capture's, so with another north the vehicle flies off sideways."""
    quarter = _quarter(off.heading_rad)
    about = f", as if the frames were turned by {quarter} degrees" if quarter else ""
    todo = (
        f"PX4 does not take its heading from vision{about}: EKF2_EV_CTRL with bit 3, EKF2_MAG_TYPE = 5, reboot; "
        "and in QTM the body's x axis must be the nose"
    )
    says = _degrees(off.heading_rad, most_rad, ("to the left", "to the right"))
    return Check("heading agrees", abs(off.heading_rad) <= most_rad, says, todo)


def _degrees(angle_rad: float, most_rad: float, ways: tuple[str, str]) -> str:
    most = f"at most {math.degrees(most_rad):.0f} wanted"
    if math.isnan(angle_rad):
        return f"not known, {most}"
    way = ways[0] if angle_rad >= 0.0 else ways[1]
    return f"the autopilot is {abs(math.degrees(angle_rad)):.1f} degrees more {way} than mocap, {most}"


def _quarter(angle_rad: float) -> int:
    """Return the signed quarter turn, 90 or 180 degrees, that the angle is near; 0 for any other."""
    if math.isnan(angle_rad):
        return 0
    turns = round(angle_rad / (0.5 * math.pi))
    near = abs(angle_rad - 0.5 * math.pi * turns) < math.radians(20.0)
    return 90 * turns if near else 0


def check_vision(seen: VisionFacts, most_m: float) -> Check:
    """Check that EKF2 fuses the poses: without them PX4 cannot land or hold by itself."""
    where = "no position" if math.isnan(seen.apart_m) else f"its position {seen.apart_m:.2f} m from mocap's"
    says = f"{'fused' if seen.fused else 'not fused'}, {where}, at most {most_m:g} m wanted"
    todo = (
        "EKF2_EV_CTRL = 15, EKF2_HGT_REF = 3, EKF2_GPS_CTRL = 0, reboot PX4, wait 10 s; and px4.vision_rate_hz at "
        "30 or more"
    )
    return Check("vision fused", seen.fused and seen.apart_m <= most_m, says, todo)


def check_delay(parameter_ms: float, measured_s: float, most_s: float) -> Check:
    """Check EKF2_EV_DELAY against the delay from capture to arrival; NaN where unknown."""
    wanted_ms = round(1e3 * measured_s) if math.isfinite(measured_s) else 0
    says = f"EKF2_EV_DELAY = {parameter_ms:g} ms, mocap's delay here {1e3 * measured_s:.0f} ms"
    off_s = abs(1e-3 * parameter_ms - measured_s)
    todo = f"set EKF2_EV_DELAY = {wanted_ms} and reboot PX4, or measure mocap.delay_s again"
    return Check("vision delay", off_s <= most_s, f"{says}, at most {1e3 * most_s:.0f} ms apart wanted", todo)
