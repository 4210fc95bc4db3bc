"""Scene of the demo's flight for virtual time, from lift-off to the trajectory's end, without the landing."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.arms.trajectory import Hold as ArmsHold
from companion.arms.trajectory import InTurn
from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import ConfigError
from companion.core.types import Array, FlightMode, Reference
from companion.simulation.scene import Scene, planned_arms
from companion.supervisor import state_machine
from companion.supervisor.flight_state import FlightInputs, FlightState, Leg, Phase, TrackRequest
from companion.trajectories.reference import Hold, MinimumJerk, Trajectory, minimum_jerk_duration_s
from mock_autopilot.config import DisturbanceConfig, MockConfig, MockConfigError

LINK_S = 0.002
"""Time that sockets, event loops and the autopilot's steps add to each delay of the mock; measured in demo flights."""
LIFT_OFF_S = 7.76
"""Time from the mock's boot, when its disturbance begins, to lift-off in a demo; measured, +- 0.03 s."""
_SWING_ON_S = 30.0
"""Time for which the demo's arms move on after the trajectory, until they are stowed for the landing."""


def demo_scene(name: str, trajectory: Trajectory, arms: str, companion: CompanionConfig, mock: MockConfig) -> Scene:
    """Return the scene of `companion demo` with these choices, from lift-off and without the landing.

    The disturbance has the phase that it has in the demo at lift-off, but its random part is a different draw. Raises
    ArmError or ConfigError.
    """
    if arms != "off" and not mock.arms.enabled:
        raise ConfigError(f"arms {arms!r}: the mock's configuration has none, enable them there or turn them off here")
    flown = _from_lift_off(trajectory, companion)
    plan = planned_arms(arms, companion.arms, trajectory.duration_s + _SWING_ON_S)
    if plan is not None:
        stowed = ArmsHold(plan.trajectory.at(0.0).position_rad, flown.climb_s)
        plan = replace(plan, trajectory=InTurn((stowed, plan.trajectory)))
    return Scene(
        name=name,
        title=f"the demo, {name}",
        trajectory=flown,
        settle_s=math.ceil(flown.before_s * companion.control.rate_hz)
        / companion.control.rate_hz,  # a cycle begins at 0
        arms=plan,
        companion=companion,
        mock=mock.model_copy(update={"disturbance": _under_way(mock.disturbance, LIFT_OFF_S)}),
        link_s=LINK_S,
    )


def load_mock(path: Path) -> MockConfig:
    """Return the mock's configuration from a file; ConfigError with one sentence for any error in it."""
    try:
        return MockConfig.load(path)
    except MockConfigError as error:
        raise ConfigError(str(error)) from None


@dataclass(frozen=True)
class _FromLiftOff:
    """Trajectory together with the legs of the flight before its time 0."""

    flight: FlightState
    climb_s: float
    before_s: float
    duration_s: float

    def at(self, time_s: float) -> Reference:
        return state_machine.reference_at(self.flight, time_s)


def _from_lift_off(trajectory: Trajectory, companion: CompanionConfig) -> _FromLiftOff:
    rules, height_m = companion.flight_rules(), companion.flight.takeoff_height_m
    above = _up(height_m)
    inputs = FlightInputs(
        time_s=0.0, position_w_m=above, velocity_w_mps=np.zeros(3), yaw_rad=0.0, armed=True, mode=FlightMode.OFFBOARD
    )
    holding = FlightState(phase=Phase.HOLD, legs=(Leg(Phase.HOLD, Hold(above)),))
    request = TrackRequest(trajectory, companion.flight.settle_s)
    legs = state_machine.apply_request(holding, request, inputs, rules)[0].legs
    climb_s = minimum_jerk_duration_s(height_m - rules.lift_off_m, rules.climb_speed_mps, rules.climb_accel_mps2)
    climb = Leg(Phase.TAKEOFF, MinimumJerk(start_w_m=_up(rules.lift_off_m), end_w_m=above, duration_s=climb_s))
    way, wait, *_ = legs
    before_s = climb_s + way.trajectory.duration_s + wait.trajectory.duration_s
    return _FromLiftOff(
        FlightState(legs=(climb, *legs), leg_start_s=-before_s), climb_s, before_s, trajectory.duration_s
    )


def _up(height_m: float) -> Array:
    return np.array([0.0, 0.0, height_m])


def _under_way(disturbance: DisturbanceConfig, since_s: float) -> DisturbanceConfig:
    waves = tuple(
        replace(wave, phase_rad=wave.phase_rad + math.tau * since_s / wave.period_s) for wave in disturbance.sinusoids
    )
    return disturbance.model_copy(update={"sinusoids": waves})
