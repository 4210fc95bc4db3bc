"""Messages of motion capture over MQTT: QTM's frames as the room's workstation forwards them in the paper's network."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

_Number = Annotated[float, Field(ge=-1e39, le=1e39)]
"""Number within the range of QTM's single precision."""
Vector = tuple[_Number, _Number, _Number]
Rotation = tuple[_Number, _Number, _Number, _Number, _Number, _Number, _Number, _Number, _Number]
_Count = Annotated[int, Field(ge=0, lt=2**32)]


class MocapPose(BaseModel):
    """Pose of one body in one frame, independent of the transport."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)

    body: Annotated[str, Field(min_length=1, max_length=256)]
    """Name of the body in QTM and in the bridge's configuration; a service ignores every other body."""
    frame: _Count
    """Frame number, counted by QTM."""
    stamp_s: Annotated[float, Field(ge=-1e13, le=1e13)]
    """Capture time on QTM's own clock, as QTM itself would send it to the service."""
    position_w_m: Vector | None
    """None while the body is not tracked."""
    rotation_w_b: Rotation | None
    """Body FLU into W, row by row; None while the body is not tracked."""
    velocity_w_mps: Vector | None
    """Velocity from the workstation's filter, for other readers; the service computes its own estimate."""
    residual_m: _Number | None
    late: _Count = 0
    """Frames of the bridge's connection dropped because they arrived late."""


class BridgePresence(BaseModel):
    """Presence of the mocap bridge: retained, repeated periodically, and its last will."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)

    online: bool
    session: Annotated[str, Field(max_length=64)] = ""
    """Identifier of one run of the bridge."""
    host: Annotated[str, Field(max_length=256)] = ""
    """Host name of the workstation."""
    since_s: float = 0.0
    """Unix time at which the run began, by the workstation's clock."""
    trouble: Annotated[str, Field(max_length=1000)] = ""
    """Reason why there are no frames; empty when none is known."""
