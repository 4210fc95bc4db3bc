"""What pushes the vehicle besides its rotors, observed from its motion (a departure from the paper, off by default).

Motion capture tells the attitude, so what the rotors give the vehicle is known: v' = a + d with a known and d wanted. A
Luenberger observer with both poles at -w finds d: steady pushes exactly, a push that changes at d' late by 2 d'/w.
"""

from typing import Any

import numpy as np

from companion.control.switching import Scalar
from companion.core.types import Array
from companion.core.values import value
from companion.geometry.array_math import all_by_axis, maximum, minimum

_LONGEST_S = 0.05
"""After a longer gap in the frames the observer corrects no harder than after this one: it would overshoot."""


@value
class DisturbanceEstimate:
    """Velocity (m/s) and push (m/s^2) as observed, (..., 3) in W; the rotors' part and the age at the last look."""

    velocity: Array
    push: Array
    accel: Array
    age_s: Scalar


def nothing_observed(velocity_w_mps: Array, age_s: Scalar) -> DisturbanceEstimate:
    """At lift-off: no push."""
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
    """Take one look `dt_s` after the last, at a state as old as `age_s`; `accel_w_mps2` is what the rotors gave then.

    Without a new frame the state is older by `dt_s` than before, and nothing is learnt.
    """
    elapsed_s = maximum(dt_s + before.age_s - age_s, 0.0)
    turn = poles_radps * minimum(elapsed_s, _LONGEST_S)
    share = minimum(2.0 * turn, 1.0)

    def seen(measured: Any, velocity: Any, push: Any, accel_before: Any, accel: Any) -> Any:
        expected = velocity + elapsed_s * (0.5 * (accel_before + accel) + push)
        surprise = measured - expected
        return expected + share * surprise, push + poles_radps * turn * surprise

    velocity, push = all_by_axis(seen, velocity_w_mps, before.velocity, before.push, before.accel, accel_w_mps2)
    return DisturbanceEstimate(velocity, push, accel_w_mps2, age_s)
