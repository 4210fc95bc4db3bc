"""Goals that cannot jump. Pure."""

import math


def next_goal(sent_rad: float, wanted_rad: float, max_velocity_radps: float, dt_s: float) -> float:
    """The goal to send now: from the one sent `dt_s` ago towards the wanted one, no faster than allowed."""
    step_rad = max_velocity_radps * max(dt_s, 0.0)
    return sent_rad + min(max(wanted_rad - sent_rad, -step_rad), step_rad)


def stopping_point(position_rad: float, velocity_radps: float, max_accel_radps2: float) -> float:
    """Where a moving joint comes to rest when it brakes as hard as it may: v^2 / 2a further on."""
    return position_rad + math.copysign(velocity_radps**2 / (2.0 * max_accel_radps2), velocity_radps)
