"""Messages that the service publishes; docs/bus/*.schema.json are generated from these models.

Times are Unix seconds by the service's clock; vectors are in W, metres; angles in radians.
"""

from enum import StrEnum
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]


class _Said(BaseModel):
    """Base of all published messages: readers ignore unknown fields, so that a newer service may add some."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, allow_inf_nan=False)


class Answer(StrEnum):
    """Kind of a reply to a command."""

    ACCEPTED = "accepted"
    """The command is valid and has begun."""
    PROGRESS = "progress"
    """An intermediate state of the command."""
    DONE = "done"
    """The command is complete."""
    REFUSED = "refused"
    """The command was rejected and has changed nothing."""
    FAILED = "failed"
    """The command was begun, but not completed."""


ENDS = frozenset({Answer.DONE, Answer.REFUSED, Answer.FAILED})
"""Replies after which no other follows."""


class Reply(_Said):
    """Reply to the sender of a command: refused; or accepted, optionally progress, and then done or failed."""

    id: str = Field(description="ID of the command; empty when it could not be read")
    answer: Answer
    time_s: float
    text: str = Field("", description="a sentence: the reason, or what was done")
    session: str = Field("", description="session of the service that replies; not on event")
    data: dict[str, Any] = Field(default_factory=dict, description="requested data: checks, parameters")

    def sentence(self, what: str) -> str:
        """Return what came of a command, as in "takeoff rejected: the vehicle is disarmed"."""
        answer = "rejected" if self.answer is Answer.REFUSED else self.answer
        return f"{what} {answer}{': ' if self.text else ''}{self.text}"


class Presence(_Said):
    """Presence of the service, retained; the last will says that it is offline."""

    online: bool
    session: str = Field(
        "", max_length=64, description="identifies this run of the service, 16 hex digits; commands repeat it"
    )
    vehicle: str = ""
    body: str = Field("", max_length=256, description="name of the vehicle's body in motion capture")
    host: str = Field("", max_length=256, description="name of the computer that the service runs on")
    version: str = Field("", description="version of the service")
    since_s: float = 0.0


class Kind(StrEnum):
    """Kind of an event that is published."""

    PHASE = "phase"
    FAULT = "fault"
    FAULT_ENDS = "fault ends"
    COMMAND = "command"
    REPLY = "reply"
    LOG = "log"


class Happened(_Said):
    """Event that is published at once."""

    time_s: float
    kind: Kind
    text: str = Field(description="a sentence for the operator")
    name: str = Field("", description="phase, fault or verb; kind of answer for a reply to a command without a client")
    reaction: str = Field("", description="failsafe action of a fault")
    id: str = Field("", description="ID of the command that the event belongs to")


class Doing(_Said):
    """Command that is being executed."""

    id: str
    verb: str
    text: str = ""


class LawLink(_Said):
    """Link to a law on the ground, over its last second (docs/split.md)."""

    connected: bool = Field(description="a ground law has this vehicle")
    host: str = Field("", description="computer and process of the ground law")
    session: str = Field("", description="number of its session, hexadecimal")
    command: int = Field(0, description="number of the command in use; 0 without one")
    silence_s: float | None = Field(
        None, description="time since its newest message with a fresh pose was sent; null before the first"
    )
    age_s: float | None = Field(
        None, description="median age of its messages at their arrival; null until the clocks were compared"
    )
    round_trip_s: float | None = Field(None, description="quickest round trip; null until it is known")
    received: int = Field(0, description="messages that arrived as the newest")
    missing: int = Field(0, description="messages that did not arrive")
    late: int = Field(0, description="messages that arrived after a newer one, and were dropped")
    foreign: int = Field(0, description="datagrams with a wrong key or session, or played again; dropped")
    blind: bool = Field(False, description="the ground law has no fresh pose")
    failed: bool = Field(False, description="the law has failed")
    rival: str = Field("", description="another ground law that asks for this vehicle, and is refused")
    refused: str = Field("", description="why a ground law was refused last; empty after a session has begun")


class Other(_Said):
    """Another vehicle of the room, as this one's motion capture sees its body."""

    body: str = Field(description="its name in QTM")
    position_w_m: Vector | None = Field(None, description="where it was last seen; null before")
    age_s: float | None = Field(None, description="time since it was last seen, s; null before")
    distance_m: float | None = Field(None, description="horizontal distance to it, m")


WAITING = "waiting"
"""Phase in the state while the service has no vehicle."""


class State(_Said):
    """State of the flight, published ten times a second."""

    time_s: float
    session: str
    phase: str = Field(description="as in docs/safety.md; or waiting, while the service has no vehicle")
    reason: str = Field("", description="why the flight was ended or handed over, or what the service waits for")
    armed: bool = False
    in_air: bool | None = Field(None, description="null while not known")
    mode: str = ""
    battery: float | None = Field(None, description="remaining charge, 0..1")
    battery_v: float | None = None
    position_w_m: Vector | None = None
    velocity_w_mps: Vector | None = None
    yaw_rad: float | None = None
    tilt_rad: float | None = None
    q_w_flu_wxyz: tuple[float, float, float, float] | None = Field(
        None, description="attitude: unit quaternion w, x, y, z that turns body FLU into W"
    )
    age_s: float | None = Field(None, description="age of the pose, s")
    reference_w_m: Vector | None = None
    error_m: float | None = Field(None, description="distance to the reference")
    thrust: float | None = Field(None, description="thrust of the last setpoint of the control law, 0..1")
    controller: str = ""
    sent_share: float | None = Field(None, description="share of the last second's cycles that sent a new setpoint")
    law_link: LawLink | None = Field(None, description="link to a law on the ground; null for a law on board")
    faults: tuple[str, ...] = Field((), description="active faults, by their names in docs/safety.md")
    arms: str | None = Field(None, description="phase of the arms; null without arms")
    joints_rad: tuple[float | None, ...] | None = None
    doing: Doing | None = None
    remaining_s: float | None = Field(
        None,
        description="time until the planned motion (climb, approach, trajectory, descent) is at its end, s; null "
        "while it only hovers",
    )
    late_s: float | None = Field(None, description="delay of the start of the control cycle, s")
    others: tuple[Other, ...] = Field((), description="the other vehicles of [separation], by priority")
    px4_age_s: float | None = Field(None, description="time since the autopilot was last heard, s; null before")
    record: str = Field("", description="name of the file of the newest record; empty without one")
    text: str = Field("", description="the autopilot's newest STATUSTEXT")
    text_age_s: float | None = Field(None, description="time since that text arrived, s")
    warnings: tuple[str, ...] = Field(
        (),
        description="what the operator must know beside faults: the flight is not recorded, another service uses the "
        "same name, checks are off",
    )
