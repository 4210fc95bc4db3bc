"""Motion capture over MQTT: what the room's workstation forwards of QTM, as in the paper's network."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]
Rotation = tuple[float, float, float, float, float, float, float, float, float]


class MocapPose(BaseModel):
    """One body in one frame, and nothing of the way it went."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)

    frame: Annotated[int, Field(ge=0)]
    """QTM's number."""
    stamp_s: float
    """Capture time on QTM's own clock, as the service would have had it from QTM."""
    position_w_m: Vector | None
    """None while the body is not tracked."""
    rotation_w_b: Rotation | None
    """Body FLU into W, row by row; None while the body is not tracked."""
    velocity_w_mps: Vector | None
    """By the workstation's own filter, for other readers; the service estimates its own."""
    residual_m: float | None
    late: Annotated[int, Field(ge=0)] = 0
    """Frames of the bridge's connection that came too late for it."""
