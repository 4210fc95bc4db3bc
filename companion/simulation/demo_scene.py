"""The demo's flight as a scene for virtual time, from lift-off to the trajectory's end: all but takeoff and landing."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.arms.planning import Plan
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
"""What sockets, event loops and the autopilot's own steps add to each delay of the mock; measured in demo flights."""
LIFT_OFF_S = 7.76
"""From the mock's boot, when its disturbance begins, to lift-off in a demo; measured, 0.03 s more or less."""
_SWING_ON_S = 30.0
"""The demo's arms move on until they are stowed for the landing."""


def demo_scene(name: str, trajectory: Trajectory, arms: str, companion: CompanionConfig, mock: MockConfig) -> Scene:
    """The scene of `companion demo` with these choices, begun at lift-off and without the landing.

    The disturbance is as far on its way as it is in the demo by then, but its random part is another draw. Raises
    ArmError or ConfigError.
    """
    if arms != "off" and not mock.arms.enabled:
        raise ConfigError(f"arms {arms!r}: the mock's configuration has none, enable them there or turn them off here")
    flown = _from_lift_off(trajectory, companion)
    plan = planned_arms(arms, companion, trajectory.duration_s + _SWING_ON_S)
    return Scene(
        name,
        f"the demo, {name}",
        flown,
        math.ceil(flown.before_s * companion.control.rate_hz) / companion.control.rate_hz,  # a cycle begins at 0
        None if plan is None else _after_standing(plan, flown.climb_s),
        companion,
        mock.model_copy(update={"disturbance": _under_way(mock.disturbance, LIFT_OFF_S)}),
        LINK_S,
    )


def load_mock(path: Path) -> MockConfig:
    """The mock's configuration; ConfigError with one sentence for whatever is wrong with it."""
    try:
        return MockConfig.load(path)
    except MockConfigError as error:
        raise ConfigError(str(error)) from None


@dataclass(frozen=True)
class _FromLiftOff:
    """A trajectory, and what the flight phases lead through before its time 0."""

    flight: FlightState
    climb_s: float
    before_s: float
    duration_s: float

    def at(self, time_s: float) -> Reference:
        """As the flight loop has it."""
        return state_machine.reference_at(self.flight, time_s)


def _from_lift_off(trajectory: Trajectory, companion: CompanionConfig) -> _FromLiftOff:
    """Climb, way to the start, wait, trajectory: the legs of the demo, planned by the phase machine."""
    rules, height_m = companion.flight_rules(), companion.flight.takeoff_height_m
    above = _up(height_m)
    facts = FlightInputs(0.0, above, np.zeros(3), 0.0, armed=True, mode=FlightMode.OFFBOARD)
    holding = FlightState(Phase.HOLD, legs=(Leg(Phase.HOLD, Hold(above)),))
    legs = state_machine.request(holding, TrackRequest(trajectory, companion.flight.settle_s), facts, rules).legs
    climb_s = minimum_jerk_duration_s(height_m - rules.lift_off_m, rules.climb_speed_mps, rules.climb_accel_mps2)
    climb = Leg(Phase.TAKEOFF, MinimumJerk(_up(rules.lift_off_m), above, climb_s))
    way, wait, *_ = legs
    before_s = climb_s + way.trajectory.duration_s + wait.trajectory.duration_s
    return _FromLiftOff(
        FlightState(legs=(climb, *legs), leg_start_s=-before_s), climb_s, before_s, trajectory.duration_s
    )


def _up(height_m: float) -> Array:
    return np.array([0.0, 0.0, height_m])


def _after_standing(plan: Plan, for_s: float) -> Plan:
    """The same motion, begun so much later."""
    stowed = ArmsHold(plan.trajectory.at(0.0).position_rad, for_s)
    return replace(plan, trajectory=InTurn((stowed, plan.trajectory)))


def _under_way(disturbance: DisturbanceConfig, since_s: float) -> DisturbanceConfig:
    """The disturbance as it goes on so long after its begin."""
    waves = tuple(
        replace(wave, phase_rad=wave.phase_rad + math.tau * since_s / wave.period_s) for wave in disturbance.sinusoids
    )
    return disturbance.model_copy(update={"sinusoids": waves})
