"""Description of a vehicle that its service publishes once: what an operator's page draws and offers."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

Range = tuple[float, float]


class _Part(BaseModel):
    """Base of the description: readers ignore unknown fields, so that a newer service may add some."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)


class AboutFence(_Part):
    """Bounds that the vehicle's origin must never leave, in W."""

    x_m: Range
    y_m: Range
    top_m: float


class AboutRoom(_Part):
    """Bounds of trajectories, in W."""

    x_m: Range
    y_m: Range
    z_m: Range


class About(_Part):
    """Description of a vehicle, retained; valid for the run of the service with this session."""

    session: str = Field(max_length=64, description="run of the service that wrote it, as in its status")
    vehicle: str = Field("", max_length=64)
    body: str = Field("", max_length=256, description="name of the vehicle's body in motion capture")
    version: str = Field("", max_length=64, description="version of the service")
    fence: AboutFence
    room: AboutRoom
    takeoff_height_m: float = Field(description="height of a takeoff that names none, above the ground")
    footprint_m: float = Field(description="distance from the body's axis to the propellers' outer edge")
    controllers: tuple[str, ...] = Field((), description="names that `controller` knows; empty for a law on the ground")
    motions: tuple[str, ...] = Field((), description="motions that `track` and `arms play` accept; empty without arms")
    curves: tuple[str, ...] = Field((), description="curves that `track` accepts")
    arms: dict[str, Any] | None = Field(None, description="the [arms] table of the configuration; null without arms")
    separation_order: tuple[str, ...] = Field(
        (), description="bodies of all vehicles in the room by priority, the first goes first; empty without separation"
    )
