"""Announcement of the way that a vehicle is about to fly, for the other vehicles of the room."""

from itertools import pairwise
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

MOST_KNOTS = 1000
"""Below the largest packet that a service reads."""


class Intent(BaseModel):
    """Way of a `goto` or `track` under way, retained; an empty message takes it back.

    Between knots the way is straight; after the last one the vehicle holds there. Readers ignore unknown fields.
    """

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)
    session: str = Field(max_length=64, description="run of the service that wrote it, as in its status")
    body: str = Field(max_length=256, description="name of the vehicle's body in motion capture")
    verb: str = Field(max_length=32, description="command that is carried out")
    from_s: float = Field(description="begin, Unix time; the knots count from it")
    knots: tuple[tuple[float, float, float, float], ...] = Field(
        min_length=1, max_length=MOST_KNOTS, description="t_s, x_m, y_m, z_m in W, in the order of time"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        times_s = [knot[0] for knot in self.knots]
        if any(later <= earlier for earlier, later in pairwise(times_s)):
            raise ValueError("the knots' times must increase")
        return self
