"""Do motion capture and autopilot agree on the attitude, and does the vehicle follow its setpoint. Pure."""

from math import atan2, cos, exp, isfinite, remainder, sin, sqrt, tau

from companion.core.types import Array, AttitudeThrust, VehicleState
from companion.core.values import value
from companion.geometry.frames import up_axis_parts
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.horizon import Axis, Pushed, autopilot_lies, between_rad, pushed_on
from companion.supervisor.health.memory import NEVER, since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

HEARD_S = 0.2
"""An attitude of the autopilot older than this is compared with nothing."""


@value
class Answer:
    """Tilt of a healthy vehicle: x and y of its up axis in W, and their rates (1/s)."""

    x: float
    y: float
    x_rate: float
    y_rate: float
    sent: AttitudeThrust | None
    """What it answers from now on."""
    at_s: float


@value
class AttitudeHealth:
    """What is remembered."""

    tilt_since_s: float = NEVER
    heading_since_s: float = NEVER
    answer: Answer | None = None
    """None on the ground."""
    stood: Axis | None = None
    """The vehicle's up axis in W as it stood when the motors were armed."""
    not_followed_since_s: float = NEVER
    pushed: Pushed | None = None
    """None on the ground, and while the tilts cannot be compared."""
    horizon_wrong: bool = False
    """The autopilot's, for as long as the tilts disagree."""


_NOTHING = AttitudeHealth()


def look_at_attitude(
    memory: AttitudeHealth, now: HealthInputs, rules: SafetyRules
) -> tuple[AttitudeHealth, list[Event]]:
    """Only while the autopilot is commanded: an EKF that has still to find its heading is the preflight's matter."""
    vehicle = now.seen.vehicle
    if vehicle is None or not now.commanded:
        return _NOTHING, []
    fresh = now.seen.age_s < rules.degraded_s
    up, theirs = up_axis_parts(vehicle.q_w_flu_wxyz), up_axis_parts(now.autopilot.q_w_flu_wxyz)
    tilt_rad = heading_rad = 0.0
    pushed = None
    if fresh and now.time_s - now.autopilot.attitude_s <= HEARD_S:
        tilt_rad = between_rad(up, theirs)
        heading_rad = _turn(vehicle.q_w_flu_wxyz, now.autopilot.q_w_flu_wxyz)
        if now.airborne:
            pushed = pushed_on(memory.pushed, vehicle.time_s, vehicle.velocity_w_mps, up, theirs)
    tilt_since_s = since(memory.tilt_since_s, tilt_rad > rules.tilt_apart_rad, now.time_s)
    apart = now.time_s - tilt_since_s >= rules.apart_s
    same_heading = not heading_rad > rules.heading_apart_rad
    horizon_wrong = apart and (memory.horizon_wrong or (same_heading and autopilot_lies(pushed)))
    answer = _answered(memory.answer, now, vehicle, rules) if now.airborne else None
    stood = up if memory.stood is None else memory.stood
    tilted = theirs if horizon_wrong else up  # it follows by its own horizon
    off_rad = between_rad(tilted, stood if answer is None else _up_of(answer)) if fresh else 0.0
    memory = AttitudeHealth(
        tilt_since_s,
        since(memory.heading_since_s, heading_rad > rules.heading_apart_rad, now.time_s),
        answer,
        stood,
        since(memory.not_followed_since_s, off_rad > rules.not_followed_rad, now.time_s),
        pushed,
        horizon_wrong,
    )
    return memory, _events(memory, now, (tilt_rad, heading_rad, off_rad), rules)


def _events(memory: AttitudeHealth, now: HealthInputs, off_rad: Axis, rules: SafetyRules) -> list[Event]:
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


def _turn(a: Array, b: Array) -> float:
    """The part about the world's vertical of the turn from one attitude to the other, rad, without sign.

    Whose tilt is wrong, has the right heading: the difference of the two noses' directions would be a tilt's, too.
    """
    (aw, ax, ay, az), (bw, bx, by, bz) = a.tolist(), b.tolist()
    w, z = aw * bw + ax * bx + ay * by + az * bz, az * bw - aw * bz + ay * bx - ax * by
    return abs(remainder(2.0 * atan2(z, w), tau))


def _up_of(answer: Answer) -> Axis:
    return answer.x, answer.y, sqrt(max(0.0, 1.0 - answer.x * answer.x - answer.y * answer.y))


def _answered(answer: Answer | None, now: HealthInputs, vehicle: VehicleState, rules: SafetyRules) -> Answer:
    """The answer to what was sent, one cycle on; begins as the vehicle is, at rest.

    Second order, solved exactly for a setpoint that stood still through the cycle: a late cycle makes no error.
    """
    if answer is None or answer.sent is None or not isfinite(answer.x + answer.y):
        x, y, _ = up_axis_parts(vehicle.q_w_flu_wxyz)
        return Answer(x, y, 0.0, 0.0, now.sent, now.time_s)
    wanted_x, wanted_y, _ = up_axis_parts(answer.sent.q_w_flu_wxyz)
    w, damping = rules.follow_radps, rules.follow_damping
    passed_s = min(max(0.0, now.time_s - answer.at_s), 1.0)
    turning_radps = w * sqrt(1.0 - damping * damping)
    fall = exp(-damping * w * passed_s)
    c, s = fall * cos(turning_radps * passed_s), fall * sin(turning_radps * passed_s) / turning_radps
    damped = damping * w * s
    off_x, off_y = answer.x - wanted_x, answer.y - wanted_y
    return Answer(
        wanted_x + off_x * (c + damped) + answer.x_rate * s,
        wanted_y + off_y * (c + damped) + answer.y_rate * s,
        answer.x_rate * (c - damped) - off_x * w * w * s,
        answer.y_rate * (c - damped) - off_y * w * w * s,
        now.sent,
        now.time_s,
    )
