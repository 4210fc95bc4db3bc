"""Correction of the autopilot's horizon by motion capture's. Pure; one vehicle, or a batch over leading axes.

PX4 holds the commanded attitude relative to its own horizon, which drifts by a degree or so: that accelerates the
vehicle by g times the error. Motion capture measures the true attitude. The tilt between the two, with equal headings
and at the same instant, passes a first-order low pass; its inverse goes into the setpoint, bounded in size and in rate.
It is kept in the vehicle's levelled axes (x forward, y left), in which an accelerometer's bias stands still while the
vehicle turns.

Motion capture may be wrong, too. So nothing is corrected while the two disagree by more than `apart_rad`, and for a
while after that; a correction that ends fades at the same bounded rate.
"""

import math
from dataclasses import dataclass

import numpy as np

from companion.core.types import Array, AttitudeThrust, Flag, Scalar
from companion.core.values import value
from companion.geometry.array_math import absolute, column, item, math_module, maximum, minimum, stack, unstack, where
from companion.geometry.frames import quat_conjugate, quat_from_rotation_vector, quat_multiply, yaw_of

TIME_CONSTANT_S = 0.3
"""Default; errors of PX4 last for 2.5 to 20 s, and the law needs 0.2 s to follow a setpoint. See docs/horizon.md."""
CAP_RAD = 0.0873
"""Default, 5 degrees: PX4 v1.17 in flight was off by up to 0.083 rad."""
SOUND_S = 0.5
"""Time for which the two horizons must agree before the correction begins: many times the length of an outlier."""
HELD_S = 0.25
"""Longest time without a comparison for which the correction stays; PX4 lands after as long without motion capture."""
_LARGEST_TURN_S = 0.06
"""Longest time over which an attitude is extrapolated by body rates: an error of 10 rad/s^2 gives 0.02 rad."""
_TINY = 1e-12


@dataclass(frozen=True, kw_only=True)
class HorizonRules:
    """Settings, for all vehicles or one per vehicle of a batch (...,); from the configuration's [control] table."""

    enabled: bool = True
    """False: the difference is measured and recorded, but not corrected."""
    time_constant_s: Scalar = TIME_CONSTANT_S
    """Time constant of the low pass."""
    cap_rad: Scalar = CAP_RAD
    """Largest correction."""
    apart_rad: Scalar = 0.125
    """Difference above which neither horizon is trusted: half the limit of the fault *attitudes disagree*."""
    rate_radps: Scalar = 0.15
    """Largest rate of change of the correction: twice the largest rate of recorded errors."""
    resend_rad: Scalar = 0.02
    """Change of the correction that is sent without a new setpoint of the law: 0.2 m/s^2."""


@value(kw_only=True)
class HorizonInput:
    """Attitudes of both sources in one cycle, (..., 4); ages and flags are single, or (...,)."""

    q_w_flu_wxyz: Array
    """Attitude from motion capture."""
    rate_flu_radps: Array
    age_s: Scalar
    autopilot_q_w_flu_wxyz: Array
    autopilot_age_s: Scalar
    """Age of the autopilot's attitude; infinite before the first."""
    trusted: Flag
    """True if there is no fault of motion capture and no lasting disagreement."""
    flying: Flag
    """True while the law flies; on the ground the horizons are compared, but not corrected."""


@value
class Horizon:
    """State of the correction: x (roll) and y (pitch) in the vehicle's levelled axes, rad; each a float or (...,)."""

    off_x: Scalar = 0.0
    """Low-passed difference: true attitude less the autopilot's."""
    off_y: Scalar = 0.0
    x: Scalar = 0.0
    """Correction: a setpoint is turned back by it."""
    y: Scalar = 0.0
    unseen_s: Scalar = math.inf
    """Time since the last comparison."""
    sound_s: Scalar = 0.0
    """Time for which both have agreed."""

    @property
    def off_rad(self) -> Scalar:
        """Size of the low-passed difference (rad)."""
        return _size(self.off_x, self.off_y)


def no_horizon(lead: tuple[int, ...] = ()) -> Horizon:
    """Return the initial state, for one vehicle or a batch of this shape."""
    if not lead:
        return Horizon()
    zero = np.zeros(lead)
    return Horizon(zero, zero, zero, zero, np.full(lead, math.inf), zero)


