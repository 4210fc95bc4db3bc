"""The [arms] table: the servos of both arms, their bus, and what the arms are."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from enum import StrEnum

import numpy as np
from pydantic import Field, field_validator, model_validator

from companion.arms.model import JOINT_NAMES, KINDS, ArmModel, JointLimit, Link, Propellers
from companion.config.toml_files import Section
from companion.core.types import Array

MODELS = ("AX-12A", "XM430-W350", "XM430-W210")
XM_BAUDS = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Index is the code of the rate, https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/#baud-rate; an AX has the first
four of them."""
AX_FASTEST_BAUD = 1_000_000


class Feedforward(StrEnum):
    """Part of the arms' commanded motion that the law knows."""

    OFF = "off"
    FORCE = "force"
    """The links' reaction force."""
    FULL = "full"
    """And the tilt that the arms cause."""


class ServoConfig(Section):
    """One servo on the bus."""

    id: int = Field(ge=0, le=252, description="Dynamixel ID, different for every servo, whatever its protocol")
    model: str = Field(description="AX-12A (Protocol 1.0), XM430-W350 or XM430-W210 (Protocol 2.0)")
    direction: int = Field(1, description="1 or -1: whether the servo turns as the joint's sign says")
    zero_rad: float = Field(
        math.pi, ge=0.0, le=2.0 * math.pi, description="the servo's own angle at the joint's zero, rad from position 0"
    )

    @field_validator("model")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in MODELS:
            raise ValueError(f"must be one of {', '.join(MODELS)}")
        return value

    @field_validator("direction")
    @classmethod
    def _sign(cls, value: int) -> int:
        if value not in {1, -1}:
            raise ValueError("must be 1 or -1")
        return value


def _default_servos() -> dict[str, ServoConfig]:
    """Return IDs 1 to 4 right, 5 to 8 left; XM in the joints, AX in the claws, all assembled at their centre."""
    claw, joint = ("AX-12A", math.radians(150.0)), ("XM430-W350", math.pi)
    servos = {}
    for number, name in enumerate(JOINT_NAMES, start=1):
        model, zero_rad = claw if name.endswith("claw") else joint
        servos[name] = ServoConfig(id=number, model=model, zero_rad=zero_rad)
    return servos


class JointLimitConfig(Section):
    """Limits of a joint; the same for both arms."""

    min_rad: float = Field(ge=-math.pi, le=math.pi, description="least angle, rad")
    max_rad: float = Field(ge=-math.pi, le=math.pi, description="largest angle, rad")
    max_velocity_radps: float = Field(gt=0.0, le=10.0, description="largest velocity, rad/s")
    max_accel_radps2: float = Field(gt=0.0, le=200.0, description="largest acceleration, rad/s^2")

    @model_validator(mode="after")
    def _ordered(self) -> "JointLimitConfig":
        if self.min_rad >= self.max_rad:
            raise ValueError(f"min_rad = {self.min_rad} must be below max_rad = {self.max_rad}")
        return self


def _default_limits() -> dict[str, JointLimitConfig]:
    return {kind: JointLimitConfig(**asdict(limit)) for kind, limit in zip(KINDS, ArmModel().limits, strict=True)}


class LinkConfig(Section):
    """One link of an arm."""

    length_m: float = Field(gt=0.0, le=1.0, description="length from axis to axis, m")
    mass_kg: float = Field(ge=0.0, le=5.0, description="mass with the servo it carries, kg")
    com_m: float = Field(ge=0.0, le=1.0, description="centre of mass from the link's upper end, m")


def _default_links() -> tuple[LinkConfig, LinkConfig, LinkConfig]:
    upper, elbow, fore = (LinkConfig(**asdict(link)) for link in ArmModel().links)
    return upper, elbow, fore


class PropellerConfig(Section):
    """Positions of the propellers; the arms keep out of them."""

    count: int = Field(4, ge=2, le=12, description="number of propellers, evenly around the body")
    radius_m: float = Field(0.17, gt=0.0, le=1.0, description="radius of one disc, m")
    centre_m: float = Field(0.33, gt=0.0, le=2.0, description="distance from the body's axis to a disc's centre, m")
    first_rad: float = Field(0.7854, ge=-math.pi, le=math.pi, description="direction of the first one from body x, rad")
    height_m: float = Field(0.06, ge=-1.0, le=1.0, description="height of the discs above the body's origin, m")


class PosesConfig(Section):
    """Named poses of one arm: shoulder pitch, elbow pitch, elbow roll (rad); both arms take the same."""

    home_rad: tuple[float, float, float] = Field((0.35, 0.7, 0.0), description="pose to work from")
    stow_rad: tuple[float, float, float] = Field(
        (-0.47, 2.27, 0.0), description="pose for take-off and landing, best with the mass under the middle"
    )
    claw_open_rad: float = Field(0.8, ge=0.0, le=2.0, description="angle of an open claw, rad")
    claw_closed_rad: float = Field(0.05, ge=0.0, le=2.0, description="angle of a closed claw, rad")


