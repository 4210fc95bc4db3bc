"""Tables of vehicle, limits, control loop, place of the law, flight and room."""

from typing import ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from companion.config.operator_config import secret_in, usable_secret
from companion.config.toml_files import Section
from companion.control.controller import VehicleModel
from companion.control.horizon_correction import CAP_RAD, TIME_CONSTANT_S, HorizonRules
from companion.core.errors import ConfigError
from companion.geometry.attitude import ThrustModel
from companion.guard.limits import Limits
from companion.law_link.sealing import LEAST_KEY_BYTES, MOST_KEY_BYTES

LEAST_CLIMB_M = 0.3
"""Lower it would hover in its own ground effect."""


class VehicleConfig(Section):
    """Properties of the vehicle; the defaults are the paper's and the recorded PX4's."""

    mass_kg: float = Field(VehicleModel.mass_kg, gt=0.1, le=50.0, description="total mass m_t with both arms, kg")
    gravity_mps2: float = Field(VehicleModel.gravity_mps2, gt=9.7, lt=9.9, description="the paper's g, m/s^2")
    hover_thrust: float = Field(
        ThrustModel.hover_thrust, gt=0.1, lt=0.9, description="normalised thrust that carries the weight"
    )
    thrust_curve: float = Field(
        ThrustModel.curve, ge=0.0, le=1.0, description="share f of force = f t^2 + (1 - f) t; 0 if PX4 corrects it"
    )
    attitude_bandwidth_radps: float = Field(
        VehicleModel.attitude_bandwidth_radps,
        gt=1.0,
        le=40.0,
        description="natural frequency of PX4's closed attitude loop, rad/s",
    )
    attitude_damping: float = Field(
        VehicleModel.attitude_damping, gt=0.1, le=2.0, description="damping ratio of PX4's closed attitude loop"
    )
    thrust_lag_s: float = Field(
        VehicleModel.thrust_lag_s, gt=0.0, le=0.5, description="first-order lag of the rotors, s"
    )
    setpoint_delay_s: float = Field(
        VehicleModel.setpoint_delay_s,
        ge=0.0,
        le=0.2,
        description="from a setpoint that is sent to the attitude's first movement, s",
    )
    thrust_delay_s: float = Field(
        VehicleModel.thrust_delay_s,
        ge=0.0,
        le=0.2,
        description="from a setpoint that is sent to the thrust's first change, s",
    )
    inertia_kgm2: tuple[float, float, float] = Field(
        (0.11, 0.10, 0.13), description="inertia of the whole vehicle about body x, y, z, kg m^2"
    )
    rate_integrator_s: float = Field(
        0.75, gt=0.0, le=100.0, description="time in which a lasting torque is trimmed out, MC_PITCHRATE_P / _I, s"
    )

    def thrust_model(self) -> ThrustModel:
        """Return the conversion of force to thrust."""
        return ThrustModel(self.mass_kg, self.gravity_mps2, self.hover_thrust, self.thrust_curve)


class LimitsConfig(Section):
    """The last gate before the autopilot."""

    max_tilt_rad: float = Field(Limits.max_tilt_rad, gt=0.05, le=0.8, description="largest tilt from level, rad")
    min_thrust: float = Field(Limits.min_thrust, ge=0.0, lt=0.5, description="least normalised thrust in flight")
    max_thrust: float = Field(Limits.max_thrust, gt=0.2, le=1.0, description="largest normalised thrust")
    max_turn_radps: float = Field(
        Limits.max_turn_radps, gt=0.1, le=50.0, description="largest rate of change of the attitude setpoint, rad/s"
    )
    max_thrust_rate_ps: float = Field(
        Limits.max_thrust_rate_ps, gt=0.1, le=100.0, description="largest rate of change of the thrust, 1/s"
    )

    @model_validator(mode="after")
    def _ordered(self) -> "LimitsConfig":
        if self.min_thrust >= self.max_thrust:
            raise ValueError(f"min_thrust = {self.min_thrust} must be below max_thrust = {self.max_thrust}")
        return self

    def limits(self) -> Limits:
        """Return the limits of setpoints."""
        return Limits(**self.model_dump())


class ControlConfig(Section):
    """The control loop."""

    rate_hz: float = Field(100.0, ge=20.0, le=500.0, description="control cycles a second")
    controller: str = Field("etnn", description="law to fly: a name in config/controllers/, or a TOML file")
    horizon_correction: bool = Field(
        True, description="turn setpoints back by how far the autopilot's horizon is off motion capture's"
    )
    horizon_time_constant_s: float = Field(
        TIME_CONSTANT_S,
        ge=0.2,
        le=20.0,
        description="low pass of the difference between the two horizons, s",
    )
    horizon_cap_rad: float = Field(
        CAP_RAD,
        ge=0.0,
        le=0.15,
        description="largest correction of the horizon, rad; at most 0.4 of safety.tilt_apart_rad counts",
    )

    def horizon_rules(self, tilt_apart_rad: float) -> HorizonRules:
        """Return the correction's settings; it ends well before attitudes count as disagreeing."""
        return HorizonRules(
            enabled=self.horizon_correction,
            time_constant_s=self.horizon_time_constant_s,
            cap_rad=min(self.horizon_cap_rad, 0.4 * tilt_apart_rad),
            apart_rad=0.5 * tilt_apart_rad,
        )


