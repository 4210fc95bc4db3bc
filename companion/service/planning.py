"""Preparation of commands: trajectories, motions of the arms, laws. Takes up to seconds, so call it in a thread."""

from dataclasses import dataclass

import numpy as np

from companion.arms.planning import Plan, plan
from companion.arms.trajectory import JointTrajectory
from companion.config.arm_files import motion_named
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.config.trajectory_files import Curve, trajectory_named
from companion.control.controller import Controller
from companion.core.interfaces import ConfigError, FlightError
from companion.core.types import Array
from companion.core.waypoint_limits import LONGEST_S, time_mistake
from companion.flight.assembly import controller_of, margin_in, pipeline_of
from companion.geometry.frames import yaw_of
from companion.protocol import commands
from companion.service.flight_actions import FlightActions
from companion.service.margin_process import measure_apart
from companion.trajectories.reference import Trajectory
from companion.trajectories.waypoints import Waypoints

_ENDLESS_MOTION_S = 60.0
"""Duration of an endless motion that is played without a trajectory."""
APPROACH_S = 30.0
"""Time for the approach to the trajectory's start and the pauses around it."""


@dataclass(frozen=True)
class Planned:
    """Trajectory, and motion of the arms if any, that a `track` command will fly."""

    name: str
    trajectory: Trajectory
    arms: JointTrajectory | None


def load_law(name: str, config: CompanionConfig) -> Controller:
    """Return a law that has run once; raise ConfigError for an unknown name or a law unfit for this vehicle."""
    loaded = controller_of(config, name)
    margin_in(config, loaded, measure_apart)
    pipeline_of(config, loaded.law)  # first calls are slow
    return loaded.law


def planned_track(command: commands.Track, service: FlightActions, config: ArmsConfig | None) -> Planned:
    """Return the trajectory and the motion of the arms; raise ConfigError, ArmError or FlightError with the reason."""
    if command.waypoints is not None:
        name, trajectory = "the path", _waypoints(command.waypoints)
    else:
        assert command.curve is not None
        height_m = command.height_m or _height_m(service)
        name = command.curve
        trajectory = trajectory_named(name, Curve(command.laps, command.period_s, command.size, height_m))
    arms = None
    if command.arms is not None:
        arms = planned_arms(command.arms, service, config, trajectory.duration_s + APPROACH_S)
    return Planned(name, trajectory, arms)


def _waypoints(rows: tuple[commands.Waypoint, ...]) -> Trajectory:
    times_s = np.array([row.t_s for row in rows])
    mistake = time_mistake(times_s.tolist(), LONGEST_S)
    if mistake is not None:
        raise ConfigError(f"waypoint {mistake[0] + 1}: {mistake[1]}")
    positions = np.array([(row.x_m, row.y_m, row.z_m) for row in rows])
    path = Waypoints(times_s, positions, np.array([row.yaw_rad for row in rows]))
    path.at(0.0)  # solved here and not in the control loop's thread
    return path


def _height_m(service: FlightActions) -> float:
    """Return the present height in W, m, at which a level curve is flown."""
    vehicle = service.loop.estimate.vehicle
    if vehicle is None:
        raise FlightError("the vehicle's position is not known: check motion capture")
    return round(float(vehicle.position_w_m[2]), 2)


def planned_arms(
    name: str, service: FlightActions, config: ArmsConfig | None, duration_s: float = _ENDLESS_MOTION_S
) -> JointTrajectory:
    """Return a motion that starts at the held joint angles; raise ConfigError or ArmError when it cannot be run."""
    if config is None:
        raise FlightError("this vehicle has no arms: its configuration has no [arms]")
    return plan_motion(name, duration_s, config, service.arms.held_rad).trajectory


def plan_motion(name: str, duration_s: float, arms: ArmsConfig, start_rad: Array) -> Plan:
    """Plan a motion by its name or file from the joint angles `start_rad` (8,); ConfigError or ArmError if it fails."""
    model = arms.model()
    motion = motion_named(name, duration_s).trajectory(model, start_rad)
    return plan(model, motion, start_rad, via_rad=(arms.home_rad(),))


def yaw_here_rad(service: FlightActions) -> float:
    """Return the estimated heading in W, rad; raise FlightError while there is no estimate."""
    vehicle = service.loop.estimate.vehicle
    if vehicle is None:
        raise FlightError("the vehicle's position is not known: check motion capture")
    return float(yaw_of(vehicle.q_w_flu_wxyz))
