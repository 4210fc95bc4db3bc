"""The service's configuration: strict models over TOML, every value with its unit, range and a sentence."""

import hashlib
import json
from pathlib import Path

from pydantic import model_validator

from companion.arms.feedforward import Airframe
from companion.config.arms_config import ArmsConfig
from companion.config.flight_config import (
    ControlConfig,
    FlightConfig,
    LawConfig,
    LimitsConfig,
    RoomConfig,
    VehicleConfig,
)
from companion.config.mocap_config import MocapConfig, mocap_and_operator
from companion.config.operator_config import OperatorConfig, PageConfig
from companion.config.preflight_config import PreflightConfig
from companion.config.px4_config import Px4Config
from companion.config.records_config import RecordsConfig
from companion.config.safety_config import FenceConfig, SafetyConfig
from companion.config.separation_config import SeparationConfig
from companion.config.toml_files import Section, read_toml, validate
from companion.control.controller import VehicleModel
from companion.guard.geofence import Fence
from companion.guard.guard import AgeRange, Guard, most_braking_mps2
from companion.law_link.agreement import Agreed
from companion.supervisor.flight_state import FlightRules
from companion.supervisor.separation import SeparationRules

_ONLY_ABOARD = {"port", "baud", "silent_s", "min_voltage_v", "torque_off_after_landing"}
_DEAD_MAN_CYCLES = 3
"""A cycle may come late, and one may be left out, before the loop has stopped."""


class CompanionConfig(Section):
    """The whole file."""

    vehicle: VehicleConfig = VehicleConfig()
    limits: LimitsConfig = LimitsConfig()
    px4: Px4Config = Px4Config()
    mocap: MocapConfig = MocapConfig()
    control: ControlConfig = ControlConfig()
    law: LawConfig = LawConfig()
    flight: FlightConfig = FlightConfig()
    room: RoomConfig = RoomConfig()
    fence: FenceConfig = FenceConfig()
    separation: SeparationConfig = SeparationConfig()
    safety: SafetyConfig = SafetyConfig()
    preflight: PreflightConfig = PreflightConfig()
    arms: ArmsConfig | None = None
    operator: OperatorConfig | None = None
    page: PageConfig = PageConfig()
    records: RecordsConfig = RecordsConfig()

    @model_validator(mode="after")
    def _agrees(self) -> "CompanionConfig":
        of_mocap = mocap_and_operator(self.mocap, self.operator)
        of_others = _others_seen(self)
        for wrong in (_vehicle_and_limits(self), _loop_and_safety(self), _room_and_fence(self), of_mocap, of_others):
            if wrong:
                raise ValueError(wrong)
        return self

    def mocap_broker(self) -> OperatorConfig:
        """Return the broker of mocap.source = "mqtt"."""
        broker = self.mocap.broker or self.operator
        assert broker is not None, "a configuration without one is refused"
        return broker

    def separation_rules(self) -> SeparationRules | None:
        """Return the rules that keep other vehicles apart; None in a room of one vehicle."""
        return self.separation.rules(self.mocap.body, self.fence.braking_mps2, self.fence.reaction_s)

    def flight_rules(self) -> FlightRules:
        """Return the phase machine's numbers; on the way to a place it is held to what a trajectory is."""
        f, arms = self.flight, self.arms or ArmsConfig()
        others, safety = self.separation_rules(), self.safety.rules()
        return FlightRules(
            hover_thrust=self.vehicle.hover_thrust,
            climb_speed_mps=min(f.climb_speed_mps, self.room.max_speed_mps),
            climb_accel_mps2=min(FlightRules.climb_accel_mps2, self.room.max_accel_mps2),
            spool_up_s=f.spool_up_s,
            descent_speed_mps=f.descent_speed_mps,
            turn_radps=min(FlightRules.turn_radps, self.room.max_yaw_rate_radps),
            turn_accel_radps2=min(FlightRules.turn_accel_radps2, self.room.max_yaw_accel_radps2),
            braking_mps2=self.fence.braking_mps2,
            stow_time_s=arms.stow_time_s,
            keep_clear=None if others is None else others.cylinder.widened(safety.yield_margin_m),
            land_clear=None if others is None else others.cylinder.widened(safety.traffic_margin_m),
            land_inside=self.fence.fence(),
            fence_margin_m=self.fence.margin_m,
            clear_ahead_s=safety.yield_ahead_s,
            land_on_arm_fault=arms.land_on_fault,
        )

    def guard(self, fence: Fence | None = None) -> Guard:
        """Return the guard in front of the autopilot, with the configured fence or another one."""
        safety = self.safety
        model, limits = self.vehicle.thrust_model(), self.limits.limits()
        pose = AgeRange(safety.coast_s, safety.degraded_s)
        command = AgeRange(safety.command_coast_s, safety.command_level_s)
        others = self.separation_rules()
        cylinder = None if others is None else others.cylinder
        return Guard(limits, model, fence or self.fence.fence(), pose, command, cylinder)

    def airframe(self) -> Airframe:
        """Return the vehicle's properties that set its response to the arms' forces and torques."""
        v = self.vehicle
        return Airframe(v.mass_kg, v.gravity_mps2, v.inertia_kgm2, v.attitude_bandwidth_radps, v.rate_integrator_s)

    def vehicle_model(self) -> VehicleModel:
        """Return the properties of the vehicle that a law may know."""
        v = self.vehicle
        return VehicleModel(
            mass_kg=v.mass_kg,
            gravity_mps2=v.gravity_mps2,
            attitude_bandwidth_radps=v.attitude_bandwidth_radps,
            attitude_damping=v.attitude_damping,
            thrust_lag_s=v.thrust_lag_s,
            setpoint_delay_s=v.setpoint_delay_s,
            thrust_delay_s=v.thrust_delay_s,
            mocap_age_s=self.mocap.delay_s,
        )


