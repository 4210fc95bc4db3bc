"""What an operator may command: one strict model a verb. docs/bus/command.schema.json is printed from them."""

from typing import Annotated, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from companion.core.waypoint_limits import LONGEST_S, MAX_WAYPOINTS, MAX_YAW_RAD

ID = r"^[A-Za-z0-9_.:-]{1,64}$"
"""What a command may be called."""
Metres = Annotated[float, Field(ge=-50.0, le=50.0)]


class _Message(BaseModel):
    """What stands in no field is an error, and so is a number that is none."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class _Command(_Message):
    """What every command has."""

    id: str = Field(pattern=ID, description="new for every command; delivered twice counts once")
    session: str = Field(pattern=r"^[0-9a-f]{16}$", description="of the retained status: one run of the service")
    sent_s: float = Field(
        ge=0.0, le=1e11, description="when it was sent, by the service's own clock: `time_s` of its state, gone on"
    )
    reply_to: str | None = Field(
        None,
        pattern=r"^[A-Za-z0-9_-]{1,64}$",
        description="client whose reply topic answers; MQTT 5's response topic goes before it",
    )


class Preflight(_Command):
    """Check everything that arming asks for; changes nothing."""

    verb: Literal["preflight"]


class Arm(_Command):
    """Torque on and arms folded where the vehicle has some, all checks, offboard mode, motors at idle."""

    verb: Literal["arm"]


class TakeOff(_Command):
    """Climb, then hold."""

    verb: Literal["takeoff"]
    height_m: float | None = Field(None, gt=0.0, le=50.0, description="above the ground; as configured if null")


class Hold(_Command):
    """Brake and hover; what was flown is not taken up again."""

    verb: Literal["hold"]


class GoTo(_Command):
    """Fly to a place at the usual speed, then hold."""

    verb: Literal["goto"]
    x_m: Metres = Field(description="in W")
    y_m: Metres = Field(description="in W")
    z_m: float = Field(gt=0.0, le=50.0, description="in W, above the floor")
    yaw_rad: float | None = Field(
        None, ge=-MAX_YAW_RAD, le=MAX_YAW_RAD, description="heading there, rad; as it is if null"
    )


class Waypoint(_Message):
    """One row of a CSV file of waypoints."""

    t_s: float = Field(ge=0.0, le=LONGEST_S)
    x_m: Metres
    y_m: Metres
    z_m: Metres
    yaw_rad: float = Field(
        0.0, ge=-MAX_YAW_RAD, le=MAX_YAW_RAD, description="heading, rad; the next one is taken the short way round"
    )


class Track(_Command):
    """Go to a trajectory's start, fly it, hold its end; meanwhile the arms may move."""

    verb: Literal["track"]
    curve: Literal["ellipse", "figure8"] | None = Field(None, description="one of the paper's; or `waypoints`")
    waypoints: tuple[Waypoint, ...] | None = Field(None, min_length=2, max_length=MAX_WAYPOINTS, fail_fast=True)
    laps: int = Field(2, ge=1, le=100)
    period_s: float = Field(15.0, ge=4.0, le=120.0, description="a lap at full speed")
    size: float = Field(1.0, ge=0.1, le=3.0, description="1 is 2 m across")
    height_m: float | None = Field(None, gt=0.0, le=50.0, description="of a curve, in W; as it is if null")
    arms: str | None = Field(
        None, pattern=r"^[a-z0-9_-]{1,32}$", description="motion of config/arms/ that begins with the trajectory"
    )

    @model_validator(mode="after")
    def _one_path(self) -> "Track":
        if (self.curve is None) == (self.waypoints is None):
            raise ValueError("give either curve or waypoints")
        return self


class Arms(_Command):
    """Something for the arms alone."""

    verb: Literal["arms"]
    do: Literal["ready", "stow", "play", "hold", "limp", "clear"] = Field(
        description="ready: torque on and folded, on the ground; limp: torque off, on the ground; clear: forget faults"
    )
    motion: str | None = Field(None, pattern=r"^[a-z0-9_-]{1,32}$", description="for play: a motion of config/arms/")

    @model_validator(mode="after")
    def _motion_for_play(self) -> "Arms":
        if (self.do == "play") != (self.motion is not None):
            raise ValueError("play needs a motion, and nothing else takes one")
        return self


class SwitchController(_Command):
    """Another law from now on, in the air too: the setpoint does not jump, the position can move by 0.3 m."""

    verb: Literal["controller"]
    name: str = Field(pattern=r"^[a-z0-9_-]{1,64}$", description="a name of config/controllers/, or etnn, pid")


class Land(_Command):
    """Arms folded, down where the vehicle is, disarmed."""

    verb: Literal["land"]


class Abort(_Command):
    """As land, and the record says that the operator aborted; on the ground the motors stop."""

    verb: Literal["abort"]


class Resume(_Command):
    """Take the vehicle back from PX4 or its pilot, and hover where it is."""

    verb: Literal["resume"]


class Kill(_Command):
    """Stop the motors at once: in the air it falls."""

    verb: Literal["kill"]
    confirm: Literal["kill"]


class Disarm(_Command):
    """Motors off; only on the ground."""

    verb: Literal["disarm"]


class Params(_Command):
    """Answer with the configuration, the law's gains and the autopilot's parameters; changes nothing."""

    verb: Literal["params"]


Command = (
    Preflight
    | Arm
    | TakeOff
    | Hold
    | GoTo
    | Track
    | Arms
    | SwitchController
    | Land
    | Abort
    | Resume
    | Kill
    | Disarm
    | Params
)
"""Any of them."""
COMMAND: TypeAdapter[Command] = TypeAdapter(Annotated[Command, Field(discriminator="verb")])
"""Reads one from JSON."""
VERBS: tuple[str, ...] = tuple(get_args(model.model_fields["verb"].annotation)[0] for model in get_args(Command))
"""All of them."""
AT_ONCE = frozenset({"hold", "land", "abort", "resume", "kill", "disarm"})
"""Verbs that are never kept waiting by another one, and end it."""
