"""The whole list, from facts and configuration."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

from companion.config.companion_config import CompanionConfig
from companion.config.operator_config import OperatorConfig
from companion.config.preflight_config import PreflightConfig, Recommended
from companion.config.safety_config import FenceConfig, SafetyConfig
from companion.core.types import Array, AutopilotStatus, OtherService
from companion.preflight.checks import agreement, computer, mocap, start_place, vehicle, without_frames
from companion.preflight.checks.agreement import Difference, VisionFacts
from companion.preflight.checks.check import Check
from companion.preflight.checks.computer import ComputerFacts
from companion.preflight.checks.hand_test import HandTest, check_hand_test
from companion.preflight.checks.law_link import LawLinkFacts, check_law_link
from companion.preflight.checks.mocap import MocapFacts
from companion.preflight.checks.other_vehicles import OtherVehicleFacts, check_other_vehicles, check_seen_as_parked
from companion.preflight.checks.vehicle import ServoFacts, check_parameters
from companion.preflight.checks.without_frames import GroundPoseFacts
from companion.trajectories.reference import Trajectory

DELAY, HOVER, CURVE = "EKF2_EV_DELAY", "MPC_THR_HOVER", "THR_MDL_FAC"
"""Parameters that are compared with what is configured or measured here, and not with a list."""


@dataclass(frozen=True, kw_only=True)
class Facts:
    """Facts about vehicle, devices and computer that the checks need."""

    time_s: float
    when: datetime
    """On the system clock, with its time zone."""
    mocap: MocapFacts
    position_w_m: Array | None
    """Position of the vehicle, (3,) in W; None when it is not known."""
    status: AutopilotStatus
    apart: Difference
    vision: VisionFacts
    parameters: Mapping[str, float]
    """The autopilot's, by name; those that it did not tell are left out."""
    arms: ServoFacts | None
    machine: ComputerFacts
    kept: HandTest | str
    """When it was carried by hand; the reason where that is not known."""
    operator_age_s: float
    """Since the operator's broker last answered; 0 while it does, and where none is configured."""
    landed_age_s: float = math.inf
    """Since the last flight, before which both attitudes agreed, ended; infinite when none is known."""
    others: tuple[OtherService, ...] = ()
    """Services of other vehicles that were heard on the broker."""
    law: Check | None = None
    """The control law's margins on this vehicle; None in a service, which looks when it loads one."""
    vehicles: OtherVehicleFacts = field(default_factory=OtherVehicleFacts)
    """The other vehicles of [separation], as motion capture sees them."""
    ground: GroundPoseFacts | None = None
    """Poses of the law on the ground, on a vehicle that frames do not reach; None where they do."""
    law_link: LawLinkFacts | None = None
    """Link to a law on the ground; None for a law on board."""


def check_all(
    facts: Facts,
    config: CompanionConfig,
    wanted: PreflightConfig,
    recommended: Mapping[str, Recommended],
    trajectory: Trajectory | None = None,
) -> tuple[Check, ...]:
    """Run every check, in the order in which an operator would work through them."""
    return (
        *check_machine(facts.machine, config.safety, wanted),
        *check_operator(facts.operator_age_s, config.operator),
        *computer.check_others(facts.others, config.separation.order),
        *_seen(facts, config.safety, wanted),
        vehicle.check_link(facts.status, facts.time_s, config.safety.autopilot_silent_s),
        vehicle.check_alone(facts.status, config.px4.system_id),
        vehicle.check_ground(facts.status),
        *_agreeing(facts, wanted),
        agreement.check_vision(facts.vision, wanted.position_apart_m),
        *_compared(facts, config, wanted),
        *check_parameters(recommended, facts.parameters),
        vehicle.check_battery(facts.status, wanted.battery),
        *vehicle.check_arms(facts.arms, config.arms.silent_s if config.arms else math.inf),
        *([facts.law] if facts.law is not None else []),
        *(check_law_link(facts.law_link, config.safety.rules()) if facts.law_link is not None else ()),
        *check_place(facts.position_w_m, config.fence, config.flight.takeoff_height_m, trajectory),
        *_others(facts, config),
        *(() if facts.ground else (_hand_test(facts, config.mocap.body, wanted),)),
    )


