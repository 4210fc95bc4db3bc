"""Incidents of the flights of one seed: which vehicle fails, when, and how. Drawn from the seed."""

import random
from dataclasses import dataclass
from enum import StrEnum


class Trouble(StrEnum):
    """Ways in which one vehicle stops doing as it is told, or as the others expect."""

    LANDS = "lands"
    """Its operator lands it where it is, and leaves it there for a while."""
    FREEZES = "freezes"
    """Its service stops for good; PX4 lands it, and there it stays."""
    SILENT = "falls silent"
    """The link between its service and its autopilot is gone for a while; PX4 lands it."""
    BODY_LOST = "loses its body"
    """Motion capture loses it for a while: neither its own service nor the others see it."""


REST_S = 25.0
"""Time that a vehicle which was told to land stays down."""
SILENT_S = 12.0
LOST_S = 6.0


@dataclass(frozen=True)
class Incident:
    """One trouble of one vehicle (0 is the first)."""

    at_s: float
    vehicle: int
    trouble: Trouble


def incidents_of(seed: int, vehicles: int, for_s: float) -> list[Incident]:
    """Return the incidents of a seed: one a minute, of the troubles that pass; in the last third one may freeze.

    At least 20 s lie between two, and none is in the first 20 s or the last 15 s.
    """
    rng = random.Random(f"incidents {seed}")
    passing = [Trouble.LANDS, Trouble.SILENT, Trouble.BODY_LOST]
    incidents = []
    for begin_s in range(20, round(for_s - 15.0), 60):
        at_s = begin_s + rng.uniform(0.0, max(min(40.0, for_s - 15.0 - begin_s), 0.0))
        late = at_s > for_s * 2.0 / 3.0
        trouble = rng.choice([*passing, Trouble.FREEZES] if late else passing)
        incidents.append(Incident(at_s, rng.randrange(vehicles), trouble))
        if trouble is Trouble.FREEZES:
            break
    return incidents