class ArmsConfig(Section):
    """Both arms; leave the table out for a vehicle without."""

    port: str = Field("/dev/ttyUSB0", min_length=1, description="serial port of the bus adapter (U2D2)")
    baud: int = Field(1_000_000, ge=9_600, le=4_500_000, description="baud rate, the same in every servo, bits/s")
    rate_hz: float = Field(100.0, ge=50.0, le=100.0, description="bus cycles a second: goals out, state in")
    return_delay_us: int = Field(0, ge=0, le=508, description="return delay that every servo must have, microseconds")
    min_voltage_v: float = Field(10.0, ge=6.0, le=16.0, description="least supply at connect, V")
    max_temperature_c: float = Field(
        65.0, ge=30.0, le=90.0, description="largest temperature of a servo at connect, degrees C"
    )
    silent_s: float = Field(0.2, ge=0.05, le=2.0, description="a servo unheard for so long is a fault, s")
    stow_time_s: float = Field(6.0, ge=1.0, le=60.0, description="before landing wait so long for the arms to stow, s")
    stowed_within_rad: float = Field(0.1, gt=0.0, le=0.5, description="a joint so near its stow angle is stowed, rad")
    torque_off_after_landing: bool = Field(False, description="let the arms go limp once the vehicle is disarmed")
    land_on_fault: bool = Field(True, description="land on a servo fault in flight; false: only stop the arms")
    feedforward: Feedforward = Field(
        Feedforward.FULL,
        description="what the law knows of the commanded motion: nothing, the reaction force, the tilt as well",
    )
    servo_lag_s: float = Field(0.06, ge=0.0, le=0.5, description="how late the joints follow their goals, s")
    servos: dict[str, ServoConfig] = Field(
        default_factory=_default_servos, description="one table for each joint, as right.claw; IDs 1 to 8 if left out"
    )
    limits: dict[str, JointLimitConfig] = Field(
        default_factory=_default_limits,
        description="one table for each kind: shoulder_pitch, elbow_pitch, elbow_roll, claw",
    )
    links: tuple[LinkConfig, LinkConfig, LinkConfig] = Field(
        default_factory=_default_links, description="three tables: upper arm L_1, elbow L_2, forearm with claw L_3"
    )
    shoulder_flu_m: tuple[float, float, float] = Field(
        (0.0, 0.13, -0.08), description="place of the left shoulder, body FLU, m"
    )
    link_radius_m: float = Field(0.025, gt=0.0, le=0.2, description="half the thickness of the arms, m")
    body_half_flu_m: tuple[float, float, float] = Field(
        (0.14, 0.09, 0.06), description="half the size of the body's box, m"
    )
    stands_at_m: float | None = Field(
        None,
        gt=0.0,
        le=3.0,
        description="height of the body's origin over the floor it stands on; none: unchecked",
    )
    margin_m: float = Field(0.02, ge=0.0, le=0.2, description="distance the arms keep from all else, m")
    propellers: PropellerConfig = PropellerConfig()
    poses: PosesConfig = PosesConfig()

    @field_validator("servos", mode="before")
    @classmethod
    def _servos_over_defaults(cls, value: object) -> object:
        return _over(value, _default_servos(), "joint")

    @field_validator("limits", mode="before")
    @classmethod
    def _limits_over_defaults(cls, value: object) -> object:
        return _over(value, _default_limits(), "kind of joint")

    @field_validator("servos")
    @classmethod
    def _ids_differ(cls, value: dict[str, ServoConfig]) -> dict[str, ServoConfig]:
        owner: dict[int, str] = {}
        for name, servo in value.items():
            if servo.id in owner:
                raise ValueError(f"{owner[servo.id]} and {name} both have ID {servo.id}")
            owner[servo.id] = name
        return value

    @model_validator(mode="after")
    def _baud_of_all(self) -> "ArmsConfig":
        ax = any(servo.model.startswith("AX") for servo in self.servos.values())
        known = [baud for baud in XM_BAUDS if not ax or baud <= AX_FASTEST_BAUD]
        if self.baud not in known:
            choice = ", ".join(map(str, known))
            raise ValueError(f"baud = {self.baud} is none that all these servos have; there are {choice}")
        return self

    def stow_rad(self) -> Array:
        """Return the pose for take-off and landing, (8,), claws closed."""
        return np.array([*self.poses.stow_rad, self.poses.claw_closed_rad] * 2)

    @property
    def floor_z_m(self) -> float | None:
        """The floor's height in the body frame while the vehicle stands; None when it is not known."""
        return None if self.stands_at_m is None else -self.stands_at_m

    def home_rad(self) -> Array:
        """Return the pose to work from, (8,), claws closed."""
        return np.array([*self.poses.home_rad, self.poses.claw_closed_rad] * 2)

    def model(self) -> ArmModel:
        """Return the arms as `companion.arms` computes with them."""
        upper, elbow, fore = (Link(**link.model_dump()) for link in self.links)
        one, two, three, claw = (JointLimit(**self.limits[kind].model_dump()) for kind in KINDS)
        return ArmModel(
            links=(upper, elbow, fore),
            shoulder_flu_m=self.shoulder_flu_m,
            limits=(one, two, three, claw),
            link_radius_m=self.link_radius_m,
            body_half_flu_m=self.body_half_flu_m,
            propellers=Propellers(**self.propellers.model_dump()),
            margin_m=self.margin_m,
        )


def _over(given: object, defaults: Mapping[str, Section], what: str) -> object:
    """Merge what a file says of some joints into the defaults of all of them; ValueError for an unknown name."""
    if not isinstance(given, dict):
        return given
    for name in given:
        if name not in defaults:
            raise ValueError(f"unknown {what} {name!r}; there are {', '.join(defaults)}")
    said = {
        name: defaults[name].model_dump() | some if isinstance(some, dict) else some for name, some in given.items()
    }
    return {name: value.model_dump() for name, value in defaults.items()} | said
