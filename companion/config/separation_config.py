"""The [separation] table: the other vehicles of the room, and how far to stay from them."""

from pydantic import Field, model_validator

from companion.config.toml_files import Section
from companion.guard.separation import Separation
from companion.supervisor.separation import SeparationRules

ANY_HEIGHT_M = 100.0
"""Higher than any room: PX4's own landing goes straight down, also onto a vehicle below."""


class SeparationConfig(Section):
    """Vehicles that share the room, and the cylinder around each that no other may enter (docs/separation.md).

    Every vehicle's file has the same table.
    """

    order: tuple[str, ...] = Field(
        default=(),
        description="bodies of all vehicles in QTM, by priority: a later one yields to an earlier one; none: no rule",
    )
    radius_m: float = Field(1.2, ge=0.3, le=10.0, description="least horizontal distance between two origins, m")
    height_m: float = Field(
        ANY_HEIGHT_M,
        ge=0.3,
        le=ANY_HEIGHT_M,
        description="height difference from which on that distance does not count, m; 100: nobody flies above another",
    )
    parked_height_m: float = Field(
        ANY_HEIGHT_M,
        ge=0.3,
        le=ANY_HEIGHT_M,
        description="the same above a vehicle that stands on the ground; at most height_m counts, m",
    )
    parked_below_m: float = Field(
        0.35, ge=0.0, le=2.0, description="height in W below which a vehicle that does not move stands on the ground, m"
    )

    @model_validator(mode="after")
    def _names(self) -> "SeparationConfig":
        twice = sorted({name for name in self.order if self.order.count(name) > 1})
        if "" in self.order:
            raise ValueError("order has an empty name: give the name of each vehicle's body in QTM")
        if twice:
            raise ValueError(f"order has {twice[0]!r} twice: give each vehicle's body once")
        if len(self.order) == 1:
            raise ValueError("order names one vehicle: give the bodies of all, or leave it out")
        return self

    def others_than(self, body: str) -> tuple[str, ...]:
        """Return the bodies of the other vehicles, by priority; none if `order` is empty."""
        return tuple(name for name in self.order if name != body)

    def rules(self, body: str, braking_mps2: float, reaction_s: float) -> SeparationRules | None:
        """Return the rules for the vehicle with this body; None if `order` is empty."""
        if not self.order:
            return None
        cylinder = Separation(
            radius_m=self.radius_m,
            height_m=self.height_m,
            parked_height_m=min(self.parked_height_m, self.height_m),
            braking_mps2=braking_mps2,
            reaction_s=reaction_s,
        )
        return SeparationRules(cylinder=cylinder, first=frozenset(self.order[: self.order.index(body)]))
