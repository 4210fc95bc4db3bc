"""Motion capture over MQTT: what the room's workstation forwards of QTM, as in the paper's network."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

_Number = Annotated[float, Field(ge=-1e39, le=1e39)]
"""QTM's are of single precision."""
Vector = tuple[_Number, _Number, _Number]
Rotation = tuple[_Number, _Number, _Number, _Number, _Number, _Number, _Number, _Number, _Number]
_Count = Annotated[int, Field(ge=0, lt=2**32)]


class MocapPose(BaseModel):
    """One body in one frame, and nothing of the way it went."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)

    body: Annotated[str, Field(min_length=1, max_length=256)]
    """QTM's name of the body, as the bridge's configuration has it: a service takes no other than its own."""
    frame: _Count
    """QTM's number."""
    stamp_s: Annotated[float, Field(ge=-1e13, le=1e13)]
    """Capture time on QTM's own clock, as the service would have had it from QTM."""
    position_w_m: Vector | None
    """None while the body is not tracked."""
    rotation_w_b: Rotation | None
    """Body FLU into W, row by row; None while the body is not tracked."""
    velocity_w_mps: Vector | None
    """By the workstation's own filter, for other readers; the service estimates its own."""
    residual_m: _Number | None
    late: _Count = 0
    """Frames of the bridge's connection that came too late for it."""


class BridgePresence(BaseModel):
    """The mocap bridge: retained, said again and again, and its last will."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)

    online: bool
    session: Annotated[str, Field(max_length=64)] = ""
    """New for every run."""
    host: Annotated[str, Field(max_length=256)] = ""
    """The workstation's name."""
    since_s: float = 0.0
    """Unix time by the workstation."""
    trouble: Annotated[str, Field(max_length=1000)] = ""
    """Why there are no frames; empty when there is no reason known."""