class FlightConfig(Section):
    """Take-off, landing, and what ends a flight."""

    takeoff_height_m: float = Field(
        1.2, ge=LEAST_CLIMB_M, le=5.0, description="height of the hover above the ground where it stands, m"
    )
    climb_speed_mps: float = Field(
        0.5, gt=0.05, le=2.0, description="peak speed of the take-off and of moves between points, m/s"
    )
    spool_up_s: float = Field(
        1.0, gt=0.2, le=10.0, description="time on the ground from idle to 80 % of hover thrust, s"
    )
    descent_speed_mps: float = Field(0.25, gt=0.05, le=1.0, description="speed of the landing, m/s")
    settle_s: float = Field(2.0, ge=0.0, le=30.0, description="hold before and after a trajectory, s")


class RoomConfig(Section):
    """Bounds on a trajectory's position, speed, acceleration and heading; checked before takeoff."""

    x_m: tuple[float, float] = Field((-4.0, 4.0), description="least and largest x in W, m")
    y_m: tuple[float, float] = Field((-4.0, 4.0), description="least and largest y in W, m")
    z_m: tuple[float, float] = Field((0.3, 3.0), description="least and largest height in W, m")
    max_speed_mps: float = Field(2.0, gt=0.0, le=10.0, description="largest speed of a trajectory, m/s")
    max_accel_mps2: float = Field(3.0, gt=0.0, le=10.0, description="largest acceleration of a trajectory, m/s^2")
    max_yaw_rate_radps: float = Field(
        1.5, ge=0.1, le=3.0, description="largest rate at which a trajectory's heading turns, rad/s"
    )
    max_yaw_accel_radps2: float = Field(
        3.0, ge=0.1, le=20.0, description="largest acceleration of a trajectory's heading, rad/s^2"
    )

    @model_validator(mode="after")
    def _ordered(self) -> "RoomConfig":
        for name, (least, largest) in (("x_m", self.x_m), ("y_m", self.y_m), ("z_m", self.z_m)):
            if least >= largest:
                raise ValueError(f"{name} = [{least}, {largest}]: the first must be below the second")
        return self


class LawLinkConfig(Section):
    """Link over which a law on the ground commands the vehicle; the same table on both sides."""

    table: ClassVar[str] = "law.link"
    host: str = Field("127.0.0.1", min_length=1, description="address of the vehicle, for the ground")
    port: int = Field(14600, gt=0, le=65535, description="UDP port on which the vehicle listens")
    listen: str = Field("0.0.0.0", min_length=1, description="address on which the vehicle listens")  # noqa: S104
    key_file: str | None = Field(
        None, min_length=1, description="file with the key that both sides share, one line; chmod 600"
    )
    beat_s: float = Field(
        0.03, ge=0.01, le=0.05, description="time after which the ground shows that it is alive when no event does, s"
    )
    delay_s: float = Field(
        0.002, ge=0.0, le=0.2, description="usual age of a command at its arrival, until it is measured, s"
    )

    @field_validator("key_file")
    @classmethod
    def _usable(cls, value: str | None) -> str | None:
        if value is not None:
            usable_secret(value)
        return value

    def secret(self) -> bytes:
        """Return the key in `key_file`; ConfigError if there is none or it is no key."""
        where = f"{self.table}.key_file"
        if self.key_file is None:
            raise ConfigError(f"{where}: missing: a law on the ground needs a key; `companion law-key FILE` makes one")
        key = secret_in(self.key_file, f"{where} = {self.key_file!r}", MOST_KEY_BYTES, "the key").encode()
        if len(key) < LEAST_KEY_BYTES:
            raise ConfigError(
                f"{where} = {self.key_file!r}: {len(key)} characters, at least {LEAST_KEY_BYTES} are needed: "
                "`companion law-key FILE` makes one"
            )
        return key


class LawConfig(Section):
    """Place of the control law: in the service on the vehicle, or in `companion law` on the ground (docs/split.md)."""

    runs_on: Literal["onboard", "ground"] = Field("onboard", description="where the control law runs")
    onboard_mocap: bool = Field(
        True, description="frames of motion capture reach the vehicle, too; false needs runs_on = ground"
    )
    link: LawLinkConfig = LawLinkConfig()

    @property
    def on_ground(self) -> bool:
        """True if the law runs on the ground."""
        return self.runs_on == "ground"

    @model_validator(mode="after")
    def _together(self) -> "LawConfig":
        if not self.onboard_mocap and not self.on_ground:
            raise ValueError('onboard_mocap = false: a law on board needs frames: give runs_on = "ground" as well')
        if self.on_ground and self.link.key_file is None:
            raise ValueError('runs_on = "ground": link.key_file is missing; `companion law-key FILE` makes one')
        return self
