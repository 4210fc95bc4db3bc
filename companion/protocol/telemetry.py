"""What the service says; docs/bus/*.schema.json are printed from these models.

Times are Unix seconds by the service's clock; vectors are in W, metres; angles in radians.
"""

from enum import StrEnum
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]


class _Said(BaseModel):
    """Readers ignore what they do not know, so that a newer service may say more."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)


class Answer(StrEnum):
    """What a reply says."""

    ACCEPTED = "accepted"
    """It fits, and has begun."""
    PROGRESS = "progress"
    """Where it is now."""
    DONE = "done"
    """What was commanded has happened."""
    REFUSED = "refused"
    """It was not begun and has changed nothing."""
    FAILED = "failed"
    """It was begun, and ended otherwise."""


ENDS = frozenset({Answer.DONE, Answer.REFUSED, Answer.FAILED})
"""Nothing follows."""


class Reply(_Said):
    """To whoever sent a command: refused; or accepted, perhaps progress, and then done or failed."""

    id: str = Field(description="the command's; empty when it could not be read")
    answer: Answer
    time_s: float
    text: str = Field("", description="a sentence: the reason, or what was done")
    session: str = Field("", description="of the run of the service that says it; not on event")
    data: dict[str, Any] = Field(default_factory=dict, description="what was asked for: checks, parameters")


class Presence(_Said):
    """Retained: whether the service is there. The last will says that it is not."""

    online: bool
    session: str = Field("", max_length=64, description="of this run of the service, 16 hex digits; commands repeat it")
    vehicle: str = ""
    host: str = Field("", max_length=256, description="name of the computer that the service runs on")
    version: str = Field("", description="of the service")
    since_s: float = 0.0


class Kind(StrEnum):
    """What an event is of."""

    PHASE = "phase"
    FAULT = "fault"
    FAULT_ENDS = "fault ends"
    COMMAND = "command"
    REPLY = "reply"
    LOG = "log"


class Happened(_Said):
    """Something worth telling at once."""

    time_s: float
    kind: Kind
    text: str = Field(description="a sentence for the operator")
    name: str = Field("", description="phase, fault or verb; of a reply that names nobody, what it answers")
    reaction: str = Field("", description="what a fault leads to")
    id: str = Field("", description="the command's, where it is of one")


class Doing(_Said):
    """The command that is being carried out."""

    id: str
    verb: str
    text: str = ""


WAITING = "waiting"
"""A state's phase while the service has no vehicle."""


class State(_Said):
    """Ten times a second."""

    time_s: float
    session: str
    phase: str = Field(description="as in docs/safety.md; or waiting, while the service has no vehicle")
    reason: str = Field("", description="why the flight was ended or handed over, or what is waited for")
    armed: bool = False
    in_air: bool | None = Field(None, description="null: not known")
    mode: str = ""
    battery: float | None = Field(None, description="share of its charge")
    battery_v: float | None = None
    position_w_m: Vector | None = None
    velocity_w_mps: Vector | None = None
    yaw_rad: float | None = None
    tilt_rad: float | None = None
    age_s: float | None = Field(None, description="of the pose")
    reference_w_m: Vector | None = None
    error_m: float | None = Field(None, description="distance to the reference")
    thrust: float | None = Field(None, description="of the setpoint that was wanted last, 0..1")
    controller: str = ""
    sent_share: float | None = Field(None, description="share of the last second's cycles that sent a new setpoint")
    faults: tuple[str, ...] = Field((), description="what is wrong now, in the words of docs/safety.md")
    arms: str | None = Field(None, description="phase of the arms; null without arms")
    joints_rad: tuple[float | None, ...] | None = None
    doing: Doing | None = None
    late_s: float | None = Field(None, description="how late the control cycle began")
    text: str = Field("", description="the autopilot's newest words")
    text_age_s: float | None = Field(None, description="since the autopilot said them")
    warnings: tuple[str, ...] = Field(
        (), description="what is wrong beside the vehicle: the flight is not recorded, another service has its name"
    )
