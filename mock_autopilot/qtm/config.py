"""Settings of the mock Qualisys server; strict, so that a misspelt key is an error."""

from pydantic import BaseModel, ConfigDict, Field


class Interval(BaseModel):
    """An interval of simulated time, in seconds from its zero."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    start_s: float = Field(ge=0.0, description="When it begins, in the truth's time.")
    for_s: float = Field(gt=0.0, description="How long it lasts.")

    def contains(self, time_s: float) -> bool:
        """Return whether `time_s` is in the interval; its end is not."""
        return self.start_s <= time_s < self.start_s + self.for_s


class QualisysConfig(BaseModel):
    """The simulated capture system: its address, its bodies, its accuracy, its delay and its faults."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    host: str = Field(default="127.0.0.1", description="Address the server listens on.")
    port: int = Field(default=22223, ge=0, le=65535, description="TCP port, little endian; 0 takes any free one.")
    body: str = Field(default="dauam", min_length=1, description="Name of the rigid body that follows the truth.")
    extra_bodies: tuple[str, ...] = Field(
        default=(), description="Names of more rigid bodies, standing still on the floor."
    )
    newest_minor: int = Field(
        default=25, ge=8, le=25, description="Newest RT protocol it knows, 1.N: 25 is a QTM of mid-2024, 23 of 2021."
    )
    tells_changes: bool = Field(
        default=True, description="A changed list of bodies is told by an event, as QTM may do and does not promise."
    )
    rate_hz: float = Field(default=100.0, gt=0.0, le=500.0, description="Frames per second of the truth's time.")
    noise_m: float = Field(default=0.0003, ge=0.0, le=0.1, description="Standard deviation of the position, per axis.")
    noise_rad: float = Field(
        default=0.002, ge=0.0, le=0.5, description="Standard deviation of the attitude, per body axis."
    )
    residual_m: float = Field(default=0.0006, ge=0.0, le=0.1, description="Mean marker residual that is reported.")
    delay_s: float = Field(
        default=0.008, ge=0.0, le=1.0, description="From the capture until the frame leaves the server."
    )
    jitter_s: float = Field(
        default=0.0, ge=0.0, le=1.0, description="Largest addition to the delay, uniform per frame."
    )
    drop_probability: float = Field(default=0.0, ge=0.0, le=1.0, description="Chance that a single frame never leaves.")
    outages: tuple[Interval, ...] = Field(default=(), description="When the body is lost: frames come, with NaN.")
    silences: tuple[Interval, ...] = Field(default=(), description="When no frames come at all.")
