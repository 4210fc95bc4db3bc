"""What a command needs before it can begin: trajectories, motions of the arms, laws, parameters. In threads."""

import asyncio
from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.arms.planning import plan
from companion.arms.trajectory import JointTrajectory
from companion.config.arm_files import motion_named
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_path, load_controller
from companion.config.law_margin import require_margin
from companion.config.preflight_config import load_recommended
from companion.config.toml_files import read_toml
from companion.config.trajectory_files import Curve, trajectory_named
from companion.control.controller import Controller
from companion.control.pipeline import ControlPipeline
from companion.core.interfaces import ConfigError, FlightError
from companion.core.waypoint_limits import LONGEST_S, time_mistake
from companion.geometry.frames import yaw_of
from companion.protocol import commands as asked
from companion.service.flight_actions import FlightActions
from companion.service.margin_process import measure_apart
from companion.trajectories.reference import Trajectory
from companion.trajectories.waypoints import Waypoints

_ALONE_S = 60.0
"""A motion that is played without a trajectory and would go on for ever ends after this."""
_AROUND_S = 30.0
"""The way to the trajectory's start, and the pauses."""


@dataclass(frozen=True)
class Planned:
    """What `track` is to do."""

    name: str
    trajectory: Trajectory
    arms: JointTrajectory | None


class Laws:
    """Control laws by name, for this vehicle."""

    def __init__(self, config: CompanionConfig, name: str) -> None:
        self._config = config
        self.name = name
        """Of the law that a vehicle begins with."""

    async def load(self, name: str) -> Controller:
        """A law that has run once; ConfigError for a name that is none, or a law that must not fly this vehicle."""
        return await asyncio.to_thread(self._load, name)

    def _load(self, name: str) -> Controller:
        config = self._config
        model, period_s = config.vehicle_model(), 1.0 / config.control.rate_hz
        loaded = load_controller(name, model, period_s)
        require_margin(loaded, model, period_s, measure_apart)
        law = loaded.law
        ControlPipeline(law, config.vehicle.thrust_model(), config.limits.limits())  # first calls are slow
        return law


async def planned_track(command: asked.Track, service: FlightActions, config: CompanionConfig) -> Planned:
    """Trajectory and motion of the arms; ConfigError, ArmError or FlightError with the reason why there are none."""
    return await asyncio.to_thread(_planned_track, command, service, config)


def _planned_track(command: asked.Track, service: FlightActions, config: CompanionConfig) -> Planned:
    if command.waypoints is not None:
        name, trajectory = "the path", _waypoints(command.waypoints)
    else:
        assert command.curve is not None
        height_m = command.height_m or _height_m(service)
        name = command.curve
        trajectory = trajectory_named(name, Curve(command.laps, command.period_s, command.size, height_m))
    arms = None
    if command.arms is not None:
        arms = _planned_arms(command.arms, trajectory.duration_s + _AROUND_S, service, config)
    return Planned(name, trajectory, arms)


def _waypoints(rows: tuple[asked.Waypoint, ...]) -> Trajectory:
    times_s = np.array([row.t_s for row in rows])
    wrong = time_mistake(times_s.tolist(), LONGEST_S)
    if wrong is not None:
        raise ConfigError(f"waypoint {wrong[0] + 1}: {wrong[1]}")
    positions = np.array([(row.x_m, row.y_m, row.z_m) for row in rows])
    path = Waypoints(times_s, positions, np.array([row.yaw_rad for row in rows]))
    path.at(0.0)  # solved here and not in the control loop's thread
    return path


def _height_m(service: FlightActions) -> float:
    """Where the vehicle is now; a curve is level."""
    vehicle = service.loop.estimate.vehicle
    if vehicle is None:
        raise FlightError("nobody knows where the vehicle is")
    return round(float(vehicle.position_w_m[2]), 2)


async def planned_arms(name: str, service: FlightActions, config: CompanionConfig) -> JointTrajectory:
    """A motion from where the joints are held; ConfigError or ArmError with the reason why it cannot be run."""
    return await asyncio.to_thread(_planned_arms, name, _ALONE_S, service, config)


def _planned_arms(name: str, duration_s: float, service: FlightActions, config: CompanionConfig) -> JointTrajectory:
    if config.arms is None:
        raise FlightError("this vehicle has no arms: its configuration has no [arms]")
    held_rad = service.arms.held_rad
    model = config.arms.model()
    motion = motion_named(name, duration_s).trajectory(model, held_rad)
    return plan(model, motion, held_rad, via_rad=(config.arms.home_rad(),)).trajectory


def yaw_here_rad(service: FlightActions) -> float:
    """The heading that is asked for now, or else the one that is seen."""
    vehicle = service.loop.estimate.vehicle
    if vehicle is None:
        raise FlightError("nobody knows where the vehicle is")
    return float(yaw_of(vehicle.q_w_flu_wxyz))


async def params_of(service: FlightActions, config: CompanionConfig, law: str) -> dict[str, Any]:
    """The configuration in force, the law's file, and those of the autopilot's parameters that the preflight reads."""
    names = sorted(wanted.name for wanted in load_recommended(config.preflight.parameters))
    return {
        "config": config.model_dump(mode="json"),
        "controller": {"name": law, **read_toml(controller_path(law))},
        "px4": await service.params(names),
    }
