"""The autopilot's parameters against a recommended list."""

import math
from collections.abc import Iterable, Mapping

from companion.config.recommended_parameter import Recommended
from companion.preflight.checks.check import Check


def check_parameters(wanted: Iterable[Recommended], found: Mapping[str, float]) -> tuple[Check, ...]:
    """Return one check a parameter; one that the autopilot did not tell fails, unless it need not have it.

    An autopilot that tells none at all is not heard rather than without parameters.
    """
    return tuple(_check(one, found.get(one.name, math.nan), heard=bool(found)) for one in wanted)


def _check(one: Recommended, value: float, heard: bool) -> Check:
    if math.isnan(value) and one.optional and heard:
        return Check(one.name, True, "this PX4 does not have it", "", one.must)
    if math.isnan(value):
        todo = f"is this PX4 older than v1.15, or the link bad? It should be {one.wanted}: {one.why}"
        return Check(one.name, False, "the autopilot does not tell it", todo, one.must)
    todo = f"set it to {one.set_to:g}{' and reboot PX4' if one.reboot else ''}: {one.why}"
    return Check(one.name, one.accepts(value), f"is {value:g}, should be {one.wanted}", todo, one.must)