def tilt_between(inputs: HorizonInput) -> tuple[Scalar, Scalar]:
    """Return the tilt of the true attitude against the autopilot's (x, y; rad) at the instant of the latter.

    The turn from one attitude to the other is split into one about the vertical, the headings' difference, and the
    remaining one about a horizontal axis.
    """
    ahead_s = minimum(maximum(inputs.age_s - inputs.autopilot_age_s, -_LARGEST_TURN_S), _LARGEST_TURN_S)
    turn = quat_from_rotation_vector(np.asarray(inputs.rate_flu_radps * column(ahead_s)))
    then = quat_multiply(inputs.q_w_flu_wxyz, turn)
    w, x, y, z = unstack(quat_multiply(then, quat_conjugate(inputs.autopilot_q_w_flu_wxyz)))
    m = math_module(w)
    upright = maximum(m.sqrt(w * w + z * z), _TINY)
    lean = maximum(m.sqrt(x * x + y * y), _TINY)
    share = 2.0 * m.atan2(lean, upright) / (lean * upright)
    return _turned(share * (x * w - y * z), share * (y * w + x * z), yaw_of(then), -1.0)


def step(before: Horizon, inputs: HorizonInput, rules: HorizonRules, dt_s: float) -> Horizon:
    """Update the correction with the attitudes of one cycle, `dt_s` after the last."""
    x, y = tilt_between(inputs)
    tilt_rad = _size(x, y)
    apart_s = absolute(inputs.age_s - inputs.autopilot_age_s)
    known = (apart_s <= _LARGEST_TURN_S) & math_module(tilt_rad).isfinite(tilt_rad)
    left = where(before.unseen_s > HELD_S, 0.0, _left(rules.time_constant_s, dt_s))
    off_x = where(known, x + left * (before.off_x - x), before.off_x)
    off_y = where(known, y + left * (before.off_y - y), before.off_y)
    unseen_s = where(known, 0.0, before.unseen_s + dt_s)
    doubtful = (known & (tilt_rad > rules.apart_rad)) | (inputs.trusted ^ True)
    sound_s = where(doubtful, 0.0, before.sound_s + dt_s)
    used = (sound_s >= SOUND_S) & (unseen_s <= HELD_S) & inputs.flying & rules.enabled
    share = where(used, _share(_size(off_x, off_y), rules.cap_rad), 0.0)
    to_x, to_y = share * off_x - before.x, share * off_y - before.y
    part = _share(_size(to_x, to_y), rules.rate_radps * dt_s)
    return Horizon(off_x, off_y, before.x + part * to_x, before.y + part * to_y, unseen_s, sound_s)


def correction_of(horizon: Horizon, q_w_flu_wxyz: Array) -> Array:
    """Return the turn in W, (..., 4), with which a setpoint for a vehicle at this attitude is multiplied from left."""
    x, y = _turned(horizon.x, horizon.y, yaw_of(q_w_flu_wxyz), 1.0)
    return quat_from_rotation_vector(stack(-x, -y, 0.0 * x))


def corrected(setpoint: AttitudeThrust, turn_w: Array) -> AttitudeThrust:
    """Return the setpoint by which the autopilot, going by its own horizon, gives the vehicle `setpoint`'s attitude."""
    return AttitudeThrust(quat_multiply(turn_w, setpoint.q_w_flu_wxyz), setpoint.thrust)


def is_worth_sending(horizon: Horizon, held: Horizon, rules: HorizonRules) -> Flag:
    """Return where the correction differs so much from the one in the last setpoint that it is sent by itself."""
    return _size(horizon.x - held.x, horizon.y - held.y) > rules.resend_rad


def _turned(x: Scalar, y: Scalar, yaw_rad: Array, sign: float) -> tuple[Scalar, Scalar]:
    """Turn horizontal components by the heading: with +1 into W, with -1 into the levelled axes."""
    yaw = item(yaw_rad)
    m = math_module(yaw)
    c, s = m.cos(yaw), sign * m.sin(yaw)
    return c * x - s * y, s * x + c * y


def _size(x: Scalar, y: Scalar) -> Scalar:
    return math_module(x).sqrt(x * x + y * y)


def _left(time_constant_s: Scalar, dt_s: float) -> Scalar:
    """Return the share of its old value that a low pass keeps in a step."""
    return math_module(time_constant_s).exp(-dt_s / time_constant_s)


def _share(size: Scalar, most: Scalar) -> Scalar:
    """Return the factor that limits a vector of this size to `most`."""
    return minimum(1.0, most / maximum(size, _TINY))