def agreed_of(config: CompanionConfig) -> Agreed:
    """Return all values, equal on the vehicle and on the ground, that law, conversion and feed-forward compute with.

    Tables inside [arms] are compared as a whole, by a digest, so that a hello fits into one datagram.
    """
    agreed: dict[str, str | float | int | bool | None] = {
        "control.rate_hz": config.control.rate_hz,
        "mocap.body": config.mocap.body,
        "law.onboard_mocap": config.law.onboard_mocap,
    }
    for table, model in (("vehicle", config.vehicle), ("limits", config.limits)):
        agreed |= {f"{table}.{key}": _short(value) for key, value in model.model_dump(mode="json").items()}
    if config.arms is not None:
        arms = {key: value for key, value in config.arms.model_dump(mode="json").items() if key not in _ONLY_ABOARD}
        agreed["arms.feedforward"] = arms.pop("feedforward")
        agreed["arms.servo_lag_s"] = arms.pop("servo_lag_s")
        agreed["arms, by their digest"] = _digest(arms)
    return agreed


def _short(value: object) -> str | float | int | bool | None:
    return value if isinstance(value, str | float | int | bool) or value is None else json.dumps(value)


def _digest(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:8]


def _vehicle_and_limits(config: CompanionConfig) -> str:
    """Return how the limits conflict with the vehicle; empty when they agree."""
    vehicle, limits, fence = config.vehicle, config.limits, config.fence
    if not limits.min_thrust < vehicle.hover_thrust < limits.max_thrust:
        return (
            f"vehicle.hover_thrust = {vehicle.hover_thrust:g} must be above limits.min_thrust = {limits.min_thrust:g} "
            f"and below limits.max_thrust = {limits.max_thrust:g}"
        )
    sideways_mps2, upwards_mps2 = most_braking_mps2(limits.limits(), vehicle.thrust_model())
    if fence.braking_mps2 > sideways_mps2:
        return (
            f"fence.braking_mps2 = {fence.braking_mps2:g} must be at most {sideways_mps2:.2f}, which "
            f"limits.max_tilt_rad = {limits.max_tilt_rad:g} gives: brake less, or tilt more"
        )
    if fence.braking_mps2 > upwards_mps2:
        return (
            f"fence.braking_mps2 = {fence.braking_mps2:g} must be at most {upwards_mps2:.2f}, which the guard gives "
            "below the ceiling: it leaves half the weight on the rotors, and limits.min_thrust"
        )
    return ""


