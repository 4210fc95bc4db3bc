"""Braking in one dimension: towards a face of the fence, or towards another vehicle. Pure, floats."""

import math

_LEAST_S = 0.01
"""Least duration of half the reaction time: a control cycle."""


def lead_s(reaction_s: float) -> float:
    """Return half the reaction time, for which one acceleration acts, at least a control cycle."""
    return max(0.5 * reaction_s, _LEAST_S)


def most_accel_mps2(left_m: float, speed_mps: float, for_s: float, braking_mps2: float) -> float:
    """Return the largest acceleration for `for_s` towards a face `left_m` away that still lets a vehicle stop there.

    With u the speed after it: left = (v + u) t / 2 + u^2 / 2a. Beyond the face u points inwards and grows with the
    distance, up to a speed from which the vehicle can stop again. It is continuous: a jump would cause chattering
    at the face.
    """
    at = braking_mps2 * for_s
    root = at * at - 4.0 * braking_mps2 * (speed_mps * for_s - 2.0 * left_m)
    end_mps = 0.5 * (math.copysign(math.sqrt(abs(root)), root) - at)
    return (end_mps - speed_mps) / for_s
