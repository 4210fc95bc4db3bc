"""The supervisor over recorded sessions: PX4's own messages and the recorded poses, from the hover on."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from companion.core.types import AttitudeThrust, AutopilotStatus, MocapFrame
from companion.estimation.estimator import EstimatorParams, EstimatorState, step
from companion.flight.health_step import Cycle, HealthStep, Sides, facts_of
from companion.geometry.frames import flip_yz
from companion.guard.geofence import Fence
from companion.supervisor.faults import Event
from companion.supervisor.flight_state import STREAMING, Action, FlightRules, FlightState, Leg, Phase, Request
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.state_machine import advance
from companion.trajectories.reference import Hold
from tests.adapters.px4.recorded_px4 import RecordedPx4
from tests.mock_autopilot.reenact.known import CAPTURES, SAVED
from tests.mock_autopilot.reenact.session import Pose, Session, load
from tests.supervisor.flown import apply_request

CYCLE_S = 0.01
HOVERS_AFTER_S = 9.0
"""After lift-off each recorded flight stands at its height."""
LEAST_M = 0.8
SEEN_BEFORE_S = 1.0
"""The estimate is settled when the supervisor begins to look."""
RULES, SAFETY = FlightRules(), SafetyRules()
FENCE = Fence((-4.0, -4.0), (4.0, 4.0, 3.0), braking_mps2=2.0, reaction_s=0.5)
LEVEL = AttitudeThrust(np.array([1.0, 0.0, 0.0, 0.0]), np.array(0.5))
MOCAP_NOISE_M = 1e-4
UNEVEN_S = 0.03
"""Frames further apart are a gap; nearer ones were sent on at half their rate, and the other half is put back."""


@dataclass(frozen=True, kw_only=True)
class Cycled:
    """One cycle: what the supervisor knew, and what it made of it."""

    time_s: float
    flight: FlightState
    events: tuple[Event, ...]
    status: AutopilotStatus
    action: Action | None
    """Action that the autopilot is asked for."""


def watched(
    name: str, monkeypatch: pytest.MonkeyPatch, asked: Sequence[tuple[float, Request]] = (), until_s: float = np.inf
) -> list[Cycled]:
    """Let the supervisor see a session from its hover on; `asked` are the operator's requests and their times."""
    session = load(CAPTURES / f"{name}{SAVED}")
    px4, health = RecordedPx4(session, monkeypatch), HealthStep(SAFETY, FENCE, Sides())
    start_s = _hover_from_s(session)
    frames, left = _frames([pose for pose in session.poses if pose.at_s >= start_s - SEEN_BEFORE_S]), list(asked)
    frame, estimate, cycles = None, EstimatorState(), list[Cycled]()
    flight = _hovering(frames[0], start_s)
    for tick in range(round((min(until_s, session.ends_at_s) - start_s) / CYCLE_S)):
        now_s = start_s + tick * CYCLE_S
        px4.advance(now_s)
        while frames and frames[0].received_s <= now_s:
            frame = frames.pop(0)
            estimate = step(estimate, frame, EstimatorParams())
        status, streaming = px4.heard.status, flight.phase in STREAMING
        cycle = Cycle(
            time_s=now_s,
            late_s=0.0,
            frame=frame,
            estimate=estimate,
            status=status,
            streaming=streaming,
            sent=LEVEL,
            at_max_thrust=False,
            law_fault="",
            arm_fault="",
        )
        events = health.look(cycle, flight)
        facts = facts_of(now_s, estimate.vehicle, status, None, events, 0.5)
        asked_for = None
        while left and left[0][0] <= now_s:
            flight = apply_request(flight, left.pop(0)[1], facts, RULES)
            asked_for = flight.action
        flight = advance(flight, facts, RULES)
        action = flight.action or asked_for
        cycles.append(Cycled(time_s=now_s, flight=flight, events=events, status=status, action=action))
    return cycles


def _hover_from_s(session: Session) -> float:
    off_s = next(event.at_s for event in session.events if "Takeoff detected" in event.what)
    return round(off_s + HOVERS_AFTER_S, 2)


def _frames(poses: Sequence[Pose]) -> list[MocapFrame]:
    """Return the frames of a mocap of 100 Hz of which these poses were forwarded."""
    rng, frames = np.random.default_rng(5), list[MocapFrame]()
    for before, after in itertools.pairwise(poses):
        halves = (0.0, 0.5) if after.at_s - before.at_s < UNEVEN_S else (0.0,)
        for half in halves:
            at_s = before.at_s + half * (after.at_s - before.at_s)
            place = (1.0 - half) * np.array(before.position_m) + half * np.array(after.position_m)
            place_w_m = flip_yz(place) + MOCAP_NOISE_M * rng.standard_normal(3)
            frames.append(
                MocapFrame(
                    frame=len(frames),
                    stamp_s=at_s,
                    received_s=at_s,
                    position_w_m=place_w_m,
                    rotation_w_b=np.eye(3),
                    residual_m=0.0,
                )
            )
    return frames


def _hovering(first: MocapFrame, start_s: float) -> FlightState:
    place = first.position_w_m
    assert place[2] > LEAST_M
    ground = np.array([place[0], place[1], 0.0])
    legs = (Leg(Phase.HOLD, Hold(place, 0.0)),)
    return FlightState(
        phase=Phase.HOLD, since_s=start_s, legs=legs, leg_start_s=start_s, ground_w_m=ground, airborne=True
    )


def phases_of(cycles: Sequence[Cycled]) -> list[Phase]:
    """Return the phases in their order."""
    return list(dict.fromkeys(cycle.flight.phase for cycle in cycles))


def first_s(cycles: Sequence[Cycled], phase: Phase) -> float:
    """Return when a phase began."""
    return next(cycle.time_s for cycle in cycles if cycle.flight.phase is phase)


def actions_of(cycles: Sequence[Cycled]) -> list[Action]:
    """Return what the autopilot was asked for."""
    return [cycle.action for cycle in cycles if cycle.action is not None]


def sentences_of(cycles: Sequence[Cycled]) -> list[str]:
    """Return what was found wrong, the first sentence of each fault."""
    return list({event.fault: event.text for cycle in reversed(cycles) for event in cycle.events}.values())[::-1]
