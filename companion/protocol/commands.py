"""Commands of an operator, one strict model per verb; docs/bus/command.schema.json is generated from them."""

from typing import Annotated, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from companion.core.waypoint_limits import LONGEST_S, MAX_WAYPOINTS, MAX_YAW_RAD

ID = r"^[A-Za-z0-9_.:-]{1,64}$"
"""Pattern of a command's ID."""
Metres = Annotated[float, Field(ge=-50.0, le=50.0)]


class _Message(BaseModel):
    """Base of all messages: unknown fields and numbers that are not finite are errors."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class _Command(_Message):
    """Fields that every command has."""

    id: str = Field(pattern=ID, description="unique for every command; a command delivered twice is executed once")
    session: str = Field(
        pattern=r"^[0-9a-f]{16}$", description="session in the retained status: identifies one run of the service"
    )
    sent_s: float = Field(
        ge=0.0, le=1e11, description="time of sending by the service's clock: `time_s` of its state plus the time since"
    )
    reply_to: str | None = Field(
        None,
        pattern=r"^[A-Za-z0-9_-]{1,64}$",
        description="client whose reply topic gets the replies; MQTT 5's response topic takes precedence",
    )


class Preflight(_Command):
    """Run all checks that arming requires; changes nothing."""

    verb: Literal["preflight"]


class Arm(_Command):
    """Torque on and arms folded where the vehicle has some, all checks, offboard mode, motors at idle."""

    verb: Literal["arm"]


class TakeOff(_Command):
    """Climb to a height, then hold position."""

    verb: Literal["takeoff"]
    height_m: float | None = Field(None, gt=0.0, le=50.0, description="above the ground; as configured if null")


class Hold(_Command):
    """Brake and hover; an interrupted trajectory is not resumed."""

    verb: Literal["hold"]


class GoTo(_Command):
    """Fly to a position at the configured speed, then hold."""

    verb: Literal["goto"]
    x_m: Metres = Field(description="in W")
    y_m: Metres = Field(description="in W")
    z_m: float = Field(gt=0.0, le=50.0, description="in W, above the floor")
    yaw_rad: float | None = Field(
        None, ge=-MAX_YAW_RAD, le=MAX_YAW_RAD, description="heading there, rad; unchanged if null"
    )


class Waypoint(_Message):
    """One row of a CSV file of waypoints."""

    t_s: float = Field(ge=0.0, le=LONGEST_S)
    x_m: Metres
    y_m: Metres
    z_m: Metres
    yaw_rad: float = Field(
        0.0,
        ge=-MAX_YAW_RAD,
        le=MAX_YAW_RAD,
        description="heading, rad; the vehicle turns to the next one the short way round",
    )


class Track(_Command):
    """Go to a trajectory's start, fly it, hold its end; meanwhile the arms may move."""

    verb: Literal["track"]
    curve: Literal["ellipse", "figure8"] | None = Field(None, description="a curve of the paper; or give `waypoints`")
    waypoints: tuple[Waypoint, ...] | None = Field(None, min_length=2, max_length=MAX_WAYPOINTS, fail_fast=True)
    laps: int = Field(2, ge=1, le=100)
    period_s: float = Field(15.0, ge=4.0, le=120.0, description="duration of a lap at full speed, s")
    size: float = Field(1.0, ge=0.1, le=3.0, description="1 is 2 m across")
    height_m: float | None = Field(None, gt=0.0, le=50.0, description="height of a curve in W, m; unchanged if null")
    arms: str | None = Field(
        None, pattern=r"^[a-z0-9_-]{1,32}$", description="motion of config/arms/ that begins with the trajectory"
    )

    @model_validator(mode="after")
    def _one_path(self) -> "Track":
        if (self.curve is None) == (self.waypoints is None):
            raise ValueError("give either curve or waypoints")
        return self


class Arms(_Command):
    """Command for the arms alone."""

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
    """Switch to another control law, also in the air: the setpoint does not jump, the position can move by 0.3 m."""

    verb: Literal["controller"]
    name: str = Field(pattern=r"^[a-z0-9_-]{1,64}$", description="a name of config/controllers/, or etnn, pid")


class Land(_Command):
    """Fold the arms, land at the current position, disarm."""

    verb: Literal["land"]


class Abort(_Command):
    """Land as with `land`, and record that the operator aborted; on the ground stop the motors."""

    verb: Literal["abort"]


class Resume(_Command):
    """Take control back from PX4 or its pilot, and hover at the current position."""

    verb: Literal["resume"]


class Kill(_Command):
    """Stop the motors at once; in the air the vehicle falls."""

    verb: Literal["kill"]
    confirm: Literal["kill"]


class Disarm(_Command):
    """Stop the motors; only on the ground."""

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
"""Any command."""
COMMAND: TypeAdapter[Command] = TypeAdapter(Annotated[Command, Field(discriminator="verb")])
"""Validator that reads a command from JSON."""
VERBS: tuple[str, ...] = tuple(get_args(model.model_fields["verb"].annotation)[0] for model in get_args(Command))
"""Verbs of all commands."""
STOPS = frozenset({"hold", "land", "abort", "kill", "disarm"})
"""Verbs that make safe; all others may set something in motion."""
AT_ONCE = frozenset({"hold", "land", "abort", "resume", "kill", "disarm"})
"""Verbs that never wait for a running command, and end it."""
