"""Health checks of the attitude: motion capture against autopilot, and vehicle against setpoint. Pure."""

from math import atan2, cos, exp, isfinite, remainder, sin, sqrt, tau

from companion.core.types import Array, AttitudeThrust, Vec3, VehicleState
from companion.core.values import value
from companion.geometry.frames import up_axis_floats
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.horizon import (
    MotionMeans,
    angle_between_rad,
    autopilot_horizon_wrong,
    update_means,
)
from companion.supervisor.health.memory import NOT_HELD, held_since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

ATTITUDE_MAX_AGE_S = 0.2
"""Largest age of the autopilot's attitude that is still compared."""


@value
class ExpectedTilt:
    """Tilt of a healthy vehicle: x and y of its up axis in W, and their rates (1/s)."""

    x: float
    y: float
    x_rate: float
    y_rate: float
    sent: AttitudeThrust | None
    """Setpoint it responds to from now on."""
    at_s: float


@value(kw_only=True)
class AttitudeHealth:
    """Memory of the attitude checks."""

    tilt_since_s: float = NOT_HELD
    heading_since_s: float = NOT_HELD
    answer: ExpectedTilt | None = None
    """None on the ground."""
    stood: Vec3 | None = None
    """The vehicle's up axis in W as it stood when the motors were armed."""
    not_followed_since_s: float = NOT_HELD
    means: MotionMeans | None = None
    """None on the ground, and while the tilts cannot be compared."""
    horizon_wrong: bool = False
    """The autopilot's horizon is wrong; kept for as long as the tilts disagree."""


_NOTHING = AttitudeHealth()


def check_attitude(memory: AttitudeHealth, now: HealthInputs, rules: SafetyRules) -> tuple[AttitudeHealth, list[Event]]:
    """Check the attitude while the autopilot is commanded; before that the preflight checks the EKF's heading."""
    vehicle = now.mocap.vehicle
    if vehicle is None or not now.commanded:
        return _NOTHING, []
    fresh = now.mocap.age_s < rules.degraded_s
    up, theirs = up_axis_floats(vehicle.q_w_flu_wxyz), up_axis_floats(now.autopilot.q_w_flu_wxyz)
    tilt_rad = heading_rad = 0.0
    means = None
    if fresh and now.time_s - now.autopilot.attitude_s <= ATTITUDE_MAX_AGE_S:
        tilt_rad = angle_between_rad(up, theirs)
        heading_rad = _heading_difference_rad(vehicle.q_w_flu_wxyz, now.autopilot.q_w_flu_wxyz)
        if now.airborne:
            means = update_means(memory.means, vehicle.time_s, vehicle.velocity_w_mps, up, theirs)
    tilt_since_s = held_since(memory.tilt_since_s, tilt_rad > rules.tilt_apart_rad, now.time_s)
    apart = now.time_s - tilt_since_s >= rules.apart_s
    same_heading = not heading_rad > rules.heading_apart_rad
    horizon_wrong = apart and (memory.horizon_wrong or (same_heading and autopilot_horizon_wrong(means)))
    answer = _expected_tilt(memory.answer, now, vehicle, rules) if now.airborne else None
    stood = up if memory.stood is None else memory.stood
    tilted = theirs if horizon_wrong else up  # the autopilot follows its own horizon
    off_rad = angle_between_rad(tilted, stood if answer is None else _up_of(answer)) if fresh else 0.0
    memory = AttitudeHealth(
        tilt_since_s=tilt_since_s,
        heading_since_s=held_since(memory.heading_since_s, heading_rad > rules.heading_apart_rad, now.time_s),
        answer=answer,
        stood=stood,
        not_followed_since_s=held_since(memory.not_followed_since_s, off_rad > rules.not_followed_rad, now.time_s),
        means=means,
        horizon_wrong=horizon_wrong,
    )
    return memory, _events(memory, now, (tilt_rad, heading_rad, off_rad), rules)


def _events(memory: AttitudeHealth, now: HealthInputs, off_rad: Vec3, rules: SafetyRules) -> list[Event]:
    events, now_s = [], now.time_s
    if memory.horizon_wrong:
        text = f"the autopilot's horizon is {off_rad[0]:.2f} rad off: the vehicle moves as motion capture sees it"
        events.append(Event(Fault.HORIZON_WRONG, text))
    elif now_s - memory.tilt_since_s >= rules.apart_s:
        text = f"motion capture and autopilot disagree on the tilt by {off_rad[0]:.2f} rad"
        events.append(Event(Fault.ATTITUDE_DISAGREES, text))
    if now_s - memory.heading_since_s >= rules.apart_s:
        text = f"motion capture and autopilot disagree on the heading by {off_rad[1]:.2f} rad"
        events.append(Event(Fault.HEADING_DISAGREES, text))
    if now_s - memory.not_followed_since_s >= rules.not_followed_s:
        what = "the answer of a healthy vehicle" if now.airborne else "what it was at arming: it tips over"
        text = f"the tilt is {off_rad[2]:.2f} rad off {what}"
        events.append(Event(Fault.SETPOINT_NOT_FOLLOWED, text))
    return events


def _heading_difference_rad(a: Array, b: Array) -> float:
    """Return the rotation about the world's vertical from one attitude to the other, rad, without sign.

    It does not depend on a tilt error, as the difference of the two noses' directions would.
    """
    (aw, ax, ay, az), (bw, bx, by, bz) = a.tolist(), b.tolist()
    w, z = aw * bw + ax * bx + ay * by + az * bz, az * bw - aw * bz + ay * bx - ax * by
    return abs(remainder(2.0 * atan2(z, w), tau))


def _up_of(answer: ExpectedTilt) -> Vec3:
    return answer.x, answer.y, sqrt(max(0.0, 1.0 - answer.x * answer.x - answer.y * answer.y))


def _expected_tilt(
    answer: ExpectedTilt | None, now: HealthInputs, vehicle: VehicleState, rules: SafetyRules
) -> ExpectedTilt:
    """Return the expected response to the setpoint sent, one cycle on; begins with the vehicle's tilt, at rest.

    Second order, solved exactly for a constant setpoint during the cycle, so that a late cycle causes no error.
    """
    if answer is None or answer.sent is None or not isfinite(answer.x + answer.y):
        x, y, _ = up_axis_floats(vehicle.q_w_flu_wxyz)
        return ExpectedTilt(x, y, 0.0, 0.0, now.sent, now.time_s)
    target_x, target_y, _ = up_axis_floats(answer.sent.q_w_flu_wxyz)
    w, damping = rules.follow_radps, rules.follow_damping
    passed_s = min(max(0.0, now.time_s - answer.at_s), 1.0)
    turning_radps = w * sqrt(1.0 - damping * damping)
    fall = exp(-damping * w * passed_s)
    c, s = fall * cos(turning_radps * passed_s), fall * sin(turning_radps * passed_s) / turning_radps
    damped = damping * w * s
    off_x, off_y = answer.x - target_x, answer.y - target_y
    return ExpectedTilt(
        target_x + off_x * (c + damped) + answer.x_rate * s,
        target_y + off_y * (c + damped) + answer.y_rate * s,
        answer.x_rate * (c - damped) - off_x * w * w * s,
        answer.y_rate * (c - damped) - off_y * w * w * s,
        now.sent,
        now.time_s,
    )
