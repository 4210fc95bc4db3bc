"""Rate limiter for joint goals. Pure."""

import math
from collections.abc import Sequence


def next_goal(sent_rad: float, wanted_rad: float, max_velocity_radps: float, dt_s: float) -> float:
    """Return the next goal, rad: the last one moved towards the wanted one, no faster than the limit."""
    step_rad = max_velocity_radps * max(dt_s, 0.0)
    return sent_rad + min(max(wanted_rad - sent_rad, -step_rad), step_rad)


def goal_velocity(steps: Sequence[tuple[float, float]]) -> float:
    """Return the velocity, rad/s, of goals whose last `steps` were (s, rad), newest last; 0 after a reversal.

    Two clocks beat against each other, so that now and then a cycle finds no new goal and the next one finds two: one
    step says little. Of all steps and the last two the slower is taken, so that no stop is longer than needed.
    """
    newest, all_of_them = _mean_velocity(steps[-2:]), _mean_velocity(steps)
    if newest * all_of_them <= 0.0 or newest * steps[-1][1] < 0.0:
        return 0.0
    return min(newest, all_of_them, key=abs)


def _mean_velocity(steps: Sequence[tuple[float, float]]) -> float:
    took_s = math.fsum(dt_s for dt_s, _ in steps)
    return math.fsum(step_rad for _, step_rad in steps) / took_s if took_s > 0.0 else 0.0


def stopping_point(goal_rad: float, velocity_radps: float, max_accel_radps2: float) -> float:
    """Return the angle, rad, at which a moving goal stops with maximum deceleration, v^2 / 2a ahead."""
    return goal_rad + math.copysign(velocity_radps**2 / (2.0 * max_accel_radps2), velocity_radps)


def braking_velocity(left_rad: float, max_accel_radps2: float) -> float:
    """Return the highest speed, rad/s, from which a goal stops within `left_rad`: v = sqrt(2 a s)."""
    return math.sqrt(2.0 * max_accel_radps2 * abs(left_rad))
