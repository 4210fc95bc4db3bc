"""PX4's handling of SET_ATTITUDE_TARGET, valid or not (docs/px4-conformance.md, section d)."""

import math
from dataclasses import dataclass, replace

IGNORE_RATES = 1 | 2 | 4
IGNORE_THROTTLE = 64
IGNORE_ATTITUDE = 128
RATE_MAX_RADPS = 3.84

Quad = tuple[float, float, float, float]
Triple = tuple[float, float, float]
LEVEL: Quad = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class AttitudeTarget:
    """SET_ATTITUDE_TARGET as received; quaternion w x y z NED/FRD, rates rad/s, thrust 0..1."""

    type_mask: int
    q_wxyz: Quad
    rate_frd_radps: Triple
    thrust: float


@dataclass(frozen=True)
class AttitudeSetpoint:
    """The setpoint that the attitude loop follows, and the one that ATTITUDE_TARGET repeats."""

    q_wxyz: Quad = LEVEL
    """The last attitude that can be flown."""
    echo_q_wxyz: Quad = LEVEL
    """Attitude as sent, flyable or not."""
    rate_frd_radps: Triple | None = None
    """Set in rate control."""
    signal: float = 0.0
    """Collective motor signal, 0..1 (NaN: none)."""
    echo_thrust: float = 0.0
    attitude_control: bool = False
    """HEARTBEAT shows the stabilize bit."""


def next_setpoint(target: AttitudeTarget, before: AttitudeSetpoint) -> AttitudeSetpoint:
    """Return the setpoint after `target`; an unusable attitude leaves the last usable one, thrust is as in PX4."""
    if target.type_mask & IGNORE_ATTITUDE and target.type_mask & IGNORE_RATES == IGNORE_RATES:
        return before  # everything ignored: fly on with the last values
    thrust = 0.0 if target.type_mask & IGNORE_THROTTLE else target.thrust
    after = replace(before, signal=thrust, echo_thrust=abs(thrust))
    if target.type_mask & IGNORE_ATTITUDE:
        return replace(after, rate_frd_radps=flyable_rates(target.rate_frd_radps), attitude_control=False)
    usable = normalised(target.q_wxyz)
    return replace(
        after,
        q_wxyz=usable or before.q_wxyz,
        echo_q_wxyz=target.q_wxyz,
        rate_frd_radps=None,
        attitude_control=True,
    )


def flyable_rates(rate_frd_radps: Triple) -> Triple:
    """Limit rates (rad/s) to MC_ROLLRATE_MAX and its like, 220 deg/s; NaN becomes 0."""
    p, q, r = (
        min(max(rate, -RATE_MAX_RADPS), RATE_MAX_RADPS) if not math.isnan(rate) else 0.0 for rate in rate_frd_radps
    )
    return (p, q, r)


def normalised(q_wxyz: Quad) -> Quad | None:
    """Return the unit quaternion, or None if the length is zero or not finite."""
    length = math.sqrt(sum(part * part for part in q_wxyz))
    if not math.isfinite(length) or length < 1e-6:
        return None
    w, x, y, z = q_wxyz
    return (w / length, x / length, y / length, z / length)


def signal_for_thrust(thrust: float, factor: float) -> float:
    """Solve factor s^2 + (1 - factor) s = thrust for the signal s; outside 0..1 it is clipped, NaN stays."""
    if math.isnan(thrust):
        return thrust
    thrust = min(max(thrust, 0.0), 1.0)
    if factor <= 0.0:
        return thrust
    linear = 1.0 - factor
    return (-linear + math.sqrt(linear * linear + 4.0 * factor * thrust)) / (2.0 * factor)
