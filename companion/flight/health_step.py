"""The health checks' part of a tick: gathers what they look at, keeps their memory, and says what is new."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.core.interfaces import OperatorLink
from companion.core.types import (
    Array,
    AttitudeThrust,
    AutopilotStatus,
    FlightMode,
    MocapFrame,
    OtherVehicle,
    VehicleState,
)
from companion.core.values import value
from companion.estimation.estimator import Estimate, age_s
from companion.estimation.others import vehicles_of
from companion.flight.arm_step import ArmStep
from companion.geometry.frames import yaw_of
from companion.guard.geofence import Fence
from companion.law_link.link_status import LinkStatus
from companion.supervisor.faults import Event, FailsafeAction, Fault, reaction_to
from companion.supervisor.flight_state import COMMANDED, STREAMING, FlightInputs, FlightState, Phase
from companion.supervisor.health import checks
from companion.supervisor.health.checks import Health
from companion.supervisor.health_inputs import HealthInputs, MocapInputs
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.separation import SeparationRules
from companion.supervisor.state_machine import reference_at
from companion.supervisor.way_ahead import NO_WAY, WayAhead, way_ahead

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sides:
    """Things that are watched beside the flight itself."""

    operator: OperatorLink | None = None
    """None: none is configured."""
    disk_free_mb: Callable[[], float] | None = None
    """None: nothing is recorded to disk."""


@value(kw_only=True)
class Cycle:
    """State of the cycle as the loop knows it before its setpoint; see Observed."""

    time_s: float
    late_s: float
    frame: MocapFrame | None
    """The newest, used or not."""
    estimate: Estimate
    status: AutopilotStatus
    streaming: bool
    sent: AttitudeThrust | None
    at_max_thrust: bool
    law_fault: str
    arm_fault: str
    horizon_fault: str = ""
    link: LinkStatus | None = None
    """Link to a law on the ground; None for a law on board."""
    command_age_s: float = 0.0


class HealthStep:
    """Holds the checks' memory. Call `look` once a cycle."""

    def __init__(
        self,
        rules: SafetyRules,
        fence: Fence,
        sides: Sides,
        off: frozenset[Fault] = frozenset(),
        separation: SeparationRules | None = None,
    ) -> None:
        """`off` are faults that this vehicle cannot recognise; `separation` is None in a room of one vehicle."""
        self._rules, self._fence, self._sides, self._off, self._separation = rules, fence, sides, off, separation
        self._memory = Health()
        self.events: tuple[Event, ...] = ()
        """Faults that are present now."""

    def look(self, cycle: Cycle, flight: FlightState) -> tuple[Event, ...]:
        """Run the checks; what was not there a cycle ago is logged."""
        before = {event.fault for event in self.events}
        observed = self._observed(cycle, flight)
        self._memory, self.events = checks.assess(
            self._memory, observed, self._rules, self._fence, self._off, self._separation
        )
        for event in self.events:
            if event.fault not in before:
                self._tell(event, flight)
        return self.events

    @staticmethod
    def _tell(event: Event, flight: FlightState) -> None:
        reaction = reaction_to(event.fault, flight.stage)
        level = logging.ERROR if reaction > FailsafeAction.WARN else logging.WARNING
        under_way = flight.phase in STREAMING or flight.phase is Phase.HANDED_OVER
        LOG.log(level if under_way else logging.DEBUG, "%s: %s (%s)", event.fault, event.text, reaction.words)

    def _observed(self, cycle: Cycle, flight: FlightState) -> HealthInputs:
        operator, disk_free_mb = self._sides.operator, self._sides.disk_free_mb
        offboard = cycle.status.mode is FlightMode.OFFBOARD
        others = vehicles_of(cycle.estimate.others, cycle.estimate.others_s)
        ahead = self._ahead(flight, cycle, others)
        return HealthInputs(
            time_s=cycle.time_s,
            stage=flight.stage,
            commanded=flight.phase in COMMANDED and flight.disarm_asked_s is None,
            streaming=cycle.streaming,
            airborne=flight.airborne,
            mocap=_seen(cycle),
            autopilot=cycle.status,
            reference_w_m=_reference_w_m(flight, cycle) if flight.airborne else None,
            sent=cycle.sent,
            at_max_thrust=cycle.at_max_thrust,
            law_fault=cycle.law_fault,
            late_s=cycle.late_s,
            landing_due_s=flight.landing_due_s,
            held_by_fault_since_s=flight.held_by_fault_since_s,
            land_asked_s=flight.landing_asked_s if offboard else math.inf,
            arm_fault=cycle.arm_fault,
            horizon_fault=cycle.horizon_fault,
            operator_age_s=operator.age_s() if operator is not None else 0.0,
            disk_free_mb=disk_free_mb() if disk_free_mb is not None else math.inf,
            link=cycle.link,
            others=others,
            taking_off=flight.phase is Phase.TAKEOFF and not flight.airborne,
            path_w_m=ahead.path_w_m,
            rest_w_m=ahead.rest_w_m,
            command_age_s=cycle.command_age_s,
        )

    def _ahead(self, flight: FlightState, cycle: Cycle, others: tuple[OtherVehicle, ...]) -> WayAhead:
        """Return the way ahead while another vehicle is in reach of it."""
        vehicle, rules, ahead_s = cycle.estimate.vehicle, self._separation, self._rules.yield_ahead_s
        if rules is None or vehicle is None or not flight.airborne:
            return NO_WAY
        return way_ahead(flight, cycle.time_s, vehicle, others, rules, ahead_s)


