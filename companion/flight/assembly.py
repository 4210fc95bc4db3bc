"""Parts of the flight loop, built from the configuration: the devices it speaks to, and the stages of a tick."""

from dataclasses import dataclass, field

from companion.config.companion_config import CompanionConfig
from companion.control.controller import Controller
from companion.control.pipeline import ControlPipeline
from companion.control.wire_setpoint import WireSetpoint
from companion.core.interfaces import ArmBus, Autopilot, Clock, MocapSource, WatchdogTimer
from companion.flight.arm_step import ArmStep
from companion.flight.health_step import HealthStep, Sides
from companion.flight.horizon_step import HorizonStep
from companion.flight.law_step import LawStep
from companion.flight.setpoint_stream import SetpointStream
from companion.flight.vision_step import VisionStep
from companion.supervisor.flight_state import FlightRules
from companion.supervisor.safety_rules import SafetyRules


@dataclass(frozen=True)
class Devices:
    """The real or simulated parts the loop speaks to."""

    mocap: MocapSource
    autopilot: Autopilot
    clock: Clock
    watchdog_timer: WatchdogTimer
    arms: ArmBus | None = None
    sides: Sides = field(default_factory=Sides)


@dataclass(frozen=True, kw_only=True)
class Stages:
    """Each does its part of every tick."""

    rules: FlightRules
    safety: SafetyRules
    control: ControlPipeline
    arms: ArmStep | None
    law: LawStep
    health: HealthStep
    stream: SetpointStream
    horizon: HorizonStep
    vision: VisionStep


def stages_of(devices: Devices, controller: Controller, config: CompanionConfig) -> Stages:
    """All of them, with their memories empty."""
    period_s = 1.0 / config.control.rate_hz
    rules, safety = config.flight_rules(), config.safety.rules()
    model, limits, fence = config.vehicle.thrust_model(), config.limits.limits(), config.fence.fence()
    control = ControlPipeline(controller, model, limits, guard=config.guard())
    stream = SetpointStream(devices.autopilot, devices.watchdog_timer, devices.clock, safety.not_followed_s)
    horizon = config.control.horizon_rules(safety.tilt_apart_rad)
    arms = None
    if devices.arms is not None and config.arms is not None:
        arms = ArmStep(devices.arms, config.arms, config.vehicle_model(), config.airframe(), period_s)
    return Stages(
        rules=rules,
        safety=safety,
        control=control,
        arms=arms,
        law=LawStep(control, arms, rules, safety, limits.max_thrust, period_s),
        health=HealthStep(safety, fence, devices.sides),
        stream=stream,
        horizon=HorizonStep(
            WireSetpoint(horizon, limits), stream, safety, float(horizon.cap_rad), config.px4.attitude_delay_s, period_s
        ),
        vision=VisionStep(devices.autopilot, config.px4.vision_rate_hz, period_s),
    )
