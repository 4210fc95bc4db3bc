"""What the flight loop is made of: the devices it speaks to, and the stages of a tick, built from the configuration."""

from dataclasses import dataclass, field

from companion.arm_stage import ArmStage
from companion.config import CompanionConfig
from companion.control.controller import Controller
from companion.control_stage import ControlStage
from companion.health_stage import HealthStage, Sides
from companion.horizon_stage import HorizonStage
from companion.law_stage import LawStage
from companion.ports import ArmBus, Autopilot, Clock, DeadMan, MocapSource
from companion.setpoint_stream import SetpointStream
from companion.supervisor.flight import FlightRules
from companion.supervisor.safety import SafetyRules
from companion.vision_stage import VisionStage
from companion.wire_stage import WireStage


@dataclass(frozen=True)
class Devices:
    """The real or simulated parts the loop speaks to."""

    mocap: MocapSource
    autopilot: Autopilot
    clock: Clock
    dead_man: DeadMan
    arms: ArmBus | None = None
    sides: Sides = field(default_factory=Sides)


@dataclass(frozen=True)
class Stages:
    """Each does its part of every tick."""

    rules: FlightRules
    safety: SafetyRules
    control: ControlStage
    arms: ArmStage | None
    law: LawStage
    health: HealthStage
    stream: SetpointStream
    horizon: HorizonStage
    vision: VisionStage


def stages_of(devices: Devices, controller: Controller, config: CompanionConfig) -> Stages:
    """All of them, with their memories empty."""
    period_s = 1.0 / config.control.rate_hz
    rules, safety = config.flight_rules(), config.safety.rules()
    model, limits, fence = config.vehicle.thrust_model(), config.limits.limits(), config.fence.fence()
    control = ControlStage(controller, model, limits, guard=config.guard())
    stream = SetpointStream(devices.autopilot, devices.dead_man, devices.clock, control, safety.not_followed_s)
    horizon = config.control.horizon_rules(safety.tilt_apart_rad)
    arms = None
    if devices.arms is not None and config.arms is not None:
        arms = ArmStage(devices.arms, config.arms, config.vehicle_model(), config.airframe(), period_s)
    return Stages(
        rules,
        safety,
        control,
        arms,
        LawStage(control, arms, rules, safety, limits.max_thrust, period_s),
        HealthStage(safety, fence, devices.sides),
        stream,
        HorizonStage(
            WireStage(horizon, limits), stream, safety, float(horizon.cap_rad), config.px4.attitude_delay_s, period_s
        ),
        VisionStage(devices.autopilot, config.px4.vision_rate_hz, period_s),
    )
