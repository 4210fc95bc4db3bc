"""Short flights in virtual time, for the tests that need one."""

from dataclasses import replace
from typing import Any

import numpy as np

from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController, load_controller
from companion.simulation.scene import Scene, planned_arms
from companion.trajectories.reference import Ellipse, LapTiming, Trajectory
from mock_autopilot.config import MockConfig

CENTRE = np.array([0.0, 0.0, 1.2])
LAP = Ellipse(CENTRE, timing=LapTiming(period_s=6.0, laps=1, ramp_s=2.0))
PUSHED: dict[str, Any] = {
    "constant_ned_n": [0.4, -0.3, 0.0],
    "noise_n": [0.2, 0.2, 0.2],
    "sinusoids": [
        {"amplitude_ned_n": [1.4, 0.0, 0.0], "period_s": 9.0},
        {"amplitude_ned_n": [0.0, 1.1, 0.0], "period_s": 13.0, "phase_rad": 1.0},
        {"amplitude_ned_n": [0.0, 0.0, 0.8], "period_s": 7.0, "phase_rad": 2.0},
    ],
}
QUIET: dict[str, Any] = {"noise_m": 0.0, "noise_rad": 0.0}


PERFECT_HORIZON: dict[str, Any] = {"attitude_error_rad": 0.0}


def scene(trajectory: Trajectory = LAP, arms: str = "off", settle_s: float = 1.0, **mock: Any) -> Scene:
    """The vehicle that both sides take for granted when they are told nothing; `mock` are tables of its file.

    The autopilot's horizon is perfect unless `mock` has an estimator: what a law or the physics does is to be seen.
    """
    companion = CompanionConfig(arms=ArmsConfig())
    plan = planned_arms(arms, companion.arms, trajectory.duration_s + settle_s)
    return Scene(
        name="short",
        title="a short flight",
        trajectory=trajectory,
        settle_s=settle_s,
        arms=plan,
        companion=companion,
        mock=MockConfig.from_dict({"estimator": PERFECT_HORIZON} | mock),
    )


def perfect_horizon(flown: Scene) -> Scene:
    """Return the scene with an autopilot whose horizon does not err."""
    estimator = flown.mock.estimator.model_copy(update=PERFECT_HORIZON)
    return replace(flown, mock=flown.mock.model_copy(update={"estimator": estimator}))


def law_for(flown: Scene, name: str = "etnn", allow_unstable: bool = False) -> LoadedController:
    """A controller for the scene's vehicle."""
    return load_controller(name, flown.vehicle_model(), flown.period_s, allow_unstable)