def _reference_w_m(flight: FlightState, cycle: Cycle) -> Array:
    """Return where the vehicle should be; one that seems to stand already cannot follow its descent into the ground."""
    where, vehicle = reference_at(flight, cycle.time_s).position_w_m, cycle.estimate.vehicle
    if flight.still_since_s is None or vehicle is None:
        return where
    return np.array([where[0], where[1], max(where[2], vehicle.position_w_m[2])])


def _seen(cycle: Cycle) -> MocapInputs:
    frame, vehicle = cycle.frame, cycle.estimate.vehicle
    old_s = age_s(cycle.estimate, cycle.time_s)
    if frame is None:
        return MocapInputs(age_s=old_s, verdict=None, frame=-1, stamp_s=math.nan, received_s=math.nan, vehicle=vehicle)
    return MocapInputs(
        age_s=old_s,
        verdict=cycle.estimate.verdict,
        frame=frame.frame,
        stamp_s=frame.stamp_s,
        received_s=frame.received_s,
        vehicle=vehicle,
        late=frame.late,
    )


def facts_of(
    now_s: float,
    vehicle: VehicleState | None,
    status: AutopilotStatus,
    arms: ArmStep | None,
    events: tuple[Event, ...],
    thrust: float = math.nan,
) -> FlightInputs:
    """Return the phase machine's inputs; position and velocity are NaN before the first pose.

    `thrust` (0..1) is the last one sent.
    """
    if vehicle is None:
        nowhere = np.full(3, np.nan)
        position, velocity, yaw_rad = nowhere, nowhere, 0.0
    else:
        position, velocity = vehicle.position_w_m, vehicle.velocity_w_mps
        yaw_rad = float(yaw_of(vehicle.q_w_flu_wxyz))
    return FlightInputs(
        time_s=now_s,
        position_w_m=position,
        velocity_w_mps=velocity,
        yaw_rad=yaw_rad,
        armed=status.armed,
        mode=status.mode,
        arms_stowed=arms is None or arms.stowed,
        arm_fault="" if arms is None else arms.fault,
        cannot_stow="" if arms is None else arms.state.no_way,
        events=events,
        in_air=status.in_air,
        failsafe=status.failsafe,
        text=status.last_text,
        text_s=status.text_s,
        thrust=thrust,
        others=() if vehicle is None else vehicle.others,
    )
