"""The [safety] and [fence] tables: limits of the health checks, and where the vehicle must never be."""

from pydantic import Field, model_validator

from companion.config.toml_files import Section
from companion.guard.geofence import Fence
from companion.supervisor.safety_rules import SafetyRules

_RULES = SafetyRules()


class SafetyConfig(Section):
    """Thresholds of the faults. The reactions are a table in code (docs/safety.md prints it), not a setting."""

    coast_s: float = Field(_RULES.coast_s, gt=0.0, le=0.2, description="age of the pose up to which nothing is done, s")
    degraded_s: float = Field(_RULES.degraded_s, gt=0.0, le=0.3, description="age at which the vehicle is levelled, s")
    silent_s: float = Field(_RULES.silent_s, gt=0.05, le=0.5, description="age at which PX4 is told to land, s")
    slow_hz: float = Field(_RULES.slow_hz, ge=5.0, le=500.0, description="least number of usable frames a second")
    delayed_s: float = Field(_RULES.delayed_s, gt=0.0, le=0.3, description="largest lasting age of the pose, s")
    tilt_apart_rad: float = Field(
        _RULES.tilt_apart_rad, gt=0.02, le=1.0, description="largest tilt between mocap and autopilot, rad"
    )
    heading_apart_rad: float = Field(
        _RULES.heading_apart_rad, gt=0.02, le=1.0, description="largest turn between mocap and autopilot, rad"
    )
    tracking_m: float = Field(_RULES.tracking_m, gt=0.05, le=5.0, description="tracking error that ends a flight, m")
    lost_m: float = Field(_RULES.lost_m, gt=0.1, le=10.0, description="tracking error at which PX4 lands, m")
    dead_man_s: float = Field(
        _RULES.dead_man_s, ge=0.05, le=0.2, description="control loop stopped so long: the kernel ends the process, s"
    )
    autopilot_silent_s: float = Field(
        _RULES.autopilot_silent_s,
        ge=0.2,
        le=2.0,
        description="time without a message after which the autopilot counts as silent, s",
    )
    battery_low: float = Field(_RULES.battery_low, ge=0.0, le=0.9, description="share of the charge at which it lands")
    battery_critical: float = Field(
        _RULES.battery_critical, ge=0.0, le=0.9, description="share of the charge at which PX4 lands"
    )
    hold_s: float = Field(
        _RULES.hold_s, ge=1.0, le=600.0, description="time of a hold after a fault, before it lands, s"
    )
    operator_gone_s: float = Field(
        _RULES.operator_gone_s, gt=0.1, le=60.0, description="time without a broker that is a fault, s"
    )
    disk_free_mb: float = Field(
        _RULES.disk_free_mb, ge=0.0, le=1e6, description="least free space where records go, MB"
    )
    command_late_s: float = Field(
        _RULES.command_late_s, gt=0.03, le=0.2, description="silence of a law on the ground that is reported, s"
    )
    command_coast_s: float = Field(
        _RULES.command_coast_s, gt=0.03, le=0.25, description="silence of that law up to which its command is held, s"
    )
    command_level_s: float = Field(
        _RULES.command_level_s, gt=0.03, le=0.3, description="silence at which the vehicle is level, s"
    )
    command_silent_s: float = Field(
        _RULES.command_silent_s, gt=0.05, le=0.5, description="silence of that law at which PX4 is told to land, s"
    )
    command_delayed_s: float = Field(
        _RULES.command_delayed_s, gt=0.01, le=0.25, description="largest lasting age of that law's messages, s"
    )

    @model_validator(mode="after")
    def _ordered(self) -> "SafetyConfig":
        pairs = (
            ("coast_s", "degraded_s"),
            ("degraded_s", "silent_s"),
            ("tracking_m", "lost_m"),
            ("command_late_s", "command_coast_s"),
            ("command_coast_s", "command_level_s"),
            ("command_level_s", "command_silent_s"),
        )
        for low, high in pairs:
            if getattr(self, low) >= getattr(self, high):
                raise ValueError(f"{low} = {getattr(self, low):g} must be below {high} = {getattr(self, high):g}")
        if self.battery_critical >= self.battery_low:
            raise ValueError(
                f"battery_critical = {self.battery_critical:g} must be below battery_low = {self.battery_low:g}"
            )
        return self

    def rules(self) -> SafetyRules:
        """Return the thresholds of the health checks."""
        return SafetyRules(**self.model_dump())


class FenceConfig(Section):
    """Inside of the net, less the vehicle's own radius: its origin must never be outside."""

    x_m: tuple[float, float] = Field((-4.5, 4.5), description="least and largest x in W, m")
    y_m: tuple[float, float] = Field((-4.5, 4.5), description="least and largest y in W, m")
    top_m: float = Field(3.5, gt=0.5, le=50.0, description="largest height in W that the net allows, m")
    margin_m: float = Field(0.3, ge=0.0, le=5.0, description="distance that a trajectory keeps from the fence, m")
    braking_mps2: float = Field(
        Fence.braking_mps2, gt=0.2, le=8.0, description="deceleration the guard counts on, m/s^2"
    )
    reaction_s: float = Field(Fence.reaction_s, ge=0.1, le=2.0, description="time until the vehicle begins to brake, s")

    @model_validator(mode="after")
    def _room_to_brake(self) -> "FenceConfig":
        for name, (least, largest) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if largest - least < 1.0:
                raise ValueError(f"{name} = [{least}, {largest}]: the second must be at least 1 m above the first")
        return self

    def fence(self) -> Fence:
        """Return the fence of guard and health checks."""
        low = (self.x_m[0], self.y_m[0])
        high = (self.x_m[1], self.y_m[1], self.top_m)
        return Fence(low, high, self.braking_mps2, self.reaction_s)
