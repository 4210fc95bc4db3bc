"""Settings of the motion-capture source; strict, so that a misspelt key is an error."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class MocapConfig(BaseModel):
    """Where QTM is, which body is ours, and how its frames travel."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    host: str = Field(default="127.0.0.1", min_length=1, description="Address of the computer that runs QTM.")
    port: int = Field(default=22223, gt=0, le=65535, description="QTM's TCP port for little endian (base port + 1).")
    body: str = Field(default="dauam", min_length=1, description="Name of the vehicle's rigid body in QTM.")
    transport: Literal["tcp", "udp"] = Field(default="tcp", description="How frames travel; commands always use TCP.")
    udp_port: int = Field(default=0, ge=0, le=65535, description="Local UDP port for frames; 0 takes any free one.")
    connect_timeout_s: float = Field(
        default=3.0, gt=0.0, le=60.0, description="Seconds QTM may take to accept, and to answer each question."
    )
    first_frame_timeout_s: float = Field(
        default=3.0,
        gt=0.0,
        le=60.0,
        description="Seconds from asking for the stream until the first frame must be here.",
    )
    delay_s: float = Field(
        default=0.010,
        ge=0.0,
        le=0.5,
        description="Known seconds from capture to arrival here; measure it once per room.",
    )
