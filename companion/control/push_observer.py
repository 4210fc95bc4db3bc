"""What pushes the vehicle besides its rotors, observed from its motion (a departure from the paper, off by default).

Motion capture tells the attitude, so what the rotors give the vehicle is known: v' = a + d with a known and d wanted. A
Luenberger observer with both poles at -w finds d: steady pushes exactly, a push that changes at d' late by 2 d'/w.
"""

from typing import Any

import numpy as np

from companion.control.components import all_by_axis, at_least, at_most
from companion.control.switching import Scalar
from companion.control.values import value
from companion.types import Array

_LONGEST_S = 0.05
"""After a longer gap in the frames the observer corrects no harder than after this one: it would overshoot."""


@value
class Observed:
    """Velocity (m/s) and push (m/s^2) as observed, (..., 3) in W; the rotors' part and the age at the last look."""

    velocity: Array
    push: Array
    accel: Array
    age_s: Scalar


def nothing_observed(velocity_w_mps: Array, age_s: Scalar) -> Observed:
    """At lift-off: no push."""
    nothing = np.zeros_like(velocity_w_mps)
    return Observed(velocity_w_mps, nothing, nothing, age_s)


def observe(
    before: Observed, velocity_w_mps: Array, accel_w_mps2: Array, age_s: Scalar, dt_s: float, poles_radps: Scalar
) -> Observed:
    """Take one look `dt_s` after the last, at a state as old as `age_s`; `accel_w_mps2` is what the rotors gave then.

    Without a new frame the state is older by `dt_s` than before, and nothing is learnt.
    """
    elapsed_s = at_least(dt_s + before.age_s - age_s, 0.0)
    turn = poles_radps * at_most(elapsed_s, _LONGEST_S)
    share = at_most(2.0 * turn, 1.0)

    def seen(measured: Any, velocity: Any, push: Any, accel_before: Any, accel: Any) -> Any:
        expected = velocity + elapsed_s * (0.5 * (accel_before + accel) + push)
        surprise = measured - expected
        return expected + share * surprise, push + poles_radps * turn * surprise

    velocity, push = all_by_axis(seen, velocity_w_mps, before.velocity, before.push, before.accel, accel_w_mps2)
    return Observed(velocity, push, accel_w_mps2, age_s)