def check_early(
    machine: ComputerFacts, status: AutopilotStatus, config: CompanionConfig, wanted: PreflightConfig
) -> tuple[Check, ...]:
    """Run the checks that need no waiting: they are shown first, and run again with the others."""
    return (
        *check_machine(machine, config.safety, wanted),
        vehicle.check_alone(status, config.px4.system_id),
        vehicle.check_ground(status),
    )


def _others(facts: Facts, config: CompanionConfig) -> tuple[Check, ...]:
    """Check the other vehicles of the room; nothing where there are none."""
    clear = config.flight_rules().keep_clear
    if clear is None:
        return ()
    names = config.separation.others_than(config.mocap.body)
    seen = check_other_vehicles(facts.vehicles, names, facts.position_w_m, clear)
    return *seen, check_seen_as_parked(facts.position_w_m, config.separation.parked_below_m)


def _hand_test(facts: Facts, body: str, wanted: PreflightConfig) -> Check:
    return check_hand_test(facts.kept, body, facts.when, wanted.by_hand_within_h)


def _seen(facts: Facts, safety: SafetyConfig, wanted: PreflightConfig) -> tuple[Check, ...]:
    """Check motion capture; on a vehicle without frames what it has instead, and say what is off."""
    if facts.ground is None:
        return check_mocap(facts.mocap, safety, wanted)
    own = without_frames.check_own_motion(facts.status, facts.time_s)
    return *without_frames.check_off(), without_frames.check_ground_poses(facts.ground), own


def _agreeing(facts: Facts, wanted: PreflightConfig) -> tuple[Check, ...]:
    """Check both attitudes; without frames the heading alone, which comes with the ground's poses."""
    if facts.ground is None:
        return check_agreement(facts.apart, wanted, facts.landed_age_s)
    return (agreement.check_heading(facts.apart, wanted.heading_apart_rad),)


def check_machine(seen: ComputerFacts, safety: SafetyConfig, wanted: PreflightConfig) -> tuple[Check, ...]:
    """Check this computer's disk, clocks and scheduling."""
    return (
        computer.check_disk(seen, safety.disk_free_mb),
        *computer.check_clock(seen),
        computer.check_priority(seen, wanted.realtime),
    )


def check_operator(age_s: float, operator: OperatorConfig | None) -> tuple[Check, ...]:
    """Check the operator's broker, where one is configured: without it a flight ends soon after takeoff."""
    return () if operator is None else (computer.check_broker(age_s, f"{operator.host}:{operator.port}"),)


def check_mocap(seen: MocapFacts, safety: SafetyConfig, wanted: PreflightConfig) -> tuple[Check, ...]:
    """Check body, rate, age and residual of motion capture."""
    return (
        mocap.check_body(seen),
        mocap.check_rate(seen, wanted.mocap_hz),
        mocap.check_age(seen, safety.coast_s),
        mocap.check_residual(seen, wanted.residual_m),
    )


def check_agreement(apart: Difference, wanted: PreflightConfig, landed_age_s: float = math.inf) -> tuple[Check, ...]:
    """Check both attitudes of a vehicle that stands, and has for `landed_age_s`; see check_tilts."""
    return (
        agreement.check_heading(apart, wanted.heading_apart_rad),
        *agreement.check_tilts(apart, wanted.tilt_apart_rad, landed_age_s),
    )


def check_place(
    position_w_m: Array | None, fence: FenceConfig, takeoff_height_m: float, trajectory: Trajectory | None
) -> tuple[Check, ...]:
    """Check that the vehicle, and the trajectory where known, are inside the fence with its margin."""
    standing = start_place.check_standing(position_w_m, takeoff_height_m, fence.fence(), fence.margin_m)
    if trajectory is None:
        return (standing,)
    return standing, start_place.check_trajectory(trajectory, fence.fence(), fence.margin_m)


def _compared(facts: Facts, config: CompanionConfig, wanted: PreflightConfig) -> tuple[Check, ...]:
    """Compare PX4's parameters; without frames poses are forwarded as if mocap.delay_s old, whatever the radio does."""
    delay_ms, hover, curve = (facts.parameters.get(name, math.nan) for name in (DELAY, HOVER, CURVE))
    delay_s = facts.mocap.delay_s if facts.ground is None else config.mocap.delay_s
    return (
        agreement.check_delay(delay_ms, delay_s, wanted.delay_apart_s),
        vehicle.check_hover_thrust(config.vehicle.hover_thrust, hover),
        vehicle.check_thrust_curve(config.vehicle.thrust_curve, curve),
    )
