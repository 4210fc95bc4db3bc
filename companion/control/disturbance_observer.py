"""Observer of accelerations not caused by the rotors (a departure from the paper, off by default).

Motion capture measures the attitude, so the acceleration a of the rotors is known: v' = a + d with d unknown. A
Luenberger observer with two poles at -w estimates d: a constant d exactly, one that changes at d' with an error of
2 d'/w. A third pole at -r w, with a trend r above 0, estimates d' as well.
"""

import numpy as np

from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import maximum, minimum

_LONGEST_S = 0.05
"""Longest gap in the frames that the correction counts: after a longer one it would overshoot."""


@value
class Poles:
    """Poles of the observer: two at -radps, and a third at -trend radps; 0 takes the disturbance as constant."""

    radps: Scalar
    trend: Scalar = 0.0


@value
class DisturbanceEstimate:
    """Observed velocity (m/s), disturbance (m/s^2) and its rate (m/s^3), (..., 3) in W; the rotors' acceleration and
    the age at the last step."""

    velocity: Array
    disturbance: Array
    rate: Array
    accel: Array
    age_s: Scalar


def nothing_observed(velocity_w_mps: Array, age_s: Scalar) -> DisturbanceEstimate:
    """Return the estimate at lift-off: no disturbance."""
    nothing = np.zeros_like(velocity_w_mps)
    return DisturbanceEstimate(velocity_w_mps, nothing, nothing, nothing, age_s)


def observe(
    before: DisturbanceEstimate,
    velocity_w_mps: Array,
    accel_w_mps2: Array,
    age_s: Scalar,
    dt_s: float,
    poles: Poles,
) -> DisturbanceEstimate:
    """Advance by `dt_s` with a state as old as `age_s`; `accel_w_mps2` is the acceleration of the rotors at that time.

    Without a new frame the state is older by `dt_s` than before, and the estimate does not change.
    """
    elapsed_s = maximum(dt_s + before.age_s - age_s, 0.0)
    radps, trend = poles.radps, poles.trend
    turn = radps * minimum(elapsed_s, _LONGEST_S)
    share = minimum((2.0 + trend) * turn, 1.0)
    gain, rate_gain = (1.0 + 2.0 * trend) * radps * turn, trend * radps * radps * turn
    expected = before.velocity + elapsed_s * (0.5 * (before.accel + accel_w_mps2) + before.disturbance)
    innovation = velocity_w_mps - expected
    disturbance = before.disturbance + elapsed_s * before.rate + gain * innovation
    rate = before.rate + rate_gain * innovation
    return DisturbanceEstimate(expected + share * innovation, disturbance, rate, accel_w_mps2, age_s)
