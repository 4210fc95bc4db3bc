"""Observer of accelerations not caused by the rotors (a departure from the paper, off by default).

Motion capture measures the attitude, so the acceleration a of the rotors is known: v' = a + d with d unknown. A
Luenberger observer with both poles at -w estimates d: a constant d exactly, one that changes at d' with an error of
2 d'/w.
"""

import numpy as np

from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import all_by_axis, maximum, minimum

_LONGEST_S = 0.05
"""Longest gap in the frames that the correction counts: after a longer one it would overshoot."""


@value
class DisturbanceEstimate:
    """Observed velocity (m/s) and disturbance (m/s^2), (..., 3) in W; rotors' acceleration and age at the last step."""

    velocity: Array
    disturbance: Array
    accel: Array
    age_s: Scalar


def nothing_observed(velocity_w_mps: Array, age_s: Scalar) -> DisturbanceEstimate:
    """Return the estimate at lift-off: no disturbance."""
    nothing = np.zeros_like(velocity_w_mps)
    return DisturbanceEstimate(velocity_w_mps, nothing, nothing, age_s)


def observe(
    before: DisturbanceEstimate,
    velocity_w_mps: Array,
    accel_w_mps2: Array,
    age_s: Scalar,
    dt_s: float,
    poles_radps: Scalar,
) -> DisturbanceEstimate:
    """Advance by `dt_s` with a state as old as `age_s`; `accel_w_mps2` is the acceleration of the rotors at that time.

    Without a new frame the state is older by `dt_s` than before, and the estimate does not change.
    """
    elapsed_s = maximum(dt_s + before.age_s - age_s, 0.0)
    turn = poles_radps * minimum(elapsed_s, _LONGEST_S)
    share = minimum(2.0 * turn, 1.0)

    def corrected(
        measured: Scalar, velocity: Scalar, disturbance: Scalar, accel_before: Scalar, accel: Scalar
    ) -> tuple[Scalar, Scalar]:
        expected = velocity + elapsed_s * (0.5 * (accel_before + accel) + disturbance)
        innovation = measured - expected
        return expected + share * innovation, disturbance + poles_radps * turn * innovation

    velocity, disturbance = all_by_axis(
        corrected, velocity_w_mps, before.velocity, before.disturbance, before.accel, accel_w_mps2
    )
    return DisturbanceEstimate(velocity, disturbance, accel_w_mps2, age_s)
