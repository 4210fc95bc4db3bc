"""The autopilot's parameters against a recommended list."""

import math
from collections.abc import Mapping

from companion.config.preflight_config import Recommended
from companion.preflight.checks.check import Check


def check_parameters(wanted: Mapping[str, Recommended], found: Mapping[str, float]) -> tuple[Check, ...]:
    """Return one check for each parameter; one that the autopilot did not send fails, unless it is optional.

    An autopilot that sends none at all counts as not heard, not as one without these parameters.
    """
    return tuple(_check(name, row, found.get(name, math.nan), heard=bool(found)) for name, row in wanted.items())


def _check(name: str, row: Recommended, value: float, heard: bool) -> Check:
    if math.isnan(value) and row.optional and heard:
        return Check(name, True, "this PX4 does not have it", "", row.must)
    if math.isnan(value):
        todo = f"is this PX4 older than v1.15, or the link bad? It should be {row.wanted}: {row.why}"
        return Check(name, False, "the autopilot does not tell it", todo, row.must)
    todo = f"set it to {row.set_to:g}{' and reboot PX4' if row.reboot else ''}: {row.why}"
    return Check(name, row.accepts(value), f"is {value:g}, should be {row.wanted}", todo, row.must)
