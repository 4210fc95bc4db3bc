"""Limits of a path through waypoints, in a CSV file or in a command; imports nothing heavy."""

import math
from itertools import pairwise

MAX_WAYPOINTS = 400
"""The spline is solved in one go, which takes about a second for this many; a smooth path needs far fewer."""
LEAST_GAP_S = 0.01
"""Least time between two waypoints: a control cycle."""
LONGEST_S = 3600.0
MAX_YAW_RAD = 6.3
"""One turn: a larger heading is probably in degrees, or counts turns that the short way round does not make."""


def time_mistake(times_s: list[float], longest_s: float) -> tuple[int, str] | None:
    """Return the first waypoint whose time (s) cannot be flown, and why; None when all can."""
    if not times_s or times_s[0] != 0.0:
        return 0, f"t_s must begin at 0, not {times_s[0] if times_s else math.nan:g}"
    for number, (before_s, after_s) in enumerate(pairwise(times_s), start=1):
        if after_s <= before_s:
            return number, f"t_s must rise, {after_s:g} does not follow {before_s:g}"
        if after_s - before_s < LEAST_GAP_S - 1e-9:
            return number, f"t_s must rise by at least {LEAST_GAP_S:g} s, {after_s:g} follows {before_s:g}"
        if after_s > longest_s:
            return number, f"t_s must be at most {longest_s:g} s, not {after_s:g}"
    return None
