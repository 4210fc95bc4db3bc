"""Goals that cannot jump. Pure."""

import math
from collections.abc import Sequence


def next_goal(sent_rad: float, wanted_rad: float, max_velocity_radps: float, dt_s: float) -> float:
    """The goal to send now: from the one sent `dt_s` ago towards the wanted one, no faster than allowed."""
    step_rad = max_velocity_radps * max(dt_s, 0.0)
    return sent_rad + min(max(wanted_rad - sent_rad, -step_rad), step_rad)


def goal_velocity(steps: Sequence[tuple[float, float]]) -> float:
    """How fast goals move (rad/s) that lately went on by `steps`, each (s, rad), the newest last; 0 when they turned.

    Two clocks beat against each other, so that now and then a cycle finds no new goal and the next one finds two: one
    step says little. Of all steps and the last two the slower is taken, so that nobody stops farther on than need be.
    """
    newest, all_of_them = _mean_velocity(steps[-2:]), _mean_velocity(steps)
    if newest * all_of_them <= 0.0 or newest * steps[-1][1] < 0.0:
        return 0.0
    return min(newest, all_of_them, key=abs)


def _mean_velocity(steps: Sequence[tuple[float, float]]) -> float:
    took_s = math.fsum(dt_s for dt_s, _ in steps)
    return math.fsum(step_rad for _, step_rad in steps) / took_s if took_s > 0.0 else 0.0


def stopping_point(goal_rad: float, velocity_radps: float, max_accel_radps2: float) -> float:
    """Where a moving goal comes to rest when it brakes as hard as the joint may: v^2 / 2a further on."""
    return goal_rad + math.copysign(velocity_radps**2 / (2.0 * max_accel_radps2), velocity_radps)


def braking_velocity(left_rad: float, max_accel_radps2: float) -> float:
    """How fast (rad/s) a goal may still be that is to rest `left_rad` further on: v = sqrt(2 a s)."""
    return math.sqrt(2.0 * max_accel_radps2 * abs(left_rad))
