"""The mock's settings: strict models over TOML, every value with its unit."""

import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from mock_autopilot.config_errors import sentence
from mock_autopilot.faults.fault import Fault, check_fits
from mock_autopilot.faults.sentences import keys_of
from mock_autopilot.fleet.config import FleetConfig
from mock_autopilot.impairment.config import ImpairmentConfig
from mock_autopilot.physics.arm_bodies import ArmBodies
from mock_autopilot.physics.arms import JOINT_COUNT, Assembly
from mock_autopilot.physics.disturbance import Forces, Sinusoid
from mock_autopilot.physics.plant import PlantParams
from mock_autopilot.px4.attitude_error import AttitudeErrorParams, AttitudeErrorSource
from mock_autopilot.px4.params import ParamTable, UnknownParamError
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.servos.config import DynamixelConfig


class MockConfigError(ValueError):
    """The configuration cannot be used; the message is one sentence for a person."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Triple = tuple[float, float, float]


def _no_unknown_keys(of: type) -> BeforeValidator:
    """Return a validator that rejects keys which are no field of a dataclass."""

    def check(value: Any) -> Any:
        if isinstance(value, dict):
            unknown = sorted(set(value) - {item.name for item in fields(of)})
            if unknown:
                raise ValueError(f"unknown key {unknown[0]}")
        return value

    return BeforeValidator(check)


_ABOVE_ZERO = ("mass_kg", "max_thrust_n", "attitude_bandwidth_radps", "attitude_damping", "coulomb_width_mps")


def _no_such_plant(plant: PlantParams) -> PlantParams:
    """Raise ValueError for a mass or thrust of zero and for negative numbers, such as friction that pushes."""
    for item in fields(plant):
        given = getattr(plant, item.name)
        numbers = given if isinstance(given, tuple) else (given,)
        if item.name in _ABOVE_ZERO and min(numbers) <= 0.0:
            raise ValueError(f"{item.name} = {given}: must be above 0")
        if item.name != "ground_z_m" and min(numbers) < 0.0:
            raise ValueError(f"{item.name} = {given}: must not be negative")
    return plant


def _no_such_arms(bodies: ArmBodies) -> ArmBodies:
    for name in ("link_length_m", "link_mass_kg", "link_com_m"):
        if min(getattr(bodies, name)) < 0.0:
            raise ValueError(f"{name} = {getattr(bodies, name)}: must not be negative")
    return bodies


class VehicleConfig(_Strict):
    """The vehicle's pose at boot, and the delay before its loops see a setpoint."""

    start_position_ned_m: Triple = Field((0.0, 0.0, 0.0), description="Place at boot, world NED.")
    start_yaw_rad: float = Field(0.0, ge=-3.2, le=3.2, description="Heading at boot, 0 is north.")
    attitude_delay_s: float = Field(0.014, ge=0.0, le=0.5, description="From a setpoint's frame to the attitude loop.")
    thrust_delay_s: float = Field(0.004, ge=0.0, le=0.5, description="From a setpoint's frame to the motors.")


class LinkConfig(_Strict):
    """The MAVLink link: PX4's onboard port pair."""

    local_port: int = Field(14580, ge=0, le=65535, description="Listens and sends here; 0 takes any free port.")
    remote_host: str = Field("127.0.0.1", description="Where everything is sent, heard from or not.")
    remote_port: int = Field(14540, ge=1, le=65535, description="Port of the client.")


class GcsLinkConfig(LinkConfig):
    """The second link, for a ground station; off unless asked for."""

    enabled: bool = Field(False, description="The link is there.")
    local_port: int = Field(18570, ge=0, le=65535, description="Listens and sends here; 0 takes any free port.")
    remote_port: int = Field(14550, ge=1, le=65535, description="Port of the ground station.")


class DisturbanceConfig(_Strict):
    """Forces in world axes (NED, N)."""

    constant_ned_n: Triple = Field((0.0, 0.0, 0.0), description="Force that never changes.")
    sinusoids: tuple[Annotated[Sinusoid, _no_unknown_keys(Sinusoid)], ...] = Field((), description="Slow pushes.")
    noise_n: Triple = Field((0.0, 0.0, 0.0), description="Standard deviation of the random part.")
    noise_time_s: float = Field(1.0, gt=0.0, description="Correlation time of the random part.")

    @field_validator("sinusoids")
    @classmethod
    def _periods_are_positive(cls, value: tuple[Sinusoid, ...]) -> tuple[Sinusoid, ...]:
        if any(wave.period_s <= 0.0 for wave in value):
            raise ValueError("a period_s must be greater than 0")
        return value

    def forces(self) -> Forces:
        """Return the forces in the form that the world uses."""
        return Forces(self.constant_ned_n, self.sinusoids, self.noise_n, self.noise_time_s)


class EstimatorConfig(_Strict):
    """Errors of the autopilot's estimator, as recorded from PX4 (docs/px4-conformance.md)."""

    attitude_error_source: AttitudeErrorSource = Field(
        "random",
        description="Where the error of the autopilot's roll and pitch comes from: random, a walk of given size and"
        " time, or a flight recorded from PX4, begun anywhere in it.",
    )
    attitude_error_rad: float | None = Field(
        None,
        ge=0.0,
        le=0.2,
        description="RMS error of roll and of pitch; left out: 0.021 if random (1.2 degrees), or as recorded; 0: none, "
        "and position and velocity err as little.",
    )
    attitude_error_time_s: float = Field(
        5.0, ge=0.1, le=1000.0, description="Correlation time (1/e) of the random error."
    )

    distance_sensor: bool = Field(
        True,
        description="A distance sensor looks down. With EKF2_RNG_CTRL = 1 PX4 crawls the end of a landing by it, and"
        " takes it for the height reference: 0.1 to 0.7 m too high in flight (right if attitude_error_rad = 0).",
    )

    def attitude_error(self) -> AttitudeErrorParams:
        """Return the parameters of the attitude error that the horizon uses."""
        return AttitudeErrorParams(
            source=self.attitude_error_source, size_rad=self.attitude_error_rad, time_s=self.attitude_error_time_s
        )


