"""Parts of a flight, read from the configuration: laws, pipeline, and the stages of a tick."""

from dataclasses import dataclass, field, replace

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController, load_controller
from companion.config.law_margin import LawMargin, Measure, measured, require_margin
from companion.control.compiled.pipeline import FlightPipeline
from companion.control.compiled.wire import FlightWire
from companion.control.controller import Controller
from companion.control.pipeline import ControlPipeline
from companion.control.remote_law import RemoteLaw
from companion.control.wire_setpoint import WireSetpoint
from companion.core.interfaces import ArmBus, Autopilot, Clock, GroundPoses, MocapSource, WatchdogTimer
from companion.estimation.estimator import EstimatorParams
from companion.estimation.from_autopilot import FromAutopilotParams
from companion.flight.arm_step import ArmStep
from companion.flight.estimate_step import EstimateFromAutopilot, EstimateFromFrames, EstimateStep
from companion.flight.health_step import HealthStep, Sides
from companion.flight.horizon_step import HorizonStep
from companion.flight.law_step import LawStep
from companion.flight.remote_step import LawLink, RemoteStep
from companion.flight.setpoint_stream import SetpointStream
from companion.flight.vision_step import VisionStep
from companion.guard.geofence import NO_FENCE
from companion.supervisor.flight_state import FlightRules
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.without_frames import OFF


@dataclass(frozen=True, kw_only=True)
class Devices:
    """The real or simulated parts the loop speaks to."""

    mocap: MocapSource
    autopilot: Autopilot
    clock: Clock
    watchdog_timer: WatchdogTimer
    arms: ArmBus | None = None
    sides: Sides = field(default_factory=Sides)
    law_link: LawLink | None = None
    """Link to a law on the ground; None for a law on board."""
    ground_poses: GroundPoses | None = None
    """Poses of a law on the ground, on a vehicle that frames do not reach; None where they do."""


@dataclass(frozen=True, kw_only=True)
class Stages:
    """Each does its part of every tick."""

    period_s: float
    rules: FlightRules
    safety: SafetyRules
    estimate: EstimateStep
    control: ControlPipeline
    arms: ArmStep | None
    law: LawStep
    health: HealthStep
    stream: SetpointStream
    horizon: HorizonStep
    vision: VisionStep
    remote: RemoteStep | None = None
    """Part of a law on the ground; None for a law on board."""


def period_s(config: CompanionConfig) -> float:
    """Return the time from one control cycle to the next."""
    return 1.0 / config.control.rate_hz


def controller_of(config: CompanionConfig, name: str, allow_unstable: bool = False) -> LoadedController:
    """Load a law for this vehicle; errors as of `load_controller`."""
    return load_controller(name, config.vehicle_model(), period_s(config), allow_unstable)


def margin_in(config: CompanionConfig, loaded: LoadedController, measure: Measure = measured) -> LawMargin:
    """Return the law's margins on this vehicle; ConfigError where they are too small (`require_margin`)."""
    return require_margin(loaded, config.vehicle_model(), period_s(config), measure)


def pipeline_of(config: CompanionConfig, law: Controller, frames: bool = True) -> ControlPipeline:
    """Return the law's pipeline, with the guard at its end; without frames the guard has no fence."""
    guard = config.guard() if frames else config.guard(NO_FENCE)
    return FlightPipeline(law, config.vehicle.thrust_model(), config.limits.limits(), guard)


def wire_of(config: CompanionConfig, frames: bool = True) -> WireSetpoint:
    """Return the correction of the autopilot's horizon, between pipeline and autopilot; none without frames."""
    rules = config.control.horizon_rules(config.safety.tilt_apart_rad)
    return FlightWire(rules if frames else replace(rules, enabled=False), config.limits.limits())


def ground_pipeline_of(config: CompanionConfig, law: Controller) -> ControlPipeline:
    """Return the pipeline of a law on the ground; the guard is on the vehicle."""
    return FlightPipeline(law, config.vehicle.thrust_model(), config.limits.limits())


def with_link(config: CompanionConfig, up_age_s: float) -> CompanionConfig:
    """Return the configuration for a law whose commands arrive `up_age_s` late: its poses are older by that."""
    mocap = config.mocap.model_copy(update={"delay_s": config.mocap.delay_s + up_age_s})
    return config.model_copy(update={"mocap": mocap})


def health_of(config: CompanionConfig, sides: Sides, frames: bool = True) -> HealthStep:
    """Return the health checks; without frames, those that need a pose are off."""
    off, separation = frozenset() if frames else OFF, config.separation_rules()
    return HealthStep(config.safety.rules(), config.fence.fence(), sides, off, separation)


def estimator_of(config: CompanionConfig) -> EstimatorParams:
    """Return the estimator's parameters."""
    return EstimatorParams(delay_s=config.mocap.delay_s, parked_below_m=config.separation.parked_below_m)


def from_autopilot_of(config: CompanionConfig) -> FromAutopilotParams:
    """Return the parameters of the estimate without frames."""
    return FromAutopilotParams(attitude_delay_s=config.px4.attitude_delay_s, vision_delay_s=config.mocap.delay_s)


def estimate_of(config: CompanionConfig, mocap: MocapSource, ground: GroundPoses | None) -> EstimateStep:
    """Return the keeper of the estimate: from frames, or without them by the ground's poses."""
    if ground is None:
        return EstimateFromFrames(mocap, estimator_of(config))
    return EstimateFromAutopilot(ground, from_autopilot_of(config))


def arms_of(config: CompanionConfig, bus: ArmBus | None) -> ArmStep | None:
    """Return the arms' part of a tick; None for a vehicle without."""
    if bus is None or config.arms is None:
        return None
    return ArmStep(bus, config.arms, config.vehicle_model(), config.airframe(), period_s(config))


def stages_of(devices: Devices, controller: Controller, config: CompanionConfig) -> Stages:
    """All of them, with their memories empty; a law on the ground flies instead of `controller` if there is a link."""
    remote_law = RemoteLaw()
    remote = None if devices.law_link is None else RemoteStep(devices.law_link, remote_law)
    controller = controller if remote is None else remote_law
    rules, safety, step_s = config.flight_rules(), config.safety.rules(), period_s(config)
    frames = devices.ground_poses is None
    control, arms = pipeline_of(config, controller, frames), arms_of(config, devices.arms)
    stream = SetpointStream(devices.autopilot, devices.watchdog_timer, devices.clock, safety.not_followed_s)
    cap_rad = float(config.control.horizon_rules(safety.tilt_apart_rad).cap_rad)
    horizon = HorizonStep(wire_of(config, frames), stream, safety, cap_rad, config.px4.attitude_delay_s, step_s)
    return Stages(
        period_s=step_s,
        rules=rules,
        safety=safety,
        estimate=estimate_of(config, devices.mocap, devices.ground_poses),
        control=control,
        arms=arms,
        law=LawStep(control, arms, rules, safety, config.limits.max_thrust, step_s),
        health=health_of(config, devices.sides, frames),
        stream=stream,
        horizon=horizon,
        vision=VisionStep(devices.autopilot, config.px4.vision_rate_hz, step_s),
        remote=remote,
    )