def _loop_and_safety(config: CompanionConfig) -> str:
    """Return which limit of the health checks a healthy flight would exceed; empty when none."""
    safety, rate_hz = config.safety, config.control.rate_hz
    most_hz = 0.8 * rate_hz
    if safety.slow_hz > most_hz:  # one frame is used in a cycle: a slow loop must not look like slow motion capture
        return f"safety.slow_hz = {safety.slow_hz:g} must be at most {most_hz:g}, 0.8 of control.rate_hz = {rate_hz:g}"
    if safety.dead_man_s < _DEAD_MAN_CYCLES / rate_hz:
        return (
            f"safety.dead_man_s = {safety.dead_man_s:g} must be at least {_DEAD_MAN_CYCLES / rate_hz:.3g}, "
            f"{_DEAD_MAN_CYCLES} cycles of control.rate_hz = {rate_hz:g}"
        )
    if config.mocap.delay_s >= safety.delayed_s:
        return f"mocap.delay_s = {config.mocap.delay_s:g} must be below safety.delayed_s = {safety.delayed_s:g}"
    if safety.battery_low >= config.preflight.battery:
        return (
            f"safety.battery_low = {safety.battery_low:g} must be below preflight.battery = "
            f"{config.preflight.battery:g}, or a flight ends as it begins"
        )
    return ""


def _room_and_fence(config: CompanionConfig) -> str:
    """Return which allowed value would bring the vehicle near its fence; empty when none would."""
    room, fence, margin_m = config.room, config.fence, config.fence.margin_m
    for name, inner, outer in (("x_m", room.x_m, fence.x_m), ("y_m", room.y_m, fence.y_m)):
        if inner[0] - margin_m < outer[0] or inner[1] + margin_m > outer[1]:
            return (
                f"room.{name} = {list(inner)} must stay fence.margin_m = {margin_m:g} inside fence.{name} = "
                f"{list(outer)}: make the room smaller, or the fence larger if the net allows"
            )
    hover_m = config.flight.takeoff_height_m
    for name, value, top_m in (
        ("room.z_m", list(room.z_m), room.z_m[1]),
        ("flight.takeoff_height_m", hover_m, hover_m),
    ):
        if top_m + margin_m > fence.top_m:
            return f"{name} = {value} must stay fence.margin_m = {margin_m:g} below fence.top_m = {fence.top_m:g}"
    return ""


def _others_seen(config: CompanionConfig) -> str:
    """Return why the other vehicles of [separation] would not be seen; empty when they would, or there are none."""
    order, body = config.separation.order, config.mocap.body
    if not order:
        return ""
    if body not in order:
        return (
            f"separation.order = {list(order)} must contain mocap.body = {body!r}: every vehicle's file has the same "
            "list of all vehicles"
        )
    if config.mocap.source == "mqtt":
        return (
            "separation.order is for frames from QTM itself, as the bridge forwards this vehicle's body alone: set "
            'mocap.source = "qualisys"'
        )
    if not config.law.onboard_mocap:
        return (
            "separation.order is for a vehicle that gets frames: law.onboard_mocap = false leaves the others unseen; "
            "set law.onboard_mocap = true"
        )
    return ""


def load_config(path: Path) -> CompanionConfig:
    """Read the configuration file; ConfigError naming file, key and remedy."""
    return validate(CompanionConfig, read_toml(path), path)