class ArmsConfig(_Strict):
    """Two arms with their servos; the vehicle has them only if they are enabled."""

    enabled: bool = Field(False, description="The vehicle has arms.")
    bodies: Annotated[ArmBodies, _no_unknown_keys(ArmBodies), AfterValidator(_no_such_arms)] = Field(
        default_factory=ArmBodies
    )
    direction: tuple[int, ...] = Field(
        (1,) * JOINT_COUNT, description="1 or -1 for each joint: whether its servo turns as the joint's sign says."
    )
    zero_rad: tuple[float, ...] = Field(Assembly().zero_rad, description="Each servo's angle at its joint's zero.")
    inertia_kgm2: Triple = Field(Assembly().inertia_kgm2, description="Of the whole vehicle about body x, y, z.")
    bus: DynamixelConfig = Field(default_factory=lambda: DynamixelConfig.model_validate({}))

    @model_validator(mode="after")
    def _eight_of_each(self) -> Self:
        for name, count in (
            ("direction", len(self.direction)),
            ("zero_rad", len(self.zero_rad)),
            ("bus.servos", len(self.bus.servos)),
        ):
            if count != JOINT_COUNT:
                raise ValueError(f"{name} must have one entry for each of {JOINT_COUNT} joints, it has {count}")
        if any(sign not in {1, -1} for sign in self.direction):
            raise ValueError("every direction must be 1 or -1")
        return self

    def assembly(self) -> Assembly:
        """Return the assembly of both arms that the world uses."""
        return Assembly(self.bodies, self.direction, self.zero_rad, self.inertia_kgm2)


class Px4Config(_Strict):
    """Parameters that differ from the recorded defaults."""

    params: dict[str, float] = Field(
        default_factory=dict, description="Parameters by their names in PX4, docs/px4-conformance.md."
    )

    @field_validator("params")
    @classmethod
    def _px4_has_them(cls, value: dict[str, float]) -> dict[str, float]:
        try:
            ParamTable(value)
        except UnknownParamError as error:
            raise ValueError(str(error)) from error
        return value


def _said(value: Any) -> Any:
    """Return the keys of a fault that is given as a sentence: `say = "mocap stuck at 12 s for 2 s"`."""
    if not isinstance(value, dict) or "say" not in value:
        return value
    if len(value) > 1 or not isinstance(value["say"], str):
        raise ValueError('say = "..." is a whole fault in words and stands alone')
    return keys_of(value["say"])


class MockConfig(_Strict):
    """Every setting of `python -m mock_autopilot` that a file can hold."""

    vehicle: VehicleConfig = Field(default_factory=VehicleConfig)
    plant: Annotated[PlantParams, _no_unknown_keys(PlantParams), AfterValidator(_no_such_plant)] = Field(
        default_factory=PlantParams
    )
    disturbance: DisturbanceConfig = Field(default_factory=DisturbanceConfig)
    estimator: EstimatorConfig = Field(default_factory=lambda: EstimatorConfig.model_validate({}))
    arms: ArmsConfig = Field(default_factory=lambda: ArmsConfig.model_validate({}))
    px4: Px4Config = Field(default_factory=Px4Config)
    mavlink: LinkConfig = Field(default_factory=LinkConfig)
    gcs: GcsLinkConfig = Field(default_factory=GcsLinkConfig)
    qualisys: QualisysConfig = Field(default_factory=lambda: QualisysConfig.model_validate({}))
    fleet: FleetConfig = Field(default_factory=lambda: FleetConfig.model_validate({}))
    impairment: ImpairmentConfig = Field(default_factory=lambda: ImpairmentConfig.model_validate({}))
    faults: tuple[Annotated[Fault, BeforeValidator(_said)], ...] = Field(
        (), description='Faults, each as keys or as say = "...", docs/faults.md.'
    )

    @model_validator(mode="after")
    def _servos_are_there(self) -> Self:
        for fault in self.faults:
            check_fits(fault, self.arms.enabled, self.fleet.vehicles)
        return self

    @model_validator(mode="after")
    def _ports_are_there(self) -> Self:
        last = self.fleet.vehicles - 1
        for name, port in (
            ("mavlink.local_port", self.mavlink.local_port),
            ("mavlink.remote_port", self.mavlink.remote_port),
            ("gcs.local_port", self.gcs.local_port),
        ):
            if port + last > 65535:
                raise ValueError(f"{name} = {port}: vehicle {last + 1} would have port {port + last}, above 65535")
        return self

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Validate; raise MockConfigError with the first wrong key and the reason."""
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise MockConfigError(sentence(error.errors()[0])) from None

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a TOML file; raise MockConfigError with one sentence for the first mistake in it."""
        try:
            raw = path.read_bytes()
        except OSError as error:
            raise MockConfigError(f"cannot read {path}: {error.strerror}") from None
        if b"\0" in raw:
            raise MockConfigError(f"{path} is UTF-16 or no text at all: save it as UTF-8")
        try:
            values = tomllib.loads(raw.decode("utf-8-sig"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise MockConfigError(f"{path} is not valid TOML: {error}") from None
        try:
            return cls.from_dict(values)
        except MockConfigError as error:
            raise MockConfigError(f"{path}: {error}") from None
