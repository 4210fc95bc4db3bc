"""One fault and the time at which it is active: a strict model, checked against catalogue.py."""

import math
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from mock_autopilot.faults.catalogue import WAYS, Kind, Part, Phase, Way, ways_of


class Fault(BaseModel):
    """One fault and the time at which it is active. ValueError with one sentence if no such fault exists."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    part: Part = Field(description='What is wrong; or say = "..." instead of all keys.')
    kind: Kind = Field(description="How it is wrong.")
    how: str = Field("", description="Which way, where a kind has several.")
    at_s: float | None = Field(None, ge=0.0, le=1e5, description="When, from lift-off.")
    phase: Phase | None = Field(None, description="When: as soon as this is reached, and after_s later.")
    after_s: float = Field(0.0, ge=0.0, le=1e5, description="How long after the phase is reached.")
    for_s: float = Field(math.inf, gt=0.0, description="How long; without, for ever.")
    amount: float | None = Field(None, description="How much; without, the usual.")
    vehicle: int | None = Field(None, ge=1, description="Whose, in a fleet; without, the first one's.")

    @model_validator(mode="after")
    def _exists(self) -> Self:
        ways = ways_of(self.part, self.kind)
        if not ways:
            kinds = ", ".join(dict.fromkeys(way.kind for way in WAYS if way.part is self.part))
            raise ValueError(f"{self.part} cannot be {self.kind}; it can be {kinds}")
        if self.how not in [way.how for way in ways]:
            known = [f"({way.how})" if way.how else "nothing more" for way in ways]
            what = f'does not know "({self.how})"' if self.how else "must say which"
            raise ValueError(f"{self.part} {self.kind} {what}; possible: {', '.join(known)}")
        if self.at_s is not None and self.phase is not None:
            raise ValueError("it begins at a time or in a phase, not both")
        if self.after_s > 0.0 and self.phase is None:
            raise ValueError('"after" counts from a phase: on the ground, armed, in the air or landing')
        self._check_extent()
        return self

    def _check_extent(self) -> None:
        way = self.way
        if not way.lasts and math.isfinite(self.for_s):
            raise ValueError(f'{way.words} happens once: leave out "for"')
        if self.amount is None:
            return
        if way.amount is None:
            raise ValueError(f"{way.words} has no amount, so leave out {self.amount:g}")
        if not way.amount.least <= self.amount <= way.amount.most:
            unit = f" {way.amount.unit}" if way.amount.unit else ""
            raise ValueError(
                f"{way.words} goes from {way.amount.least:g} to {way.amount.most:g}{unit}, not {self.amount:g}"
            )

    @property
    def way(self) -> Way:
        """Return this fault's entry in `WAYS`."""
        return next(way for way in ways_of(self.part, self.kind) if way.how == self.how)

    @property
    def lasts_s(self) -> float:
        """Return the duration, s; 0 for a fault that happens once."""
        if self.way.lasts:
            return self.for_s
        return self.magnitude if self.way.amount is not None and self.way.amount.unit == "s" else 0.0

    @property
    def magnitude(self) -> float:
        """Return the amount given, or the default; 0 where the fault has no amount."""
        usual = self.way.amount.usual if self.way.amount is not None else 0.0
        return usual if self.amount is None else self.amount


def check_fits(fault: Fault, has_arms: bool, vehicles: int = 1) -> None:
    """Raise ValueError when there is no such vehicle, or it has no such part."""
    if (fault.vehicle or 1) > vehicles:
        there = f"are {vehicles} vehicles" if vehicles > 1 else "is one vehicle"
        raise ValueError(f"vehicle {fault.vehicle} cannot have a fault: there {there} (fleet.vehicles)")
    if fault.part is Part.SERVOS and not has_arms:
        raise ValueError("servos cannot fail on a vehicle without arms: set arms.enabled = true")
